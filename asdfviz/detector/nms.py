"""Keeps the best of overlapping boxes of one class."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.boxes import iou_matrix
from asdfviz.geometry.shapes import Scores

Labels: TypeAlias = Int64[np.ndarray, "n"]
Places: TypeAlias = Int64[np.ndarray, "k"]


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
