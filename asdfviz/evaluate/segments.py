"""How well a run follows the course of an assembly: segments, transitions and completed steps.

Pure functions of label strings. Edit score and F1@k as in MS-TCN (Abu Farha and Gall, CVPR 2019, its
eval.py), POS and delay as in IndustReal (Schoonbeek et al., WACV 2024). Scores in percent, None where
nothing is there to be judged.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

Label = int | None
"""A state; None where the run says none, which is background and no segment."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A run of equal labels, from frame `start` up to but without `end`."""

    label: int
    start: int
    end: int


def segments(labels: Sequence[Label]) -> tuple[Segment, ...]:
    """Cut a label string into its segments; background is left out."""
    found: list[Segment] = []
    start = 0
    for place in range(1, len(labels) + 1):
        if place < len(labels) and labels[place] == labels[start]:
            continue
        label = labels[start]
        if label is not None:
            found.append(Segment(label, start, place))
        start = place
    return tuple(found)


def edit_score(predicted: Sequence[Label], true: Sequence[Label]) -> float | None:
    """100 (1 - Levenshtein / longer length) of the two orders of segments."""
    said, right = ([s.label for s in segments(labels)] for labels in (predicted, true))
    if not right:
        return None
    row = list(range(len(right) + 1))
    for i, label in enumerate(said, start=1):
        before, row[0] = row[0], i
        for j, other in enumerate(right, start=1):
            cost = before if label == other else 1 + min(before, row[j], row[j - 1])
            before, row[j] = row[j], cost
    return 100.0 * (1.0 - row[-1] / max(len(said), len(right)))


def segment_f1(
    predicted: Sequence[Label], true: Sequence[Label], *, overlap: float
) -> float | None:
    """F1 over segments: a predicted one is right if the true one it overlaps most is still free.

    Args:
        predicted: one label a frame.
        true: as long.
        overlap: smallest intersection over union, 0 to 1.
    """
    right = segments(true)
    if not right:
        return None
    said = segments(predicted)
    taken: set[int] = set()
    for segment in said:
        shares = [_overlap(segment, other) for other in right]
        best = int(np.argmax(shares))
        if shares[best] >= overlap and best not in taken:
            taken.add(best)
    return 100.0 * 2 * len(taken) / (len(said) + len(right))


def _overlap(a: Segment, b: Segment) -> float:
    """Intersection over union of two segments of one label; below 0 where they are apart."""
    if a.label != b.label:
        return 0.0
    return (min(a.end, b.end) - max(a.start, b.start)) / (max(a.end, b.end) - min(a.start, b.start))


@dataclass(frozen=True, slots=True)
class Transition:
    """A true change of state and when the run followed."""

    frame: int
    before: int
    after: int
    delay: int | None
    """Frames that the run is late, below 0 where it is early; None where it never followed."""


def transitions(
    predicted: Sequence[Label], true: Sequence[int], frames: Sequence[int]
) -> tuple[tuple[Transition, ...], int]:
    """Match every true transition with the run's nearest entry into the same state.

    Looked for between the start of the state before and the end of the state after. A frame without
    a state counts as the last one that was said.

    Returns:
        The true transitions, and how many changes of the run belong to none of them.
    """
    said = _held(predicted)
    entries = [i for i in range(len(said)) if i == 0 or said[i] != said[i - 1]]
    # The first state that is said is no change of one.
    changes = [i for i in entries if i > 0 and said[i - 1] is not None]
    right = segments(true)
    used: set[int] = set()
    found: list[Transition] = []
    for old, new in pairwise(right):
        fitting = [
            place
            for place in entries
            if said[place] == new.label and old.start <= place < new.end and place not in used
        ]
        place = min(fitting, key=lambda p: abs(p - new.start), default=None)
        if place is not None:
            used.add(place)
        delay = None if place is None else frames[place] - frames[new.start]
        found.append(Transition(frames[new.start], old.label, new.label, delay))
    return tuple(found), len(set(changes) - used)


def _held(labels: Sequence[Label], *, start: Label = None) -> list[Label]:
    held: list[Label] = []
    for label in labels:
        start = start if label is None else label
        held.append(start)
    return held


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the procedure that was done (its number) or undone (its number below 0)."""

    step: int
    frame: int


def steps(
    labels: Sequence[Label], frames: Sequence[int], *, start: Label = None
) -> tuple[Step, ...]:
    """The procedure that a label string tells: going from state a to b does a+1 to b, back undoes.

    Args:
        labels: one a frame; a frame without a state counts as the last one that was said.
        frames: their numbers.
        start: the state of frames before anything is said; None where nobody knows it, then the
            first state that is said is no step.
    """
    found: list[Step] = []
    held = _held(labels, start=start)
    for before, after, frame in zip(held, held[1:], frames[1:], strict=False):
        if before is None or after is None:
            continue
        done = range(before + 1, after + 1)
        undone = (-step for step in range(before, after, -1))
        found += [Step(step, frame) for step in (*done, *undone)]
    return tuple(found)


NO_DELAY = 100.0
"""Frames that IndustReal's psr_utils.py counts where no step was recognised."""


@dataclass(frozen=True, slots=True)
class ProcedureScores:
    """IndustReal's figures of procedure step recognition."""

    pos: float | None
    """Procedure order similarity, percent."""
    f1: float | None
    delay: float | None
    """Mean frames from a true step to its recognition, over the recognised ones, or NO_DELAY."""


def procedure_scores(said: Sequence[Step], right: Sequence[Step]) -> ProcedureScores:
    """POS, F1 and delay as IndustReal's psr_utils.py defines them.

    A step that is said before it is done is a false positive; a true step is missed (a false
    negative) where its step is said fewer times than it was done. Each true step takes the nearest
    entry of its step from then on; their own matching does so only where a step is done and said
    once, and can pair different steps where it repeats.
    """
    if not right:
        return ProcedureScores(None, None, None)
    order = damerau_levenshtein([s.step for s in right], [s.step for s in said])
    free = list(said)
    delays: list[int] = []
    for true in right:
        later = [s for s in free if s.step == true.step and s.frame >= true.frame]
        if later:
            first = min(later, key=lambda s: s.frame)
            free.remove(first)
            delays.append(first.frame - true.frame)
    done, found = (Counter(s.step for s in side) for side in (right, said))
    missed = (done - found).total()
    return ProcedureScores(
        pos=100.0 * (1.0 - min(order / len(right), 1.0)),
        f1=100.0 * 2 * len(delays) / (len(delays) + len(said) + missed),
        delay=float(np.mean(delays)) if delays else NO_DELAY,
    )


def damerau_levenshtein(a: Sequence[Hashable], b: Sequence[Hashable]) -> int:
    """Unrestricted Damerau-Levenshtein distance: insert, delete, transpose 1, substitute 2.

    Lowrance and Wagner (1975), with the costs of IndustReal.
    """
    table = np.zeros((len(a) + 1, len(b) + 1), dtype=int)
    table[:, 0], table[0] = np.arange(len(a) + 1), np.arange(len(b) + 1)
    last_row: dict[Hashable, int] = {}
    for i, x in enumerate(a, start=1):
        last_column = 0
        for j, y in enumerate(b, start=1):
            ways = [
                int(table[i - 1, j - 1]) + (0 if x == y else 2),
                int(table[i - 1, j]) + 1,
                int(table[i, j - 1]) + 1,
            ]
            row = last_row.get(y, 0)
            if row and last_column:
                between = (i - row - 1) + (j - last_column - 1)
                ways.append(int(table[row - 1, last_column - 1]) + between + 1)
            table[i, j] = min(ways)
            if x == y:
                last_column = j
        last_row[x] = i
    return int(table[-1, -1])
