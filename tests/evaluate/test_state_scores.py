"""State figures on sequences short enough to count by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth
from asdfviz.evaluate.segments import NO_DELAY
from asdfviz.evaluate.state_scores import (
    StateRecord,
    confusion_matrix,
    micro_f1,
    state_figures,
    state_records,
    true_transitions,
)

# Index 3 of the toy assembly is the error that follows state 1.
WRONG = 3


@pytest.fixture
def records(
    assembly: Assembly,
    make_truth: Callable[..., FrameTruth],
    make_prediction: Callable[..., FramePrediction],
) -> Callable[..., tuple[StateRecord, ...]]:
    def make(
        true: Sequence[int | None],
        said: Sequence[int | None],
        errors: Sequence[bool | None] | None = None,
    ) -> tuple[StateRecord, ...]:
        wrong = errors or [False] * len(true)
        truth = [
            make_truth(i, {}, state=s, is_error=e)
            for i, (s, e) in enumerate(zip(true, wrong, strict=True))
        ]
        predictions = {i: make_prediction(i, {}, state=s) for i, s in enumerate(said)}
        return state_records(truth, predictions, assembly)

    return make


def test_no_frame_gives_no_figure() -> None:
    assert set(state_figures(()).values()) == {None}
    assert micro_f1(()) is None


def test_all_right(records: Callable[..., tuple[StateRecord, ...]]) -> None:
    figures = state_figures(records([0, 0, 1, 2], [0, 0, 1, 2]))
    assert {figures[key] for key in ("accuracy", "accuracy_tol2", "macro_f1", "edit", "pos")} == {
        100
    }
    assert figures["error_recall"] is figures["error_precision"] is None


def test_figures_by_hand(records: Callable[..., tuple[StateRecord, ...]]) -> None:
    found = records([0, 0, 0, 0, 0, 0, 1, 1, 1, 1], [0, 0, 1, 0, None, 0, 0, 1, 1, 2])
    figures = state_figures(found)
    assert figures["accuracy"] == 60
    # Only frame 6 is wrong within two frames of the change at 6 (4, 5, 6, 7); a frame without a
    # state is wrong even there.
    assert figures["accuracy_tol2"] == 70
    # State 0: 4 right, 6 true, 5 said. State 1: 2 right, 4 true, 3 said. State 2 is not in the truth.
    assert figures["macro_f1"] == pytest.approx(100 * (8 / 11 + 4 / 7) / 2)
    # Without frame 0: 5 right, 8 said, 9 frames.
    assert micro_f1(found) == pytest.approx(100 * 10 / 17)


@pytest.mark.parametrize("early", [0, None])
def test_silence_before_the_first_step_costs_no_step(
    records: Callable[..., tuple[StateRecord, ...]], early: int | None
) -> None:
    figures = state_figures(records([0, 0, 0, 1, 1, 2], [early] * 3 + [1, 1, 2]))
    assert (figures["pos"], figures["step_f1"], figures["step_delay_frames"]) == (100, 100, 0)
    assert (figures["transitions_followed"], figures["false_transitions"]) == (100, 0)


@pytest.mark.parametrize(
    ("switch", "tolerant"), [(2, 90), (3, 100), (4, 100), (5, 100), (6, 100), (7, 100), (8, 90)]
)
def test_a_transition_may_be_two_frames_off(
    records: Callable[..., tuple[StateRecord, ...]], switch: int, tolerant: float
) -> None:
    said = [0] * switch + [1] * (10 - switch)
    found = state_figures(records([0] * 5 + [1] * 5, said))
    assert found["accuracy"] == 100 - 10 * abs(switch - 5)
    assert found["accuracy_tol2"] == tolerant


@pytest.mark.parametrize(("switch", "tolerant"), [(10, 5), (14, 6), (15, 6), (17, 6), (30, 5)])
def test_frames_that_are_missing_count_as_time(
    assembly: Assembly,
    make_truth: Callable[..., FrameTruth],
    make_prediction: Callable[..., FramePrediction],
    switch: int,
    tolerant: int,
) -> None:
    true = {0: 0, 10: 0, 14: 0, 15: 1, 17: 1, 30: 1}
    truth = [make_truth(i, {}, state=state, is_error=False) for i, state in true.items()]
    said = {i: make_prediction(i, {}, state=int(i >= switch)) for i in true}
    found = state_figures(state_records(truth, said, assembly))
    assert found["accuracy_tol2"] == pytest.approx(100 * tolerant / 6)


@pytest.mark.parametrize(
    "numbers",
    [
        pytest.param([5 * i for i in range(40)], id="steps of five"),
        pytest.param([round(1000 * i / 30) for i in range(40)], id="milliseconds, 30 a second"),
        pytest.param([round(1000 * i / 60) for i in range(40)], id="milliseconds, 60 a second"),
        pytest.param([33_333_333 * i + 10**6 * (i % 3) for i in range(40)], id="a trembling clock"),
    ],
)
@pytest.mark.parametrize("late", [-3, -2, 2, 3])
def test_frames_are_counted_whatever_numbers_them(
    assembly: Assembly,
    make_truth: Callable[..., FrameTruth],
    make_prediction: Callable[..., FramePrediction],
    numbers: Sequence[int],
    late: int,
) -> None:
    truth = [make_truth(n, {}, state=int(i >= 20)) for i, n in enumerate(numbers)]
    said = {n: make_prediction(n, {}, state=int(i >= 20 + late)) for i, n in enumerate(numbers)}
    found = state_records(truth, said, assembly)
    figures = state_figures(found)
    assert figures["accuracy_tol2"] == (100 if abs(late) == 2 else 97.5)
    assert figures["delay_frames_median"] == late
    assert figures["delay_frames_abs_median"] == abs(late)
    assert figures["step_delay_frames"] == (late if late > 0 else NO_DELAY)
    (change,), _ = true_transitions(found)
    assert (change.frame, change.delay) == (numbers[20], late)


@pytest.mark.parametrize(("runs_too", "tolerant"), [(False, 100), (True, 80)])
def test_two_frames_are_those_of_the_sequence(
    assembly: Assembly,
    make_truth: Callable[..., FrameTruth],
    make_prediction: Callable[..., FramePrediction],
    runs_too: bool,
    tolerant: float,
) -> None:
    """Every fifth frame is known; the sequence has no others, or has all, as the run tells."""
    known = range(0, 50, 5)
    truth = [make_truth(i, {}, state=int(i >= 25)) for i in known]
    frames = range(50) if runs_too else known
    said = {i: make_prediction(i, {}, state=int(i >= 15)) for i in frames}
    assert state_figures(state_records(truth, said, assembly))["accuracy_tol2"] == tolerant


def test_a_third_state_is_wrong_at_a_transition(
    records: Callable[..., tuple[StateRecord, ...]],
) -> None:
    assert state_figures(records([0, 0, 1, 1], [0, 2, 2, 1]))["accuracy_tol2"] == 50


def test_an_error_keeps_the_completed_state(
    records: Callable[..., tuple[StateRecord, ...]],
) -> None:
    true = [1, 1, 1, 1, 1]
    errors = [False, True, True, True, None]
    figures = state_figures(records(true, [WRONG, WRONG, 1, 2, WRONG], errors))
    assert figures["accuracy"] == 80
    assert figures["error_recall"] == pytest.approx(100 / 3)
    assert figures["error_precision"] == 50


def test_frames_without_true_state_do_not_count(
    records: Callable[..., tuple[StateRecord, ...]],
) -> None:
    assert len(records([None, 1, None], [0, 1, 2])) == 1


def test_a_run_that_could_say_states_and_says_none_is_wrong_everywhere(
    records: Callable[..., tuple[StateRecord, ...]],
) -> None:
    figures = state_figures(records([0, 1], [None, None], [False, True]))
    assert (figures["accuracy"], figures["macro_f1"], figures["error_recall"]) == (0, 0, 0)
    assert figures["error_precision"] is None


def test_a_frame_that_the_run_lacks_is_wrong(
    assembly: Assembly,
    make_truth: Callable[..., FrameTruth],
    make_prediction: Callable[..., FramePrediction],
) -> None:
    truth = [make_truth(i, {}, state=0, is_error=False) for i in (4, 8)]
    figures = state_figures(state_records(truth, {4: make_prediction(4, {}, state=0)}, assembly))
    assert figures["accuracy"] == 50


def test_f1_of_each_state_and_part(records: Callable[..., tuple[StateRecord, ...]]) -> None:
    # plate is joined from state 0 on, rod from 1, block from 2; the last frame is the error after 1.
    found = records([0, 0, 1, 1, 2, 1], [0, 1, 1, 2, None, WRONG], [False] * 5 + [True])
    by_hand = {
        (0, "plate"): 2 * 1 / (2 + 1),
        (1, "plate"): 2 * 2 / (3 + 3),
        (1, "rod"): 2 * 2 / (3 + 3),
        (2, "plate"): 0.0,
        (2, "rod"): 0.0,
        (2, "block"): 0.0,
    }
    figures = state_figures(found)
    assert figures["macro_f1_state_part"] == pytest.approx(100 * sum(by_hand.values()) / 6)


def test_a_part_that_the_truth_says_is_off_counts_as_loose(
    assembly: Assembly, make_prediction: Callable[..., FramePrediction]
) -> None:
    truth = [FrameTruth(0, {}, 1, is_error=True, attached=("plate",))]
    found = state_records(truth, {0: make_prediction(0, {}, state=1)}, assembly)
    # (1, plate) is right; (1, rod) is no pair of the truth.
    assert state_figures(found)["macro_f1_state_part"] == 100
    assert not found[0].is_right


def test_confusion_matrix(
    assembly: Assembly, records: Callable[..., tuple[StateRecord, ...]]
) -> None:
    found = records([0, 1, 1, 2, 1], [0, 2, None, WRONG, WRONG], [False] * 4 + [True])
    matrix = confusion_matrix(found, assembly)
    assert matrix["true"] == ["bare", "rod in", "done", "error"]
    assert matrix["predicted"] == ["bare", "rod in", "done", "error", "none"]
    assert matrix["frames"] == [
        *([1, 0, 0, 0, 0], [0, 0, 1, 0, 1], [0, 0, 0, 1, 0], [0, 0, 0, 1, 0])
    ]
