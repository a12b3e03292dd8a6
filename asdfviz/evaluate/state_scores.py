"""How well a run knows the state of the assembly, frame by frame.

A state is named by the last correctly completed one, also while an error is there; whether there is
an error is scored apart. Shares in percent, None where a figure is not defined.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth
from asdfviz.evaluate.protocols import Figures, mean, percent

TOLERANCE = 2
"""Frames on either side of a true transition that may take either state."""


@dataclass(frozen=True, slots=True)
class StateRecord:
    """True and predicted state of one frame."""

    state: int
    is_error: bool | None
    """None where the truth does not say."""
    predicted: int | None
    """Last correctly completed state that the run says; None where it says none."""
    predicted_error: bool
    accepted: frozenset[int]
    """The states that count as right with the tolerance."""


def state_records(
    truth: Sequence[FrameTruth], predictions: Mapping[int, FramePrediction], assembly: Assembly
) -> tuple[StateRecord, ...]:
    """Return one record for every frame whose true state is known, in the order of the frames."""
    known = [frame for frame in truth if frame.state is not None]
    states = [int(frame.state) for frame in known if frame.state is not None]
    accepted = _accepted(states)
    records: list[StateRecord] = []
    for frame, state, right in zip(known, states, accepted, strict=True):
        prediction = predictions.get(frame.frame_index)
        estimate = None if prediction is None else prediction.state
        said = None if estimate is None else assembly.states[estimate.index]
        records.append(
            StateRecord(
                state=state,
                is_error=frame.is_error,
                predicted=None if said is None else said.completed,
                predicted_error=said is not None and said.is_error,
                accepted=right,
            )
        )
    return tuple(records)


def state_figures(records: Sequence[StateRecord]) -> Figures:
    """Return the figures of the report; a frame without a predicted state is wrong.

    `accuracy_tol2` takes either state in the two frames before and the two frames after a true
    transition, so a transition that is at most two frames off costs nothing. `macro_f1` is the plain
    mean of F1 over the states that occur in the truth.
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
    }


def micro_f1(records: Sequence[StateRecord]) -> float | None:
    """2 TP / (2 TP + FP + FN) over all frames but the first, the reading behind the paper's "F1".

    All four of the paper's figures are k / (N - 1) for N test frames. A wrong state is a false
    positive and a false negative, a missing one a false negative only.
    """
    counted = records[1:]
    right = sum(r.predicted == r.state for r in counted)
    said = sum(r.predicted is not None for r in counted)
    return percent(2 * right, said + len(counted))


def _f1(records: Sequence[StateRecord], state: int) -> float:
    true = sum(r.state == state for r in records)
    said = sum(r.predicted == state for r in records)
    both = sum(r.state == state and r.predicted == state for r in records)
    return 100.0 * 2 * both / (true + said)


def _accepted(states: Sequence[int]) -> list[frozenset[int]]:
    accepted = [{state} for state in states]
    for i in range(1, len(states)):
        if states[i] != states[i - 1]:
            for place in range(max(0, i - TOLERANCE), min(len(states), i + TOLERANCE)):
                accepted[place] |= {states[i - 1], states[i]}
    return [frozenset(right) for right in accepted]
