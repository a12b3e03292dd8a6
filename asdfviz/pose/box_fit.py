"""Corrects the distance of a PnP pose by the size of the detected box.

Keypoints of a half-trained network shrink towards the middle of the box, and PnP answers a small
pattern with a distant part. The box itself is far more reliable, so where the projected part and
the box disagree clearly, the part slides along the viewing ray until their sizes agree.
Ordinary geometry on what was seen; not in the paper. Between PnP and the translation refinement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.geometry.boxes import diagonal
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Box, Intrinsics, Points, Transform
from asdfviz.geometry.transforms import apply


@dataclass(frozen=True)
class BoxFitConfig:
    """When the box overrules PnP's distance."""

    enabled: bool = True
    """Paper: no such step. Here: on for `asdf`, because shrunken keypoints cost metres."""
    tolerance: float = 0.2
    """Relative difference between projected extent and box above which the distance is changed."""
    border_px: float = 3.0
    """A box that comes this near to the image border is cut off and says nothing of size, pixels."""


def fit_to_box(
    T_camera_part: Transform,
    corners_part: Points,
    *,
    box_xyxy: Box,
    K: Intrinsics,
    size_wh: tuple[int, int],
    config: BoxFitConfig,
) -> Transform:
    """Slide the part along the ray through its middle until it is as large as its box.

    Args:
        T_camera_part: the pose to correct; its rotation stays.
        corners_part: points that span the part's outline from every side, as `hull_corners` gives
            them, metres. Points sampled on the surface miss the tips and make parts too small.
        box_xyxy: the detected box, pixels.
        K: intrinsics of the undistorted image.
        size_wh: width and height of the image, pixels.
        config: when the box overrules the distance.

    Returns:
        The same pose where the sizes agree within the tolerance or the box is cut off.
    """
    if not config.enabled or is_cut_off(box_xyxy, size_wh, config.border_px):
        return T_camera_part
    ratio = _size_ratio(T_camera_part, corners_part, box_xyxy, K)
    if ratio is None or abs(np.log(ratio)) <= np.log1p(config.tolerance):
        return T_camera_part
    moved = T_camera_part
    for _ in range(3):  # extent is only nearly proportional to 1 / distance
        corners_camera = apply(moved, corners_part)
        middle = (corners_camera.min(axis=0) + corners_camera.max(axis=0)) / 2
        moved = moved.copy()
        moved[:3, 3] += (ratio - 1) * middle
        again = _size_ratio(moved, corners_part, box_xyxy, K)
        if again is None:
            return T_camera_part
        if abs(again - 1) < 0.01:
            break
        ratio = again
    return moved


def is_cut_off(box_xyxy: Box, size_wh: tuple[int, int], border_px: float) -> bool:
    """Whether a box comes so near to the image's border that it may hide some of the object."""
    x0, y0, x1, y1 = box_xyxy
    width, height = size_wh
    near_start = min(x0, y0) < border_px
    return bool(near_start or x1 > width - 1 - border_px or y1 > height - 1 - border_px)


def _size_ratio(
    T_camera_part: Transform, corners_part: Points, box_xyxy: Box, K: Intrinsics
) -> float | None:
    """Projected diagonal over the box's; above 1 the part is too near."""
    pixels = project(apply(T_camera_part, corners_part), K)
    if not np.isfinite(pixels).all():
        return None
    projected = float(np.linalg.norm(np.ptp(pixels, axis=0)))
    boxed = diagonal(box_xyxy)
    return projected / boxed if projected > 0 and boxed > 0 else None
