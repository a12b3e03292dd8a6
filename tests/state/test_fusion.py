from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, State
from asdfviz.errors import MethodError
from asdfviz.state.fusion import FusionConfig, Pose2State, neighbours


def chain(count: int) -> Assembly:
    states = tuple(State(i, f"s{i}", {"base": np.eye(4)}) for i in range(count))
    transitions = frozenset((i, i + 1) for i in range(count - 1))
    return Assembly("chain", "Chain", "base", {}, states, transitions, (), "assembly.yaml")


def peak(index: int, count: int = 5, height: float = 0.8) -> np.ndarray:
    scores = np.full(count, (1 - height) / (count - 1))
    scores[index] = height
    return scores


def test_looks_of_the_state_network_weigh_more() -> None:
    config = FusionConfig(w_dl=0.2, w_p=0.8, w_places=0.7)
    assert config.chosen(places=False) == config
    assert config.chosen(places=True).w_dl == 0.7
    looks, places = np.array([0.9, 0.1]), np.array([0.2, 0.8])
    told = Pose2State(chain(2), config=config).step(looks, places)
    surer = Pose2State(chain(2), config=config.chosen(places=True)).step(looks, places)
    assert told is not None
    assert surer is not None
    assert told.probabilities.argmax() == 1
    assert surer.probabilities.argmax() == 0


def test_errors_are_less_likely_than_steps_where_the_state_network_tells_the_looks(
    assembly: Assembly,
) -> None:
    config = FusionConfig(error_odds_places=0.25, sharpness=1.0)
    even = np.full(len(assembly.states), 1 / len(assembly.states))
    odds = np.array([0.25 if state.is_error else 1.0 for state in assembly.states])
    for places, weighed in ((False, even), (True, odds / odds.sum())):
        told = Pose2State(assembly, config=config.chosen(places=places)).step(None, even)
        assert told is not None
        assert told.probabilities == pytest.approx(weighed)
    with pytest.raises(MethodError, match="error_odds_places is 0"):
        FusionConfig(error_odds_places=0.0)


def test_the_first_frame_is_the_weighted_sum_of_its_own_terms(assembly: Assembly) -> None:
    fusion = Pose2State(assembly, config=FusionConfig(w_dl=0.3, w_p=0.9, sharpness=1.0))
    estimate = fusion.step(peak(1), peak(2))
    assert estimate is not None
    assert estimate.probabilities == pytest.approx(0.25 * peak(1) + 0.75 * peak(2))
    assert set(estimate.terms) == {"appearance", "relative_pose"}


def test_a_later_frame_follows_equations_3_to_5(assembly: Assembly) -> None:
    config = FusionConfig(0.4, 0.6, 0.3, 0.7, neighbour=0.1, sharpness=1.0)
    fusion = Pose2State(assembly, config=config)
    first = fusion.step(peak(1), None)
    second = fusion.step(peak(2), peak(3))
    assert first is not None
    assert second is not None
    P = first.probabilities
    # States 0 to 3 in a row, error 4 beside state 1; sums written out by hand.
    carried = np.array(
        [
            0.9 * P[0] + 0.1 * P[1],
            0.7 * P[1] + 0.1 * (P[0] + P[2] + P[4]),
            0.8 * P[2] + 0.1 * (P[1] + P[3]),
            0.9 * P[3] + 0.1 * P[2],
            0.9 * P[4] + 0.1 * P[1],
        ]
    )
    expected = 0.3 * (0.4 * peak(2) + 0.6 * peak(3)) + 0.7 * carried
    assert second.terms["previous"] == pytest.approx(carried)
    assert second.probabilities == pytest.approx(expected)
    assert second.probabilities.sum() == pytest.approx(1.0)


def test_what_is_told_is_sharper_than_what_goes_on(assembly: Assembly) -> None:
    plain = Pose2State(assembly, config=FusionConfig(sharpness=1.0))
    sharp = Pose2State(assembly, config=FusionConfig(sharpness=2.0))
    for place in (1, 2, 2):
        expected, told = (f.step(peak(place), peak(2)) for f in (plain, sharp))
        assert expected is not None
        assert told is not None
        squares = expected.probabilities**2
        assert told.probabilities == pytest.approx(squares / squares.sum())
        assert sharp.belief == pytest.approx(expected.probabilities)


def test_before_any_evidence_the_state_is_unknown(assembly: Assembly) -> None:
    fusion = Pose2State(assembly)
    assert fusion.step(None, None) is None
    assert fusion.step(None, peak(2)) is not None


@pytest.mark.parametrize("missing", ["appearance", "relative_pose"])
def test_one_term_alone_takes_the_whole_weight_of_the_first_frame(
    assembly: Assembly, missing: str
) -> None:
    fusion = Pose2State(assembly, config=FusionConfig(sharpness=1.0))
    estimate = fusion.step(*((None, peak(3)) if missing == "appearance" else (peak(3), None)))
    assert estimate is not None
    assert estimate.probabilities == pytest.approx(peak(3))
    assert missing not in estimate.terms


def test_frames_that_show_nothing_keep_the_state_as_it_was(assembly: Assembly) -> None:
    fusion = Pose2State(assembly)
    seen = fusion.step(peak(2), peak(2))
    hidden = None
    for _ in range(50):
        hidden = fusion.step(None, None)
    assert seen is not None
    assert hidden is not None
    assert hidden.probabilities == pytest.approx(seen.probabilities)
    assert set(hidden.terms) == {"previous"}


@pytest.mark.parametrize(("w_dl", "w_p"), [(0.0, 1.0), (1.0, 0.0)])
def test_a_term_without_weight_keeps_the_state_as_it_was(
    assembly: Assembly, w_dl: float, w_p: float
) -> None:
    fusion = Pose2State(assembly, config=FusionConfig(w_dl=w_dl, w_p=w_p, w_previous=0.0))
    seen = fusion.step(peak(2), peak(2))
    other = (None, peak(1)) if w_p == 0 else (peak(1), None)
    after = [fusion.step(*other) for _ in range(3)][-1]
    assert seen is not None
    assert after is not None
    assert after.probabilities == pytest.approx(seen.probabilities)


def test_first_and_last_state_do_not_lose_to_the_middle(assembly: Assembly) -> None:
    uniform = np.full(5, 0.2)
    for state in (0, 3):
        fusion = Pose2State(assembly)
        fusion.step(peak(state), peak(state))
        estimate = None
        for _ in range(20):
            estimate = fusion.step(uniform, uniform)
        assert estimate is not None
        assert estimate.index == state


def test_many_neighbours_leave_a_state_at_least_half_of_its_own(assembly: Assembly) -> None:
    fusion = Pose2State(assembly, config=FusionConfig(neighbour=0.9))
    fusion.step(peak(1, height=1.0), None)
    estimate = fusion.step(None, peak(1))
    assert estimate is not None
    assert estimate.terms["previous"][1] == pytest.approx(0.5)
    assert estimate.terms["previous"].sum() == pytest.approx(1.0)


def test_reset_forgets(assembly: Assembly) -> None:
    fusion = Pose2State(assembly)
    fusion.step(peak(3), peak(3))
    fusion.reset()
    assert fusion.step(None, None) is None


def test_error_states_are_neighbours_by_their_transitions(assembly: Assembly) -> None:
    expected = np.zeros((5, 5))
    for a, b in ((0, 1), (1, 2), (2, 3), (1, 4)):
        expected[a, b] = expected[b, a] = 1
    assert (neighbours(assembly) == expected).all()


def delays(truth: np.ndarray, predicted: list[int]) -> list[int]:
    changes = [int(i) for i in np.flatnonzero(np.diff(truth)) + 1]
    ends = [*changes[1:], len(truth)]
    return [
        next((i - start for i in range(start, end) if predicted[i] == truth[start]), end - start)
        for start, end in zip(changes, ends, strict=True)
    ]


def test_short_states_are_followed_within_three_frames() -> None:
    """Ten frames a second, states of 7 frames, a third of the terms pointing at another state."""
    rng = np.random.default_rng(11)
    late: list[int] = []
    right: list[float] = []
    raw: list[float] = []
    for _ in range(10):
        truth = np.repeat(np.arange(6), 7)
        fusion = Pose2State(chain(6))
        predicted: list[int] = []
        for state in truth:
            terms = []
            for height in (0.5, 0.85):
                wrong = rng.random() < 0.25
                terms.append(peak(int(rng.integers(6)) if wrong else int(state), 6, height))
            estimate = fusion.step(terms[0], terms[1])
            assert estimate is not None
            predicted.append(estimate.index)
            raw.append(float(terms[1].argmax() == state))
        late += delays(truth, predicted)
        right.append(float(np.mean(np.array(predicted) == truth)))
    assert np.median(late) <= 1
    assert np.percentile(late, 90) <= 3
    assert np.mean(right) > np.mean(raw)


def test_a_single_wrong_frame_does_not_change_the_state() -> None:
    fusion = Pose2State(chain(6))
    for _ in range(8):
        fusion.step(peak(2, 6), peak(2, 6))
    flicker = fusion.step(peak(5, 6), peak(5, 6))
    assert flicker is not None
    assert flicker.index == 2


def test_a_term_that_is_missing_lends_no_weight() -> None:
    """w_f 0.25, w_DL 0.3 of 1: what looks alone say counts 0.075 to the 0.75 of the frame before."""
    config = FusionConfig(0.3, 0.7, 0.25, 0.75, neighbour=0.0, sharpness=1.0)
    both, looks, places = (Pose2State(chain(2), config=config) for _ in range(3))
    for fusion in (both, looks, places):
        fusion.step(peak(0, 2, 1.0), peak(0, 2, 1.0))
    other = peak(1, 2, 1.0)
    said = (both.step(other, other), looks.step(other, None), places.step(None, other))
    shares = [0.0 if estimate is None else estimate.probabilities[1] for estimate in said]
    assert shares == pytest.approx([0.25, 0.075 / 0.825, 0.175 / 0.925])


def test_without_a_weight_the_frame_before_says_nothing() -> None:
    fusion = Pose2State(chain(2), config=FusionConfig(w_f=1.0, w_previous=0.0, neighbour=0.0))
    fusion.step(peak(0, 2, 1.0), peak(0, 2, 1.0))
    estimate = fusion.step(peak(1, 2, 1.0), None)
    assert estimate is not None
    assert estimate.probabilities == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"w_f": float("nan")}, "w_f is nan"),
        ({"w_dl": -0.1}, "w_dl is -0.1"),
        ({"w_p": float("inf")}, "w_p is inf"),
        ({"w_dl": 0.0, "w_p": 0.0}, "both 0"),
        ({"sharpness": 0.0}, "sharpness is 0"),
        ({"w_f": 0.0}, "nothing seen"),
        ({"neighbour": 1.7}, "neighbour is 1.7"),
    ],
)
def test_weights_that_are_none_are_refused(options: dict[str, Any], named: str) -> None:
    with pytest.raises(MethodError, match=named):
        FusionConfig(**options)
