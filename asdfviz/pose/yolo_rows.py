"""YOLO-pose label files: a row an object, `class cx cy w h` and 17 times `x y v`, as shares of the image.

Rows of states have zeros for keypoints. A keypoint outside the image is `0 0 0`, for readers of
this format refuse shares beyond 1; v is 1 for hidden and 2 for visible ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asdfviz.pose.labels import LabelledObject


def yolo_rows(objects: Sequence[LabelledObject], *, width: int, height: int) -> str:
    """The text of one label file; objects wholly outside the image get no row.

    Args:
        objects: labels in pixels; an integer is a pixel's centre.
        width: of the image, pixels.
        height: of the image, pixels.
    """
    rows = (_row(item, np.array([width, height], np.float64)) for item in objects)
    return "".join(f"{row}\n" for row in rows if row is not None)


def _row(item: LabelledObject, size: np.ndarray) -> str | None:
    outline = (item.outline + 0.5) / size
    low, high = outline.min(axis=0).clip(0, 1), outline.max(axis=0).clip(0, 1)
    if (high <= low).any():
        return None
    keypoints = item.keypoints.astype(np.float64)
    places = (keypoints[:, :2] + 0.5) / size
    flags = keypoints[:, 2:]
    labelled = (flags[:, 0] > 0) & (places >= 0).all(axis=1) & (places <= 1).all(axis=1)
    kept = np.where(labelled[:, None], np.concatenate([places, flags], axis=1), 0.0)
    box = " ".join(f"{x:.6f}" for x in [*((low + high) / 2), *(high - low)])
    points = " ".join(f"{x:.6f} {y:.6f} {v:.0f}" for x, y, v in kept)
    return f"{item.label} {box} {points}"
