"""Draws posed parts over a picture: shaded, half transparent, outlined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import UInt8

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Ids, Intrinsics, Rgb, Transform
from asdfviz.render.renderer import Renderer

_DARKEST = 70
"""Brightness under which an overlay colour is lifted, so that black parts show on black."""


def draw_overlay(
    rgb: Rgb,
    poses: Mapping[str, Transform],
    assembly: Assembly,
    K: Intrinsics,
    *,
    renderer: Renderer,
    opacity: float = 0.5,
    outline_px: int = 2,
    colors: Mapping[str, UInt8[np.ndarray, 3]] | None = None,
) -> Rgb:
    """Return a copy of the picture with the parts drawn over it, hiding each other as they should.

    Args:
        rgb: picture of the renderer's size.
        poses: T_camera_part of the parts to draw.
        assembly: where meshes and colours come from.
        K: intrinsics of the picture.
        renderer: of the picture's size.
        opacity: 0 leaves only outlines, 1 hides the picture.
        outline_px: width of the outlines, 0 for none.
        colors: sRGB by part, instead of the parts' own.
    """
    names = [name for name in poses if name in assembly.parts]
    result = rgb.copy()
    if not names:
        return result
    meshes = [assembly.parts[name].mesh for name in names]
    Ts_camera_part = [poses[name] for name in names]
    paint = [_visible((colors or {}).get(name, assembly.parts[name].color)) for name in names]
    _, ids = renderer.depth_and_ids(meshes, Ts_camera_part, K)
    shaded = renderer.color(meshes, Ts_camera_part, paint, K, antialias=False)
    inside = ids >= 0
    mixed = (1.0 - opacity) * rgb[inside] + opacity * shaded[inside]
    result[inside] = np.round(mixed).astype(np.uint8)
    return draw_outlines(result, ids, paint, width_px=outline_px) if outline_px > 0 else result


def draw_outlines(rgb: Rgb, ids: Ids, colors: Sequence[np.ndarray], *, width_px: int) -> Rgb:
    """Return a copy of the picture with the border of every id's region, holes too, drawn in."""
    result = np.ascontiguousarray(rgb.copy())
    for place, color in enumerate(colors):
        region = (ids == place).astype(np.uint8)
        contours, _ = cast(Any, cv2).findContours(region, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        bright = np.round(0.65 * np.asarray(color, dtype=float) + 0.35 * 255).tolist()
        cv2.drawContours(result, contours, -1, bright, width_px, cv2.LINE_AA)
    return result


def _visible(color: UInt8[np.ndarray, 3]) -> UInt8[np.ndarray, 3]:
    missing = _DARKEST - int(color.max())
    return color if missing <= 0 else (color + np.uint8(missing)).astype(np.uint8)
