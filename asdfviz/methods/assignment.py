"""Gives detections to parts by name: which box is which part, and identical parts told apart.

Each part is there once and each box shows one thing, so all boxes and all parts are matched at once,
by what the network thinks each box might be and by the sizes that depth allows: a box that looks most
like a part that lies elsewhere goes to the next likely one. Identical parts share a class; they keep
their names by staying near where they were in the previous frame. Where different ones share it, such
as bolts of two lengths, each box goes to one that it is small enough for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection
from asdfviz.geometry.boxes import box_middle, iou_matrix, overlap
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.shapes import Box
from asdfviz.state.twins import twin_groups

MAX_OVERLAP = 0.5
"""Two boxes of a class that overlap more (intersection over union) are one object."""
SAME_PLACE = 0.6
"""So are two boxes of different classes: two parts seldom fill one box,"""
COVERED = 0.85
"""and hardly ever one as nearly as this;"""
OWN_SHARE = 0.5
"""below that, where the weaker one scores at least this share of the other, it is another part."""
LEAST = 0.03
"""A part is never given a thing that its class scores less than this in."""
UNFIT = 0.05
"""Share of its score that a class keeps where the box is too large for the part."""

Fitting: TypeAlias = Callable[[Box], Collection[str]]
"""The parts that a box is small enough for."""
TOO_LARGE = 1e6
"""Cost of a box that is too large for a part, against pixels from where the part was;"""
LARGER_PART = 20.0
"""and of one that the next smaller part fills as well."""


@dataclass(slots=True, eq=False)
class _Thing:
    """One object in the picture: all boxes in its place, and the best one for every class."""

    best: Detection
    score: float
    """Of its best box, less where that is too large for the class."""
    boxes: list[Detection] = field(default_factory=list[Detection])
    of_class: dict[str, Detection] = field(default_factory=dict[str, Detection])


def assign_detections(
    detections: Sequence[Detection],
    assembly: Assembly,
    *,
    previous: Mapping[str, Box] | None = None,
    fitting: Fitting | None = None,
    by_class: bool = False,
) -> dict[str, Detection]:
    """Return the detection of every part that was found, labelled and scored as that part.

    Args:
        detections: all boxes of the frame.
        assembly: which parts there are, and which share a detector class.
        previous: each part's last known box. Without it identical parts are named in the order of
            the assembly, from left to right.
        fitting: which parts boxes are small enough for; left out, for all.
        by_class: every class takes its best boxes, as in the paper, also where two classes see their
            part in one place.
    """
    names: dict[str, list[str]] = {}
    for part in assembly.parts.values():
        names.setdefault(part.detector_class, []).append(part.name)
    counts = {label: len(of) for label, of in names.items()}
    if by_class:
        matched = {label: _best_of(label, detections, count) for label, count in counts.items()}
    else:
        things = _things([d for d in detections if d.label in names], names, fitting)
        matched = _matched(things, counts)
    assigned: dict[str, Detection] = {}
    for label, boxes in matched.items():
        for kind, own in _by_kind(boxes, _kinds(assembly)[label], previous or {}, fitting):
            assigned.update(_named(own, kind, previous or {}))
    return {name: assigned[name] for name in assembly.parts if name in assigned}


def scores_in_classes(detection: Detection) -> dict[str, float]:
    """How likely a box is each of the classes that may be in its place, its own among them."""
    return {**detection.class_scores, detection.label: detection.score}


def rival_boxes(
    detections: Sequence[Detection], taken: Detection, *, count: int
) -> tuple[Detection, ...]:
    """The next best boxes of the same class that show another object than `taken`, best first."""
    same = sorted((d for d in detections if d.label == taken.label), key=lambda d: -d.score)
    return tuple(_best_apart([taken, *(d for d in same if d is not taken)], count + 1)[1:])


def _things(
    detections: Sequence[Detection], names: Mapping[str, Sequence[str]], fitting: Fitting | None
) -> list[_Thing]:
    """What is in the picture, and how much each class is like each of it."""
    things: list[_Thing] = []
    allowed = {d: fitting(d.box_xyxy) for d in detections} if fitting is not None else {}

    def fit(label: str, detection: Detection, score: float) -> float:
        fits = fitting is None or any(name in allowed[detection] for name in names[label])
        return score * (1 if fits else UNFIT)

    # A class that does not fit must not hide one that does.
    own = [(fit(d.label, d, d.score), d) for d in detections]
    for score, detection in sorted(own, key=lambda one: -one[0]):
        thing = next((t for t in things if _is_one(t, detection, score)), None)
        if thing is None:
            thing = _Thing(detection, score)
            things.append(thing)
        thing.boxes.append(detection)
        _take_in(thing, detection, detection.label, score)
    for thing, beside in zip(things, _beside(things), strict=True):
        for detection in thing.boxes:
            for label in names:
                score = 0.0 if label in beside else detection.class_scores.get(label, 0.0)
                if label != detection.label and score > LEAST:
                    _take_in(thing, detection, label, fit(label, detection, score))
    return things


def _take_in(thing: _Thing, detection: Detection, label: str, score: float) -> None:
    """Note that a box may be of a class, unless another box in its place is more so."""
    known = thing.of_class.get(label)
    if known is None or score > known.score:
        is_own = (label, score) == (detection.label, detection.score)
        thing.of_class[label] = (
            detection if is_own else replace(detection, label=label, score=score)
        )


def _is_one(thing: _Thing, detection: Detection, score: float) -> bool:
    """Whether a box that scores no more than a thing's best one shows that thing."""
    shared = overlap(thing.best.box_xyxy, detection.box_xyxy)
    if thing.best.label == detection.label:
        return shared > MAX_OVERLAP
    is_own = score >= OWN_SHARE * thing.score
    return shared > (COVERED if is_own else SAME_PLACE)


def _beside(things: Sequence[_Thing]) -> list[set[str]]:
    """What else is in the place of each thing: scores of a place are of all that is in it."""
    if not things:
        return []
    boxes = np.stack([thing.best.box_xyxy for thing in things])
    in_place = iou_matrix(boxes, boxes) > SAME_PLACE
    return [
        {t.best.label for t, near in zip(things, row, strict=True) if near and t is not thing}
        for thing, row in zip(things, in_place, strict=True)
    ]


def _matched(things: Sequence[_Thing], counts: Mapping[str, int]) -> dict[str, list[Detection]]:
    """The things of every class, so that the classes' scores are highest in all."""
    slots = [label for label, count in counts.items() for _ in range(count)]
    scores = np.array(
        [
            [t.of_class[label].score if label in t.of_class else 0.0 for t in things]
            for label in slots
        ]
    ).reshape(len(slots), len(things))
    gain: Float64[np.ndarray, "slots things"] = np.where(
        scores > LEAST, np.log(np.maximum(scores, LEAST) / LEAST), 0.0
    )
    found: dict[str, list[Detection]] = {}
    for row, column in cheapest_pairs(-gain):
        if scores[row, column] > LEAST:
            found.setdefault(slots[row], []).append(things[column].of_class[slots[row]])
    return found


def _best_of(label: str, detections: Sequence[Detection], count: int) -> list[Detection]:
    """The best boxes of a class that are different objects."""
    own = [d for d in detections if d.label == label]
    return _best_apart(sorted(own, key=lambda d: -d.score), count)


def _best_apart(candidates: Sequence[Detection], count: int) -> list[Detection]:
    """The `count` best that are different objects."""
    kept: list[Detection] = []
    for candidate in candidates:
        if len(kept) == count:
            break
        if all(overlap(candidate.box_xyxy, other.box_xyxy) <= MAX_OVERLAP for other in kept):
            kept.append(candidate)
    return kept


@functools.lru_cache(maxsize=8)
def _kinds(assembly: Assembly) -> dict[str, list[tuple[str, ...]]]:
    """By class, the parts that have it, identical ones together, the smallest first."""
    kinds: dict[str, list[tuple[str, ...]]] = {}
    parts = assembly.parts
    for names in sorted(twin_groups(assembly), key=lambda names: parts[names[0]].diameter):
        kinds.setdefault(parts[names[0]].detector_class, []).append(names)
    return kinds


def _by_kind(
    boxes: Sequence[Detection],
    kinds: Sequence[tuple[str, ...]],
    previous: Mapping[str, Box],
    fitting: Fitting | None,
) -> list[tuple[tuple[str, ...], list[Detection]]]:
    """The boxes of a class by the kinds of parts that share it, the smallest first: which fit, and were near."""
    if len(kinds) == 1:
        return [(kinds[0], list(boxes))]
    allowed = [None if fitting is None else fitting(box.box_xyxy) for box in boxes]

    def cost(rank: int, name: str, box: Detection, fits: Collection[str] | None) -> float:
        middle = box_middle(box.box_xyxy)
        moved = np.linalg.norm(box_middle(previous[name]) - middle) if name in previous else 0.0
        is_large = fits is not None and name not in fits
        return float(moved) + LARGER_PART * rank + TOO_LARGE * is_large

    slots = [(rank, name) for rank, kind in enumerate(kinds) for name in kind]
    costs = [
        [cost(rank, name, *one) for one in zip(boxes, allowed, strict=True)] for rank, name in slots
    ]
    shares: list[list[Detection]] = [[] for _ in kinds]
    for row, column in cheapest_pairs(np.array(costs)):
        shares[slots[row][0]].append(boxes[column])
    return list(zip(kinds, shares, strict=True))


def _named(
    boxes: Sequence[Detection], parts: Sequence[str], previous: Mapping[str, Box]
) -> dict[str, Detection]:
    if len(parts) == 1 or not boxes:
        return dict(zip(parts, boxes, strict=False))
    from_left = sorted(boxes, key=lambda d: tuple(box_middle(d.box_xyxy)))
    pairs = sorted(
        (float(np.linalg.norm(box_middle(previous[name]) - box_middle(box.box_xyxy))), i, place)
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
