"""The array shapes that signatures use. jaxtyping checks them in tests and costs nothing elsewhere."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

Transform: TypeAlias = Float64[np.ndarray, "4 4"]
"""T_a_b maps points: p_a = T_a_b @ p_b."""
Transforms: TypeAlias = Float64[np.ndarray, "n 4 4"]
Rotation: TypeAlias = Float64[np.ndarray, "3 3"]
Vector: TypeAlias = Float64[np.ndarray, "3"]
Points: TypeAlias = Float64[np.ndarray, "n 3"]
Pixels: TypeAlias = Float64[np.ndarray, "n 2"]
"""(u, v); an integer is a pixel's centre."""
Intrinsics: TypeAlias = Float64[np.ndarray, "3 3"]
Distortion: TypeAlias = Float64[np.ndarray, "k"]
"""OpenCV's k1 k2 p1 p2, then k3, then k4 k5 k6 if the lens has them: 4, 5 or 8 numbers."""
Box: TypeAlias = Float64[np.ndarray, "4"]
"""x0, y0, x1, y1 in pixels."""
Scores: TypeAlias = Float64[np.ndarray, "n"]
AllScores: TypeAlias = Float64[np.ndarray, "all"]
"""One for every state of an assembly, half-done ones among them: more than its own."""
Faces: TypeAlias = Int32[np.ndarray, "f 3"]
Depth: TypeAlias = Float32[np.ndarray, "h w"]
"""Planar depth (z) in metres, 0 where nothing was measured."""
Mask: TypeAlias = Bool[np.ndarray, "h w"]
Rgb: TypeAlias = UInt8[np.ndarray, "h w 3"]
Ids: TypeAlias = Int32[np.ndarray, "h w"]
