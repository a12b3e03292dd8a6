"""Segment scores against MS-TCN's and IndustReal's definitions, written out again or searched for."""

from __future__ import annotations

import heapq
import random
from collections.abc import Sequence

import pytest

from asdfviz.evaluate.segments import (
    Segment,
    Step,
    Transition,
    damerau_levenshtein,
    edit_score,
    procedure_scores,
    segment_f1,
    segments,
    steps,
    transitions,
)


def random_labels(rng: random.Random, count: int, *, states: int = 4) -> list[int]:
    labels: list[int] = []
    while len(labels) < count:
        labels += [rng.randrange(states)] * rng.randint(1, 6)
    return labels[:count]


def runs_of(labels: Sequence[int | None]) -> list[tuple[int, set[int]]]:
    """Segments as sets of frames."""
    found: list[tuple[int | None, set[int]]] = []
    for frame, label in enumerate(labels):
        if found and found[-1][0] == label:
            found[-1][1].add(frame)
        else:
            found.append((label, {frame}))
    return [(label, frames) for label, frames in found if label is not None]


def edits(a: tuple[int, ...], b: tuple[int, ...]) -> int:
    """Levenshtein distance by its recursive definition."""
    if not a or not b:
        return len(a) + len(b)
    if a[-1] == b[-1]:
        return edits(a[:-1], b[:-1])
    return 1 + min(edits(a[:-1], b), edits(a, b[:-1]), edits(a[:-1], b[:-1]))


@pytest.mark.parametrize("seed", range(20))
def test_random_label_strings(seed: int) -> None:
    rng = random.Random(seed)
    true = random_labels(rng, 24)
    said: list[int | None] = [*random_labels(rng, 24)]
    if seed % 2:
        said[5:8] = [None] * 3
    orders = [tuple(label for label, _ in runs_of(labels)) for labels in (said, true)]
    longer = max(map(len, orders))
    assert edit_score(said, true) == pytest.approx(100 * (1 - edits(*orders) / longer), abs=1e-9)
    for overlap in (0.1, 0.25, 0.5):
        right, taken, tp = runs_of(true), set[int](), 0
        for label, frames in runs_of(said):
            shares = [len(frames & f) / len(frames | f) * (label == other) for other, f in right]
            best = shares.index(max(shares))
            if shares[best] >= overlap and best not in taken:
                taken.add(best)
                tp += 1
        fp, fn = len(runs_of(said)) - tp, len(right) - tp
        precision, recall = tp / (tp + fp), tp / (tp + fn)
        f1 = 2 * precision * recall / (precision + recall) if tp else 0.0
        assert segment_f1(said, true, overlap=overlap) == pytest.approx(100 * f1, abs=1e-9)


def test_segments() -> None:
    assert segments([1, 1, None, 2]) == (Segment(1, 0, 2), Segment(2, 3, 4))
    assert segments([]) == ()
    assert edit_score([], []) is None
    assert segment_f1([None, None], [0, 1], overlap=0.1) == 0
    assert edit_score([None, None], [0, 1]) == 0


def searched_distance(a: tuple[int, ...], b: tuple[int, ...]) -> int:
    """Cheapest way from a to b by insert, delete, swap (1) and substitute (2): Dijkstra's search."""
    letters, longest = sorted({*a, *b}), max(len(a), len(b)) + 1
    queue, done = [(0, a)], set[tuple[int, ...]]()
    while queue:
        cost, text = heapq.heappop(queue)
        if text == b:
            return cost
        if text in done:
            continue
        done.add(text)
        for i in range(len(text) + 1):
            after = text[i + 1 :]
            if len(text) < longest:
                for x in letters:
                    heapq.heappush(queue, (cost + 1, (*text[:i], x, *text[i:])))
            if i < len(text):
                heapq.heappush(queue, (cost + 1, (*text[:i], *after)))
                for x in letters:
                    heapq.heappush(queue, (cost + 2, (*text[:i], x, *after)))
            if i + 1 < len(text):
                swapped = (*text[:i], text[i + 1], text[i], *text[i + 2 :])
                heapq.heappush(queue, (cost + 1, swapped))
    raise AssertionError


@pytest.mark.parametrize("seed", range(25))
def test_damerau_levenshtein(seed: int) -> None:
    rng = random.Random(seed)
    a, b = (tuple(rng.randrange(3) for _ in range(rng.randint(0, 5))) for _ in range(2))
    assert damerau_levenshtein(a, b) == searched_distance(a, b)


@pytest.mark.parametrize(
    ("said", "expected", "false"),
    [
        ([0, 0, 0, 1, 1, 2, 2, 2], [0, 0], 0),
        ([0, 1, 1, 1, 1, 1, 1, 2], [-2, 2], 0),
        ([0, 0, 0, 1, 1, 1, 1, 1], [0, None], 0),
        ([1, 1, 1, 1, 1, 2, 2, 2], [-3, 0], 0),  # it says 1 from the start
        ([0, 1, 0, 1, 1, 2, 2, 2], [0, 0], 2),  # 1 for a frame, and back
        ([0, 0, None, 1, None, 2, 2, 2], [0, 0], 0),
        ([None] * 8, [None, None], 0),
        ([0, 0, 0, 1, 1, 2, 1, 1], [0, 0], 1),
    ],
)
def test_transitions(said: list[int | None], expected: list[int | None], false: int) -> None:
    true = [0, 0, 0, 1, 1, 2, 2, 2]
    found, others = transitions(said, true, range(10, 18))
    assert [t.delay for t in found] == expected
    assert found[0] == Transition(13, 0, 1, expected[0])
    assert others == false


def test_delays_are_in_frame_numbers() -> None:
    found, _ = transitions([0, 0, 0, 1], [0, 1, 1, 1], [0, 10, 20, 30])
    assert found[0].delay == 20


def test_steps_of_a_procedure() -> None:
    assert steps([0, 0, 2, 2, 1], range(5)) == (Step(1, 2), Step(2, 2), Step(-2, 4))
    assert steps([None, 0, None, 1], range(4)) == (Step(1, 3),)
    assert steps([None, 2], range(2)) == ()
    assert steps([None, 2], range(2), start=1) == (Step(2, 1),)
    assert steps([2, None], range(2), start=1) == ()


def test_procedure_scores_by_hand() -> None:
    right = [Step(1, 10), Step(2, 20), Step(3, 30), Step(4, 40)]
    # 1 late by 2, 3 before 2 (a transposition), 2 late by 8, 4 too early: wrong.
    said = [Step(1, 12), Step(3, 26), Step(2, 28), Step(4, 39)]
    scores = procedure_scores(said, right)
    assert scores.pos == pytest.approx(100 * (1 - 1 / 4))
    # 3 was said at 26 though done at 30: wrong as well. Two are right, two wrong, none is missed.
    assert scores.f1 == pytest.approx(100 * 2 * 2 / (2 * 2 + 2 + 0))
    assert scores.delay == pytest.approx((2 + 8) / 2)
    no_steps = procedure_scores(said, [])
    assert (no_steps.pos, no_steps.f1, no_steps.delay) == (None, None, None)
    nothing = procedure_scores([], right)
    assert (nothing.pos, nothing.f1, nothing.delay) == (0, 0, 100), "as in psr_utils.py"
    assert procedure_scores([Step(9, i) for i in range(12)], right).pos == 0


@pytest.mark.parametrize("seed", range(10))
def test_random_procedures(seed: int) -> None:
    """Steps that are done and said at most once, counted one by one."""
    rng = random.Random(seed)
    done = {step: rng.randrange(100) for step in rng.sample(range(9), 6)}
    found = {step: rng.randrange(100) for step in rng.sample(range(9), 6)}
    right, said = (
        [Step(step, frame) for step, frame in sorted(side.items(), key=lambda item: item[1])]
        for side in (done, found)
    )
    tp = [found[step] - done[step] for step in found if step in done and found[step] >= done[step]]
    fp, fn = len(found) - len(tp), len(done.keys() - found.keys())
    scores = procedure_scores(said, right)
    assert scores.f1 == pytest.approx(100 * 2 * len(tp) / (2 * len(tp) + fp + fn), abs=1e-9)
    assert scores.delay == pytest.approx(sum(tp) / len(tp) if tp else 100, abs=1e-9)


def test_a_repeated_step_takes_the_nearest_later_one() -> None:
    right = [Step(1, 10), Step(-1, 20), Step(1, 30)]
    said = [Step(1, 11), Step(-1, 25), Step(1, 33)]
    scores = procedure_scores(said, right)
    assert (scores.pos, scores.f1, scores.delay) == (100, 100, 3)


def test_the_first_state_that_is_said_is_no_false_change() -> None:
    found, false = transitions([None, 0, 0, 1, 1], [0, 0, 0, 1, 1], range(5))
    assert false == 0
    assert [t.delay for t in found] == [0]
    assert transitions([None, 2, 0, 1, 1], [0, 0, 0, 1, 1], range(5))[1] == 1
