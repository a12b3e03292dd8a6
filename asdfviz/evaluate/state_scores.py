"""How well a run knows the state of the assembly, frame by frame.

A state is named by the last correctly completed one, also while an error is there; whether there is
an error is scored apart. Shares in percent, None where a figure is not defined.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth
from asdfviz.evaluate.calibration import calibration_error
from asdfviz.evaluate.numbering import frame_counts
from asdfviz.evaluate.protocols import Figures, mean, median, percent, percentile
from asdfviz.evaluate.segments import (
    Transition,
    edit_score,
    procedure_scores,
    segment_f1,
    steps,
    transitions,
)

TOLERANCE = 2
"""Frames of the sequence on either side of a true transition that may take either state."""


@dataclass(frozen=True, slots=True)
class StateRecord:
    """True and predicted state of one frame."""

    frame_index: int
    count: int
    """Frames of the sequence since its first, missing ones too, whatever they are numbered by."""
    state: int
    is_error: bool | None
    """None where the truth does not say."""
    predicted: int | None
    """Last correctly completed state that the run says; None where it says none."""
    predicted_error: bool
    accepted: frozenset[int]
    """The states that count as right with the tolerance."""
    attached: frozenset[str]
    """Parts that are joined: what the truth says, else what the state nominally joins."""
    predicted_attached: frozenset[str]
    confidence: float | None
    """Probability that the run gives the state it says."""

    @property
    def is_right(self) -> bool:
        """Whether the state is right, and also whether it is an error where the truth says so."""
        return self.predicted == self.state and self.is_error in (None, self.predicted_error)


def state_records(
    truth: Sequence[FrameTruth], predictions: Mapping[int, FramePrediction], assembly: Assembly
) -> tuple[StateRecord, ...]:
    """Return one record for every frame whose true state is known, in the order of the frames."""
    known = [frame for frame in truth if frame.state is not None]
    states = [int(frame.state) for frame in known if frame.state is not None]
    counts = frame_counts(sorted({*predictions, *(frame.frame_index for frame in truth)}))
    accepted = _accepted(states, [counts[frame.frame_index] for frame in known])
    records: list[StateRecord] = []
    for frame, state, right in zip(known, states, accepted, strict=True):
        prediction = predictions.get(frame.frame_index)
        estimate = None if prediction is None else prediction.state
        said = None if estimate is None else assembly.states[estimate.index]
        records.append(
            StateRecord(
                frame_index=frame.frame_index,
                count=counts[frame.frame_index],
                state=state,
                is_error=frame.is_error,
                predicted=None if said is None else said.completed,
                predicted_error=said is not None and said.is_error,
                accepted=right,
                attached=frozenset(
                    assembly.states[state].attached if frame.attached is None else frame.attached
                ),
                predicted_attached=frozenset(() if said is None else said.attached),
                confidence=None if estimate is None else float(estimate.probabilities.max()),
            )
        )
    return tuple(records)


def state_figures(records: Sequence[StateRecord]) -> Figures:
    """Return the figures of the report; a frame without a predicted state is wrong.

    `accuracy_tol2` takes either state in the two frames before and the two frames after a true
    transition, so a transition that is at most two frames off costs nothing. Frames that are missing
    count too, also in delays; where numbers always rise by 5, say, or are times, none is. `macro_f1` is the plain mean of
    F1 over the states that occur in the truth, `macro_f1_state_part` that over all pairs of a state
    and a part joined in it. Delays are in frames, below 0 for early; a transition that the run never
    followed has none and lowers `transitions_followed`.
    """
    judged = [record for record in records if record.is_error is not None]
    wrong = [record for record in judged if record.is_error]
    flagged = [record for record in judged if record.predicted_error]
    hits = sum(record.predicted_error for record in wrong)
    return {
        "accuracy": percent(sum(r.predicted == r.state for r in records), len(records)),
        "accuracy_tol2": percent(sum(r.predicted in r.accepted for r in records), len(records)),
        "macro_f1": mean(_f1(records, state) for state in sorted({r.state for r in records})),
        "error_recall": percent(hits, len(wrong)),
        "error_precision": percent(hits, len(flagged)),
        "macro_f1_state_part": _macro_f1_state_part(records),
        **_course_figures(records),
        "ece": calibration_error(confidences(records)),
    }


def confusion_matrix(records: Sequence[StateRecord], assembly: Assembly) -> dict[str, Any]:
    """Count frames by what is true (rows) and what the run says (columns).

    The labels are the correct states and "error", for any frame with an error; the columns end with
    "none", for frames in which the run says no state.
    """
    names = [state.name for state in assembly.steps]
    error, none = len(names), len(names) + 1
    counts = [[0] * (len(names) + 2) for _ in range(len(names) + 1)]
    for record in records:
        row = error if record.is_error else record.state
        if record.predicted is None:
            column = none
        else:
            column = error if record.predicted_error else record.predicted
        counts[row][column] += 1
    return {"true": [*names, "error"], "predicted": [*names, "error", "none"], "frames": counts}


def true_transitions(records: Sequence[StateRecord]) -> tuple[tuple[Transition, ...], int]:
    """Return every true transition with its delay, and how many changes of the run are false."""
    found, false = transitions(
        [record.predicted for record in records],
        [record.state for record in records],
        [record.count for record in records],
    )
    numbers = {record.count: record.frame_index for record in records}
    return tuple(replace(one, frame=numbers[one.frame]) for one in found), false


def confidences(records: Sequence[StateRecord]) -> list[tuple[float, bool]]:
    """Return how sure the run was of each state that it said, and whether it was right."""
    return [(r.confidence, r.is_right) for r in records if r.confidence is not None]


def _course_figures(records: Sequence[StateRecord]) -> Figures:
    """Figures of segments, transitions and procedure steps; see `asdfviz.evaluate.segments`."""
    said = [record.predicted for record in records]
    true = [record.state for record in records]
    frames = [record.count for record in records]
    followed, false = true_transitions(records)
    delays = [float(found.delay) for found in followed if found.delay is not None]
    off = [abs(delay) for delay in delays]
    # A run that is silent until the first step is done has missed no step.
    start = true[0] if true else None
    procedure = procedure_scores(steps(said, frames, start=start), steps(true, frames))
    return {
        "edit": edit_score(said, true),
        "f1_10": segment_f1(said, true, overlap=0.1),
        "f1_25": segment_f1(said, true, overlap=0.25),
        "f1_50": segment_f1(said, true, overlap=0.5),
        "delay_frames_median": median(delays),
        "delay_frames_abs_median": median(off),
        "delay_frames_p90": percentile(off, 90.0),
        "transitions_followed": percent(len(delays), len(followed)),
        "false_transitions": None if all(state is None for state in said) else false,
        "pos": procedure.pos,
        "step_f1": procedure.f1,
        "step_delay_frames": procedure.delay,
    }


def _macro_f1_state_part(records: Sequence[StateRecord]) -> float | None:
    """Mean F1 over "each state and each assembly part" of the paper.

    A part's label in a frame is the state while the part is joined, and nothing while it is loose.
    """
    true = [{(r.state, part) for part in r.attached} for r in records]
    said = [{(r.predicted, part) for part in r.predicted_attached} for r in records]
    pairs = sorted(set[tuple[int, str]]().union(*true))
    scores: list[float] = []
    for pair in pairs:
        both = sum(pair in a and pair in b for a, b in zip(true, said, strict=True))
        total = sum(pair in a for a in true) + sum(pair in b for b in said)
        scores.append(100.0 * 2 * both / total)
    return mean(scores)


def micro_f1(records: Sequence[StateRecord], *, first_was_given: bool = False) -> float | None:
    """2 TP / (2 TP + FP + FN) over all frames but the first, the reading behind the paper's "F1".

    All four of the paper's figures are k / (N - 1) for N test frames. A wrong state is a false
    positive and a false negative, a missing one a false negative only.

    Args:
        records: of the frames that are judged, in their order.
        first_was_given: whether the first frame was the method's start, and so has no record.
    """
    counted = records if first_was_given else records[1:]
    right = sum(r.predicted == r.state for r in counted)
    said = sum(r.predicted is not None for r in counted)
    return percent(2 * right, said + len(counted))


def _f1(records: Sequence[StateRecord], state: int) -> float:
    true = sum(r.state == state for r in records)
    said = sum(r.predicted == state for r in records)
    both = sum(r.state == state and r.predicted == state for r in records)
    return 100.0 * 2 * both / (true + said)


def _accepted(states: Sequence[int], frames: Sequence[int]) -> list[frozenset[int]]:
    """The states that count as right in each frame; of `frames`, counted from the first, some may be missing."""
    accepted = [{state} for state in states]
    for i in range(1, len(states)):
        if states[i] != states[i - 1]:
            first = bisect_left(frames, frames[i] - TOLERANCE)
            end = bisect_left(frames, frames[i] + TOLERANCE)
            for place in range(first, end):
                accepted[place] |= {states[i - 1], states[i]}
    return [frozenset(right) for right in accepted]
