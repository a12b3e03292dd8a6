"""Steps of which some parts are in and others are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly, State
from asdfviz.state.decoding import most_likely_path
from asdfviz.state.fusion import Pose2State
from asdfviz.state.half_done import HalfDone, ways_half_done
from asdfviz.state.smoothing import (
    SmoothingConfig,
    StateFilter,
    transition_matrix,
)


@pytest.fixture(scope="module")
def caliper() -> Assembly:
    return load_assembly("geared_caliper")


def stacked(*steps: tuple[str, ...]) -> Assembly:
    """An assembly whose steps add these parts, all at one place."""
    joined: dict[str, np.ndarray] = {"base": np.eye(4)}
    states = [State(0, "s0", dict(joined))]
    for k, names in enumerate(steps, start=1):
        joined |= {name: np.eye(4) for name in names}
        states.append(State(k, f"s{k}", dict(joined)))
    links = frozenset((k, k + 1) for k in range(len(steps)))
    return Assembly("x", "X", "base", {}, tuple(states), links, (), "assembly.yaml")


def test_only_steps_that_add_several_parts_can_be_half_done(caliper: Assembly) -> None:
    ways = [(a.index, b.index, some) for a, b, some in ways_half_done(caliper)]
    assert ways == [(1, 2, ("pinion",)), (1, 2, ("wheel",))]
    same = HalfDone.of(load_assembly("corner_clamp"))
    assert same.indices == frozenset()
    assert len(same.assembly.states) == len(load_assembly("corner_clamp").states)


def test_half_done_states_have_the_later_places_and_joints(caliper: Assembly) -> None:
    unfolded = HalfDone.of(caliper)
    for index in unfolded.indices:
        state = unfolded.assembly.states[index]
        (new,) = set(state.attached) - set(caliper.states[1].attached)
        assert state.T_base_part[new] is caliper.states[2].T_base_part[new]
        assert state.joints.get(new) is caliper.states[2].joints.get(new)
        assert state.completed == 1
        assert state.index == index
    assert unfolded.assembly.steps == caliper.steps
    assert unfolded.assembly.states[: len(caliper.states)] == caliper.states


def test_what_is_an_error_already_is_not_half_done() -> None:
    assembly = stacked(("a", "b"))
    wrong = State(2, "wrong", {"base": np.eye(4), "a": np.eye(4)}, is_error=True, after=0)
    known = replace(assembly, states=(*assembly.states, wrong))
    assert [some for _, _, some in ways_half_done(known)] == [("b",)]


def losing(*, x: float = 0.0, after: int = 1) -> Assembly:
    """Two parts are joined in one step; with the error, `a` alone is, its place off by `x` metres."""
    assembly, T = stacked(("a", "b")), np.eye(4)
    T[0, 3] = x
    lost = State(2, "lost", {"base": np.eye(4), "a": T}, is_error=True, after=after)
    links = assembly.transitions | {(after, 2), (2, after)}
    return replace(assembly, states=(*assembly.states, lost), transitions=links)


def test_what_comes_off_later_or_sits_elsewhere_takes_no_half_done_state() -> None:
    for assembly in (losing(), losing(x=0.02, after=0)):
        assert [some for _, _, some in ways_half_done(assembly)] == [("a",), ("b",)]
    assert HalfDone.of(losing()).alike == {2: 3}
    assert not HalfDone.of(losing(x=0.02)).alike
    looks = HalfDone.of(losing()).unfolded(np.array([0.1, 0.1, 0.8]))
    assert looks is not None
    assert looks[3] == looks[2]
    for name in ("corner_clamp", "geared_caliper", "screw_clamp", "vise"):
        assert not HalfDone.of(load_assembly(name)).alike


def test_half_done_and_lost_again_are_told_apart_by_what_was_before() -> None:
    ways = HalfDone.of(losing())
    online = StateFilter(ways.assembly, half_done=ways.indices)
    none, half, both = (np.full(5, 0.1) for _ in range(3))
    none[0] = half[[2, 3]] = both[1] = 1.0

    def told(seen: np.ndarray, frames: int) -> list[int]:
        said: list[int] = []
        for _ in range(frames):
            belief = online.step(None, seen / seen.sum())
            assert belief is not None
            said.append(int(ways.summed(belief).argmax()))
        return said

    assert set(told(none, 10) + told(half, 500)) == {0}
    assert told(both, 20)[-1] == 1
    assert set(told(half, 500)[5:]) == {2}
    assert told(both, 20)[-1] == 1


def test_pose2state_too_tells_lost_again_only_after_the_step() -> None:
    fusion = Pose2State(losing())
    none, half, both = (
        np.array(S) for S in ([0.9, 0.05, 0.05], [0.15, 0.05, 0.8], [0.05, 0.9, 0.05])
    )

    def told(seen: np.ndarray, frames: int) -> list[int]:
        said = [fusion.step(None, seen) for _ in range(frames)]
        return [state.index for state in said if state is not None]

    assert told(none, 10) + told(half, 500) == [0] * 510
    assert told(both, 20)[-1] == 1
    assert set(told(half, 500)[5:]) == {2}
    assert told(none, 20)[-1] == 0


def test_three_parts_come_one_after_the_other() -> None:
    unfolded = HalfDone.of(stacked(("a", "b", "c")))
    states, links = unfolded.assembly.states, unfolded.assembly.transitions
    added = {s.index: frozenset(s.attached) - {"base"} for s in states}
    assert len(unfolded.indices) == 6
    for one, other in links - {(0, 1)}:
        assert added[one] < added[other]
        assert len(added[other] - added[one]) == 1
    assert len(links) == 1 + 3 + 6 + 3


def test_probabilities_and_terms_come_back_to_the_state_before(caliper: Assembly) -> None:
    unfolded = HalfDone.of(caliper)
    count = len(caliper.states)
    scores = np.arange(1.0, count + 3)
    summed = unfolded.summed(scores / scores.sum())
    assert summed.sum() == pytest.approx(1.0)
    assert summed[1] == pytest.approx((scores[1] + scores[-1] + scores[-2]) / scores.sum())
    told = unfolded.told(scores)
    assert told is not None
    assert told[1] / told[2] == pytest.approx(scores[-1] / scores[2])
    looks = unfolded.unfolded(np.eye(count)[2])
    assert looks is not None
    assert looks[2] == pytest.approx(2 * looks[-1])
    assert unfolded.unfolded(None) is None
    plain = HalfDone.none(caliper)
    assert plain.summed(scores[:count]) == pytest.approx(scores[:count])


def test_half_done_states_are_found_by_the_step_that_they_count_to(caliper: Assembly) -> None:
    half_done = HalfDone.of(caliper)
    halves = half_done.halves
    assert sorted(s.index for of in halves.values() for s in of) == sorted(half_done.indices)
    for before, states in halves.items():
        assert all(s.after == before for s in states)
    assert HalfDone.none(caliper).halves == {}


def test_half_done_states_last_and_lead_on(caliper: Assembly) -> None:
    unfolded = HalfDone.of(caliper)
    config = SmoothingConfig(leak=0.0, fall=0.0)
    move = transition_matrix(unfolded.assembly, config=config, half_done=unfolded.indices)
    for index in unfolded.indices:
        assert move[index, index] == pytest.approx(config.stay)
        assert move[index, 2] == pytest.approx(1 - config.stay)
        assert move[1, 2] == pytest.approx(config.at_once * move[1, index])
    count = len(unfolded.assembly.states)
    online = StateFilter(unfolded.assembly, config=config, half_done=unfolded.indices)
    online.step(None, np.eye(count)[1])
    pinion = min(unfolded.indices)
    seen = np.full(count, 0.01)
    seen[pinion] = seen[2] = 0.4  # the wheel cannot be seen: neither for nor against
    wheel_out = np.full(count, 0.01)
    wheel_out[pinion] = wheel_out[1] = 0.4
    for _ in range(30):
        online.step(None, seen, wheel_out)
    assert online.belief is not None
    assert int(unfolded.summed(online.belief).argmax()) == 1
    for _ in range(30):
        online.step(None, np.eye(count)[2] + 0.01)
    assert int(unfolded.summed(online.belief).argmax()) == 2


def test_parts_of_one_step_rather_come_one_after_the_other(caliper: Assembly) -> None:
    """The first part is seen to be in, and nothing of the second one."""
    ways = HalfDone.of(caliper)
    seen = np.full(len(ways.assembly.states), 0.01)
    seen[min(ways.indices)] = seen[2] = 1.0
    told: list[float] = []
    for weight in (1.0, 0.1, 0.0):
        online = StateFilter(
            ways.assembly, config=SmoothingConfig(at_once=weight), half_done=ways.indices
        )
        for _ in range(8):
            online.step(None, np.eye(len(seen))[1])
        for _ in range(3):  # to arrive, and to be there
            online.step(None, seen)
        assert online.belief is not None
        told.append(float(online.belief[2] / online.belief[min(ways.indices)]))
    assert told[0] == pytest.approx(1.0, abs=0.05)
    assert told[2] < told[1] < 0.2
    # What no step adds in parts is no rarer.
    plain = HalfDone.none(caliper)
    one, other = (
        transition_matrix(plain.assembly, config=SmoothingConfig(at_once=w)) for w in (1.0, 0.1)
    )
    np.testing.assert_array_equal(one, other)


def test_offline_too_a_part_only_comes_off_after_its_step() -> None:
    ways = HalfDone.of(losing())
    none, half, both = (np.full(5, 0.1) for _ in range(3))
    none[0] = half[[2, 3]] = both[1] = 1.0

    def told(*seen: np.ndarray) -> list[int]:
        path = most_likely_path([None] * len(seen), seen, ways.assembly, half_done=ways.indices)
        assert path is not None
        return [ways.before[state] for state in path]

    assert told(*[half] * 30) == [0] * 30
    # One frame to arrive, and rather late than early.
    assert told(*[none] * 5, *[half] * 30, *[both] * 20) == [0] * 36 + [1] * 19
    assert told(*[both] * 20, *[half] * 30) == [1] * 21 + [2] * 29
