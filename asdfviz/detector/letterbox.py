"""Fits a frame into the network's input and maps results back.

The input keeps the frame's own shape (640x360 becomes 640x384, not 640x640). In frames an integer
is a pixel's centre; in the network's coordinates the first pixel's centre is 0.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64, UInt8

from asdfviz.geometry.shapes import Rgb

PADDING = 114
"""Grey of the border, as in YOLOv8."""


@dataclass(frozen=True, slots=True)
class Letterbox:
    """How a frame of one size lies in the network's input."""

    width: int
    height: int
    """Size of the input, pixels."""
    inner_width: int
    inner_height: int
    """Size of the resized frame within it."""
    left: int
    top: int
    """Border, pixels."""
    scale_x: float
    scale_y: float
    """Input pixels a frame pixel."""

    def to_network(self, points: Float64[np.ndarray, "*n 2"]) -> Float64[np.ndarray, "*n 2"]:
        """Map frame pixels (integer = centre) to network coordinates (first centre = 0.5)."""
        return (points + 0.5) * [self.scale_x, self.scale_y] + [self.left, self.top]

    def to_frame(self, points: Float64[np.ndarray, "*n 2"]) -> Float64[np.ndarray, "*n 2"]:
        """Map network coordinates back to frame pixels."""
        return (points - [self.left, self.top]) / [self.scale_x, self.scale_y] - 0.5


def plan_letterbox(width: int, height: int, *, image_size: int, stride: int) -> Letterbox:
    """Plan the input for frames of width x height.

    Args:
        width: of the frame, pixels.
        height: of the frame, pixels.
        image_size: the input's longer side, pixels.
        stride: both sides of the input become multiples of it.
    """
    ratio = image_size / max(width, height)
    inner_w, inner_h = max(1, round(width * ratio)), max(1, round(height * ratio))
    out_w, out_h = (math.ceil(side / stride) * stride for side in (inner_w, inner_h))
    return Letterbox(
        width=out_w,
        height=out_h,
        inner_width=inner_w,
        inner_height=inner_h,
        left=(out_w - inner_w) // 2,
        top=(out_h - inner_h) // 2,
        scale_x=inner_w / width,
        scale_y=inner_h / height,
    )


def letterbox(rgb: Rgb, plan: Letterbox) -> UInt8[np.ndarray, "out_h out_w 3"]:
    """Return the network's input picture; what is outside the frame is grey."""
    inner = rgb
    if rgb.shape[:2] != (plan.inner_height, plan.inner_width):
        # Averaging instead of picking, so that thin parts do not flicker when a frame shrinks.
        kind = cv2.INTER_AREA if plan.scale_x < 1 else cv2.INTER_LINEAR
        inner = cv2.resize(rgb, (plan.inner_width, plan.inner_height), interpolation=kind)
    out = np.full((plan.height, plan.width, 3), PADDING, np.uint8)
    rows = slice(plan.top, plan.top + plan.inner_height)
    out[rows, plan.left : plan.left + plan.inner_width] = inner
    return out
