"""The frame in which a part arrives looks like the next state and counts to the one before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.geometry.transforms import transform_from
from asdfviz.state.arrivals import Arrivals
from asdfviz.state.decoding import most_likely_path
from asdfviz.state.half_done import HalfDone
from asdfviz.state.smoothing import SmoothingConfig, StateFilter


@pytest.fixture
def clamp() -> Assembly:
    """Base; jaw; jaw and bolt; with the error of a jaw that is turned, which leads back to the base."""
    return load_assembly("corner_clamp")


def sure_of(clamp: Assembly, seen: list[int]) -> list[np.ndarray]:
    return [np.eye(len(clamp.states))[state] + 0.001 for state in seen]


def told_online(clamp: Assembly, seen: list[int], *, arrival: bool) -> tuple[list[int], list[int]]:
    """The most probable state of every frame, and what it looks like."""
    model, told = StateFilter(clamp, config=SmoothingConfig(arrival=arrival)), list[int]()
    shown: list[int] = []
    for scores in sure_of(clamp, seen):
        belief = model.step(scores, scores, scores)
        assert belief is not None
        assert model.shown is not None
        assert belief.sum() == pytest.approx(1.0)
        assert model.shown.sum() == pytest.approx(1.0)
        told.append(int(belief.argmax()))
        shown.append(int(model.shown.argmax()))
    return told, shown


def test_a_part_is_joined_from_the_frame_after_that_in_which_it_arrives(clamp: Assembly) -> None:
    seen = [0] * 5 + [1] * 6 + [2] * 4
    late = [0] * 6 + [1] * 6 + [2] * 3
    assert told_online(clamp, seen, arrival=True) == (late, seen)
    assert told_online(clamp, seen, arrival=False) == (seen, seen)
    scores = sure_of(clamp, seen)
    assert most_likely_path(scores, scores, clamp) == late
    without = SmoothingConfig(arrival=False)
    assert most_likely_path(scores, scores, clamp, config=without) == seen


def test_what_begins_to_move_is_no_longer_joined(clamp: Assembly) -> None:
    wrong = clamp.errors[0].index
    seen = [0] * 5 + [wrong] * 6 + [0] * 4
    late = [0] * 6 + [wrong] * 5 + [0] * 4
    assert told_online(clamp, seen, arrival=True) == (late, seen)
    scores = sure_of(clamp, seen)
    assert most_likely_path(scores, scores, clamp) == late


def test_a_part_that_is_put_elsewhere_arrives_too(clamp: Assembly) -> None:
    first, second, *_ = clamp.states
    shift = transform_from(np.eye(3), np.array([0.0, 0.0, 0.02]))
    places = {n: T if n == clamp.base else shift @ T for n, T in second.T_base_part.items()}
    states = (first, second, replace(second, index=2, T_base_part=places))
    moved = replace(clamp, states=states, transitions=frozenset({(0, 1), (1, 2)}))
    scores = [np.eye(3)[state] + 0.001 for state in [0, 0, 1, 1, 1, 2, 2, 2]]
    assert most_likely_path(scores, scores, moved) == [0, 0, 0, 1, 1, 1, 2, 2]


def test_every_way_on_which_parts_arrive_keeps_its_probability(clamp: Assembly) -> None:
    move = np.array([[0.7, 0.2, 0.0, 0.1], [0, 0.9, 0.1, 0], [0, 0, 1, 0], [0.5, 0, 0, 0.5]])
    model = Arrivals.of(clamp, move, [(0, 1), (0, 3), (1, 2), (3, 0)])
    assert model.before.tolist() == [0, 1, 2, 3, 0, 0, 1]
    assert model.shown.tolist() == [0, 1, 2, 3, 1, 3, 2]
    assert model.move.sum(axis=1) == pytest.approx(np.ones(7))
    assert model.move[0].tolist() == [0.7, 0, 0, 0, 0.2, 0.1, 0]
    assert model.move[3].tolist() == [*move[3].tolist(), 0, 0, 0]
    assert model.move[4].tolist() == model.move[1].tolist()  # it goes on from there
    belief = np.array([0.1, 0.0, 0.0, 0.2, 0.4, 0.3, 0.0])
    assert model.counted(belief) == pytest.approx([0.8, 0, 0, 0.2])
    assert model.seen(belief) == pytest.approx([0.1, 0.4, 0, 0.5])
    assert model.begun(np.ones(4)).tolist() == [1, 1, 1, 1, 0, 0, 0]


def test_half_done_steps_arrive_as_well() -> None:
    ways = HalfDone.of(load_assembly("geared_caliper"))
    half, count = min(ways.indices), len(ways.before)
    scores = [np.eye(count)[state] + 0.001 for state in [1, 1, half, half, half, 2, 2, 2]]
    path = most_likely_path(scores, scores, ways.assembly, half_done=ways.indices)
    assert path is not None
    assert [ways.before[state] for state in path] == [1] * 6 + [2] * 2
