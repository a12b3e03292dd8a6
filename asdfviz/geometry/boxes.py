"""Boxes in the picture: x0 y0 x1 y1, whether in pixels or in a plane of the camera; boxes in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Box, Mask, Pixels, Points, Vector

_WAYS = np.array([[1.0, 0, 1, 0], [-1, 0, -1, 0], [0, 1, 0, 1], [0, -1, 0, -1]])
"""By which corners move."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxMask:
    """Which pixels of the frame show a part, by a mask branch; none outside its box does."""

    left: int
    top: int
    """Column and row of the first pixel."""
    pixels: Mask


def box_around(pixels: Pixels) -> Box:
    """The smallest box about points."""
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def box_middle(box_xyxy: Box) -> Float64[np.ndarray, "2"]:
    """The point in the box's middle."""
    return (box_xyxy[:2] + box_xyxy[2:]) / 2


def middle_of_points(points: Points) -> Vector:
    """The middle of the smallest box about points in space; read-only."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    middle.flags.writeable = False
    return middle


def is_in_view(box_xyxy: Box, size_wh: tuple[int, int]) -> bool:
    """Whether the box's middle lies in a picture of this size."""
    middle = box_middle(box_xyxy)
    return bool(np.all(middle >= 0) and np.all(middle < size_wh))


def iou_matrix(
    a: Float64[np.ndarray, "n 4"], b: Float64[np.ndarray, "m 4"]
) -> Float64[np.ndarray, "n m"]:
    """Intersection over union of every box of `a` with every one of `b`; 0 where both are empty."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    both = np.clip(high - low, 0, None).prod(-1)
    area_a = np.clip(a[:, 2:] - a[:, :2], 0, None).prod(-1)
    area_b = np.clip(b[:, 2:] - b[:, :2], 0, None).prod(-1)
    return both / np.maximum(area_a[:, None] + area_b[None] - both, 1e-12)


def overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes, 0 to 1."""
    # In plain numbers and not by `iou_matrix`: numpy takes ten times longer for two boxes.
    (left, top, right, bottom), (b_left, b_top, b_right, b_bottom) = a.tolist(), b.tolist()
    wide = min(right, b_right) - max(left, b_left)
    high = min(bottom, b_bottom) - max(top, b_top)
    if wide <= 0 or high <= 0:
        return 0.0
    both = wide * high
    of_b = (b_right - b_left) * (b_bottom - b_top)
    return both / ((right - left) * (bottom - top) + of_b - both)


def share_inside(a: Box, b: Box) -> float:
    """Share of box a that lies within box b, 0 to 1."""
    extent = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    return float(np.maximum(extent, 0).prod() / (a[2:] - a[:2]).prod())


def longer_side(box_xyxy: Box) -> float:
    """The larger of its width and height."""
    return float((box_xyxy[2:] - box_xyxy[:2]).max())


def beside(box_xyxy: Box, share: float) -> list[Box]:
    """The box moved to the right, left, down and up, by so much of its longer side."""
    return [box_xyxy + share * longer_side(box_xyxy) * way for way in _WAYS]


def diagonal(box_xyxy: Box) -> float:
    """Its length, in the unit of the box."""
    return float(np.linalg.norm(box_xyxy[2:] - box_xyxy[:2]))
