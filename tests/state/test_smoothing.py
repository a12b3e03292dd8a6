from __future__ import annotations

import itertools

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly, State
from asdfviz.errors import MethodError
from asdfviz.state.decoding import LATE, most_likely_path
from asdfviz.state.half_done import HalfDone
from asdfviz.state.smoothing import (
    FOLLOWED,
    SmoothingConfig,
    StateFilter,
    combined,
    transition_matrix,
)


def chain(count: int) -> Assembly:
    states = tuple(State(i, f"s{i}", {"base": np.eye(4)}) for i in range(count))
    return Assembly("chain", "Chain", "base", {}, states, frozenset(), (), "assembly.yaml")


def random_scores(rng: np.random.Generator, count: int) -> np.ndarray:
    scores = rng.random(count) + 0.01
    return scores / scores.sum()


def test_states_follow_the_transitions(assembly: Assembly) -> None:
    move = transition_matrix(assembly, config=SmoothingConfig(stay=0.9, leak=0.0, fall=0.0))
    assert move.sum(axis=1) == pytest.approx(np.ones(5))
    assert move[0] == pytest.approx([0.9, 0.1, 0, 0, 0])
    assert move[3, 3] == pytest.approx(1.0)
    legal = {(a, b) for a, b in assembly.transitions if a != b} | {(0, 1), (1, 2), (2, 3)}
    assert {(int(a), int(b)) for a, b in np.argwhere(move > 0) if a != b} == legal


def test_a_mistake_is_rarer_than_a_step_and_a_fall_rarer_than_a_jump(assembly: Assembly) -> None:
    config = SmoothingConfig(stay=0.9, stay_wrong=0.6, leak=1e-3, fall=1e-5, mistakes=0.25)
    move = transition_matrix(assembly, config=config)
    assert move.sum(axis=1) == pytest.approx(np.ones(5))
    assert move[1, 2] == pytest.approx(0.08, rel=0.01)
    assert move[1, 4] == pytest.approx(0.02, rel=0.02)
    assert move[0, 3] == pytest.approx(move[1, 3], rel=0.01)
    assert move[0, 3] == pytest.approx(100 * move[3, 0], rel=0.01)
    assert move[4, 1] == pytest.approx(0.4, rel=0.01)  # a mistake is undone
    assert move[4, 4] == pytest.approx(0.6, rel=0.01)


def test_an_error_ends_when_nothing_speaks_for_it_and_stays_while_all_does(
    assembly: Assembly,
) -> None:
    wrong, none = np.full(5, 0.05), np.full(5, 0.2)
    wrong[4] = 0.8
    none[3] = 0.19  # parts are seen, and tell 1 and 4 not apart
    online = StateFilter(assembly, config=SmoothingConfig(stay_wrong=0.7))
    online.step(None, np.array([0.05, 0.8, 0.05, 0.05, 0.05]))
    said = [online.step(None, wrong) for _ in range(40)]
    assert all(s is not None and int(s.argmax()) == 4 for s in said[3:])
    after = [online.step(None, none) for _ in range(4)][-1]
    assert after is not None
    assert int(after.argmax()) == 1
    lasting = StateFilter(assembly, config=SmoothingConfig(stay_wrong=0.96))
    for scores in [np.array([0.05, 0.8, 0.05, 0.05, 0.05]), *[wrong] * 40, *[none] * 4]:
        after = lasting.step(None, scores)
    assert after is not None
    assert int(after.argmax()) == 4


def test_lost_sight_of_a_part_does_not_lead_back(assembly: Assembly) -> None:
    """For a while the relative poses of a few parts say what they said two states ago."""
    online = StateFilter(assembly)
    sure, early = np.full(5, 0.02), np.full(5, 0.02)
    sure[3] = early[1] = 0.92
    for _ in range(8):
        online.step(None, sure, sure)
    belief = [online.step(None, early, None) for _ in range(3)][-1]
    assert belief is not None
    assert int(belief.argmax()) == 3
    assert online.belief is not None
    assert np.array_equal(online.belief, belief)


def test_the_group_can_overrule_the_relative_poses(assembly: Assembly) -> None:
    config = SmoothingConfig(pose_weight=0.3)
    online = StateFilter(assembly, config=config)
    places, group = np.full(5, 0.01), np.full(5, 1e-6)
    places[1], group[2] = 0.96, 1.0
    online.step(None, places, None)
    belief = [online.step(None, places, group) for _ in range(4)][-1]
    assert belief is not None
    assert int(belief.argmax()) == 2


@pytest.mark.parametrize(
    ("blank", "alike"), [((), ()), ((2,), ()), ((), (2,)), ((0, 2), (3,)), ((0, 1, 4), ())]
)
def test_the_filter_and_the_path_are_what_all_sequences_say(
    blank: tuple[int, ...], alike: tuple[int, ...]
) -> None:
    """Both against sums and maxima over every possible sequence of states: offline, the order is that of
    the most likely one that ends where the filter does, and changes are where least frames are wrong by
    expectation, those that are named too early counted `LATE` times.

    Where nothing is seen, or all states are equally likely, no state changes.
    """
    assembly, rng = chain(3), np.random.default_rng(5)
    config = SmoothingConfig(stay=0.7, leak=0.05)
    looks = [None if i in blank else random_scores(rng, 3) for i in range(5)]
    poses = [None if i in (2, *blank) else random_scores(rng, 3) for i in range(5)]
    for i in alike:
        looks[i], poses[i] = np.full(3, 1 / 3), None
    move = transition_matrix(assembly, config=config)
    evidence = [combined(a, p, config=config) for a, p in zip(looks, poses, strict=True)]
    first = next(i for i, seen in enumerate(evidence) if seen is not None)
    weights: dict[tuple[int, ...], float] = {}
    for path in itertools.product(range(3), repeat=5):
        weight = 1.0
        for i, state in enumerate(path):
            is_silent = i in (*blank, *alike) or i <= first
            step = np.eye(3) if is_silent else move
            seen = evidence[i]
            weight *= 1.0 if i == 0 else float(step[path[i - 1], state])
            weight *= 1.0 if seen is None else float(seen[state])
        weights[path] = weight
    last = np.zeros(3)
    for path, weight in weights.items():
        last[path[-1]] += weight
    online = StateFilter(assembly, config=config)
    belief = None
    for a, p in zip(looks, poses, strict=True):
        belief = online.step(a, p)
    assert belief == pytest.approx(last / last.sum())
    ending = [path for path in weights if path[-1] == int(last.argmax())]
    best = max(ending, key=lambda path: weights[path])
    order = [state for state, _ in itertools.groupby(best)]
    share = np.zeros((5, 3))
    for path, weight in weights.items():
        share[range(5), path] += weight / sum(weights.values())
    placed = [p for p in weights if [state for state, _ in itertools.groupby(p)] == order]
    worth = np.where(np.tri(3, 3, -1) > 0, LATE, 1.0) - np.eye(
        3
    )  # of naming a frame so, were it so
    least = min(placed, key=lambda path: float((worth[list(path)] * share).sum()))
    assert most_likely_path(looks, poses, assembly, config=config) == list(least)


def test_a_lasting_confusion_with_a_far_state_does_not_move_the_belief() -> None:
    assembly = chain(6)
    online = StateFilter(assembly)
    sure, wrong = np.full(6, 0.02), np.full(6, 0.02)
    sure[1] = wrong[5] = 0.9
    for _ in range(10):
        online.step(sure, sure)
    online.step(wrong, None)
    belief = online.step(wrong, None)
    assert belief is not None
    assert int(belief.argmax()) == 1


def test_a_true_step_is_followed_within_two_frames_and_found_exactly_offline() -> None:
    assembly = chain(4)
    scores = [np.full(4, 0.08) for _ in range(24)]
    truth = [0] * 12 + [1] * 12
    for row, state in zip(scores, truth, strict=True):
        row[state] = 0.76
    online = StateFilter(assembly)
    said = [int(b.argmax()) for row in scores if (b := online.step(row, row)) is not None]
    assert said[:12] == truth[:12]
    assert said[14:] == truth[14:]
    assert most_likely_path(scores, scores, assembly) == truth
    silent = [None] * len(scores)
    assert most_likely_path(silent, silent, assembly, group_fit=scores) == truth


def test_nothing_seen_is_nothing_known() -> None:
    assembly = chain(3)
    online = StateFilter(assembly)
    assert online.step(None, None) is None
    assert most_likely_path([None, None], [None, None], assembly) is None
    first = online.step(np.array([0.1, 0.8, 0.1]), None)
    assert first is not None
    online.reset()
    assert online.step(None, None) is None
    with pytest.raises(MethodError, match="all cover the same frames"):
        most_likely_path([None], [], assembly)


@pytest.mark.parametrize("name", ["vise", "corner_clamp"])
@pytest.mark.parametrize("uniform", [True, False])
def test_nothing_seen_for_long_says_the_same_state(name: str, *, uniform: bool) -> None:
    """A covered camera does not go on through the assembly."""
    ways = HalfDone.of(load_assembly(name))
    online = StateFilter(ways.assembly, config=FOLLOWED, half_done=ways.indices)
    count = len(ways.assembly.states)
    sure = np.full(count, 1e-6)
    sure[1] = 1.0
    before = [online.step(None, sure / sure.sum()) for _ in range(30)][-1]
    assert before is not None
    nothing = np.full(count, 1 / count) if uniform else None
    after = [online.step(nothing, nothing) for _ in range(100)][-1]
    assert after is not None
    assert np.array_equal(after, before)
    path = most_likely_path([sure, *[nothing] * 100], [None] * 101, ways.assembly, config=FOLLOWED)
    assert path == [1] * 101


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stay", 1.5),
        ("stay_wrong", -0.1),
        ("leak", 2.0),
        ("fall", -1e-6),
        ("mistakes", float("nan")),
        ("pose_weight", -1.0),
        ("place_weight", float("inf")),
        ("floor", 0.0),
        ("floor", 1.1),
    ],
)
def test_options_out_of_range_are_named(name: str, value: float) -> None:
    with pytest.raises(MethodError, match=rf"smoothing\.{name} is"):
        SmoothingConfig(**{name: value})  # pyright: ignore[reportArgumentType]
