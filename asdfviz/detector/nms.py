"""Keeps the best of overlapping boxes of one class."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.shapes import Scores

Labels: TypeAlias = Int64[np.ndarray, "n"]
Places: TypeAlias = Int64[np.ndarray, "k"]


def iou_matrix(
    a: Float64[np.ndarray, "n 4"], b: Float64[np.ndarray, "m 4"]
) -> Float64[np.ndarray, "n m"]:
    """Intersection over union of boxes x0 y0 x1 y1; 0 where both are empty."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    overlap = np.clip(high - low, 0, None).prod(-1)
    area_a = np.clip(a[:, 2:] - a[:, :2], 0, None).prod(-1)
    area_b = np.clip(b[:, 2:] - b[:, :2], 0, None).prod(-1)
    union = area_a[:, None] + area_b[None] - overlap
    return overlap / np.maximum(union, 1e-12)


def suppress(
    boxes: Float64[np.ndarray, "n 4"],
    scores: Scores,
    labels: Labels,
    *,
    iou: float,
    limit: int,
) -> Places:
    """Return the places of the boxes to keep, best first, by greedy suppression in each class."""
    order = np.argsort(-scores, kind="stable")
    overlaps = iou_matrix(boxes, boxes)
    rivals = (overlaps > iou) & (labels[:, None] == labels[None])
    alive = np.ones(len(scores), bool)
    kept: list[int] = []
    for place in order:
        if len(kept) == limit:
            break
        if alive[place]:
            kept.append(int(place))
            alive &= ~rivals[place]
    return np.array(kept, dtype=np.int64)
