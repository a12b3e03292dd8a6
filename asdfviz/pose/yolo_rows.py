"""YOLO-pose label files: a row an object, `class cx cy w h` and 17 times `x y v`, as shares of the image.

Rows of states have zeros for keypoints. A keypoint outside the image is `0 0 0`, for readers of
this format refuse shares beyond 1; v is 1 for hidden and 2 for visible ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import KEYPOINTS
from asdfviz.pose.labels import Flags, LabelledObject

_COLUMNS = 5 + 3 * KEYPOINTS
_SAME_PX = 0.5
"""A row is an object's if no keypoint lies farther from the object's own; pixels."""


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


def flags_of_rows(
    text: str, objects: Sequence[LabelledObject], *, width: int, height: int, first_label: int = 0
) -> tuple[Flags | None, ...]:
    """The flags of the objects' keypoints in a label file: 1 hidden or outside the image, 2 visible.

    A row belongs to the object of its class whose keypoints lie where the row has them; what was
    labelled from other poses or keypoints, or in another format, belongs to none.

    Args:
        text: of the file.
        objects: labels in pixels.
        width: of the image, pixels.
        height: of the image, pixels.
        first_label: label of the file's class 0.

    Returns:
        None for states, and for parts that no row belongs to.
    """
    rows = [row for row in map(_numbers, text.splitlines()) if row is not None]
    size = np.array([width, height], np.float64)
    found: list[Flags | None] = []
    for item in objects:
        own = [row for row in rows if row[0] + first_label == item.label and item.part is not None]
        gaps = [_gap_px(row, item, size) for row in own]
        place = int(np.argmin(gaps)) if gaps else 0
        fits = bool(gaps) and gaps[place] <= _SAME_PX
        found.append(np.maximum(own[place][7::3], 1).astype(np.float32) if fits else None)
    return tuple(found)


def _numbers(line: str) -> Float64[np.ndarray, "56"] | None:
    try:
        row = np.array(line.split(), np.float64)
    except ValueError:
        return None
    if len(row) != _COLUMNS or not np.isin(row[7::3], (0, 1, 2)).all():
        return None
    return row


def _gap_px(row: Float64[np.ndarray, "56"], item: LabelledObject, size: np.ndarray) -> float:
    """Largest distance of a row's keypoints from the object's; infinite if the row has none."""
    cells = row[5:].reshape(KEYPOINTS, 3)
    inside = cells[:, 2] > 0
    places = cells[inside, :2] * size - 0.5
    gaps = np.linalg.norm(places - item.keypoints[inside, :2].astype(np.float64), axis=1)
    return float(gaps.max(initial=0.0)) if inside.any() and np.isfinite(gaps).all() else np.inf
