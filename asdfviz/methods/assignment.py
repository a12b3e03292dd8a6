"""Gives detections to parts by name: the best box of each class, and identical parts told apart.

Each part is there once, so a second box of its class is a false one, and so is one that a surer box
of another class fills. Identical parts share a class; they keep their names by staying near where
they were in the previous frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from asdfviz.datatypes import Assembly, Detection
from asdfviz.geometry.shapes import Box

MAX_OVERLAP = 0.5
"""Two boxes of a class that overlap more (intersection over union) are one object."""
SAME_PLACE = 0.7
"""So are two boxes of different parts: then the surer class is right. Two parts never fill one box."""
SURER = 1.5
"""By this factor its score must be higher."""


def assign_detections(
    detections: Sequence[Detection],
    assembly: Assembly,
    *,
    previous: Mapping[str, Box] | None = None,
) -> dict[str, Detection]:
    """Return the detection of every part that was found.

    Args:
        detections: all boxes of the frame.
        assembly: which parts there are, and which share a detector class.
        previous: each part's last known box. Without it identical parts are named in the order of
            the assembly, from left to right.
    """
    names: dict[str, list[str]] = {}
    for part in assembly.parts.values():
        names.setdefault(part.detector_class, []).append(part.name)
    assigned: dict[str, Detection] = {}
    of_parts = [d for d in detections if d.label in names]
    for label, parts in names.items():
        candidates = sorted(
            (d for d in of_parts if d.label == label and not _is_doubted(d, of_parts)),
            key=lambda d: d.score,
            reverse=True,
        )
        boxes = _best_apart(candidates, len(parts))
        assigned.update(_named(boxes, parts, previous or {}))
    return {name: assigned[name] for name in assembly.parts if name in assigned}


def rival_boxes(
    detections: Sequence[Detection], taken: Detection, *, count: int
) -> tuple[Detection, ...]:
    """The next best boxes of the same class that show another object than `taken`, best first."""
    same = sorted((d for d in detections if d.label == taken.label), key=lambda d: -d.score)
    return tuple(_best_apart([taken, *(d for d in same if d is not taken)], count + 1)[1:])


def _is_doubted(detection: Detection, others: Sequence[Detection]) -> bool:
    """Whether a surer box of another class fills the same place."""
    return any(
        other.label != detection.label
        and other.score > SURER * detection.score
        and overlap(other.box_xyxy, detection.box_xyxy) > SAME_PLACE
        for other in others
    )


def _best_apart(candidates: Sequence[Detection], count: int) -> list[Detection]:
    """The `count` best that are different objects."""
    kept: list[Detection] = []
    for candidate in candidates:
        if len(kept) == count:
            break
        if all(overlap(candidate.box_xyxy, other.box_xyxy) <= MAX_OVERLAP for other in kept):
            kept.append(candidate)
    return kept


def _named(
    boxes: Sequence[Detection], parts: Sequence[str], previous: Mapping[str, Box]
) -> dict[str, Detection]:
    if len(parts) == 1 or not boxes:
        return dict(zip(parts, boxes, strict=False))
    from_left = sorted(boxes, key=lambda d: tuple(_center(d.box_xyxy)))
    pairs = sorted(
        (float(np.linalg.norm(_center(previous[name]) - _center(box.box_xyxy))), i, place)
        for i, name in enumerate(parts)
        if name in previous
        for place, box in enumerate(from_left)
    )
    box_of: dict[int, int] = {}
    for _, i, place in pairs:  # nearest pair first
        if i not in box_of and place not in box_of.values():
            box_of[i] = place
    free_parts = [i for i in range(len(parts)) if i not in box_of]
    free_boxes = [place for place in range(len(boxes)) if place not in box_of.values()]
    box_of.update(zip(free_parts, free_boxes, strict=False))
    return {parts[i]: from_left[place] for i, place in box_of.items()}


def _center(box_xyxy: Box) -> np.ndarray:
    return (box_xyxy[:2] + box_xyxy[2:]) / 2


def overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes, 0 to 1."""
    extent = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    if (extent <= 0).any():
        return 0.0
    both = float(extent.prod())
    return both / float((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - both)
