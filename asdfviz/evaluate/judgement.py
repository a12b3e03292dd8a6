"""Lines a run up with the truth once; every protocol and the report read their figures from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from asdfviz.data.result_csv import FRAMES_WITH_ROWS, GIVEN_BEFORE, NOTES
from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth, Run
from asdfviz.errors import some
from asdfviz.evaluate.bop import Views
from asdfviz.evaluate.offline_states import offline_predictions
from asdfviz.evaluate.records import Comparison, compare_poses, predictions_by_frame
from asdfviz.evaluate.state_scores import StateRecord, state_records
from asdfviz.evaluate.visibility import visible_shares


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A run beside the truth, not yet counted."""

    run: Run
    assembly: Assembly
    frames: tuple[FrameTruth, ...]
    """The frames that count, in order."""
    predictions: Mapping[int, FramePrediction]
    comparison: Comparison
    states: tuple[StateRecord, ...]
    """Empty where the run is of a kind that says none."""
    offline: tuple[StateRecord, ...]
    """States decoded with all frames known; empty where the run does not keep what that takes."""
    warnings: tuple[str, ...]

    @property
    def n_held(self) -> int:
        """How many of the frames that count the run has anything on; the others are missed."""
        held = sum(frame.frame_index in self.predictions for frame in self.frames)
        with_rows = self.run.config.get(FRAMES_WITH_ROWS)
        return min(held, with_rows) if isinstance(with_rows, int) else held

    @property
    def is_comparable(self) -> bool:
        """Whether its figures are of all frames and in the truth's unit, as far as can be told."""
        return self.n_held == len(self.frames) and _wrong_unit(self.run, self.frames) is None


def judge(
    run: Run,
    *,
    assembly: Assembly,
    truth: Mapping[int, FrameTruth],
    views: Views | None = None,
) -> Judgement:
    """Compare every pose and state of a run with the truth.

    Every frame of the truth counts, also one that the run does not hold. A run that was handed the
    true poses of the first frame is not judged on that frame, one of a kind without states not by
    states.

    Args:
        run: what a method said.
        assembly: what it was about.
        truth: by frame number.
        views: needed only where the truth lacks visible shares, to render them.

    Raises:
        RunError: the run does not fit the assembly or holds a pose that is none.
        SequenceError: visible shares are missing and there is no camera, or the frame cannot be read.
    """
    predictions = predictions_by_frame(run, assembly)
    frames = judged_frames(run, truth)
    has_states = run.says_states or any(p.state is not None for p in run.predictions)
    offline = offline_predictions(run, assembly)
    return Judgement(
        run=run,
        assembly=assembly,
        frames=frames,
        predictions=predictions,
        comparison=compare_poses(
            predictions,
            frames,
            assembly=assembly,
            visible=visible_shares(frames, assembly=assembly, views=views),
        ),
        states=state_records(frames, predictions, assembly) if has_states else (),
        offline=() if offline is None else state_records(frames, offline, assembly),
        warnings=(*_warnings(predictions, truth, frames), *_doubts(run, frames)),
    )


def judged_frames(run: Run, truth: Mapping[int, FrameTruth]) -> tuple[FrameTruth, ...]:
    """Return the frames that count, in order: all of the truth but those that the method was given.

    A run of ours holds the frame that it was given as its first; a csv may begin with the one after,
    as its reader says. What lies before was never asked of the method.
    """
    first = min(truth, default=0)
    if run.initial == "first_frame_truth" and run.predictions:
        began = run.predictions[0].frame_index
        first = began if run.config.get(GIVEN_BEFORE) else began + 1
    return tuple(truth[index] for index in sorted(truth) if index >= first)


def _warnings(
    predictions: Mapping[int, FramePrediction],
    truth: Mapping[int, FrameTruth],
    frames: tuple[FrameTruth, ...],
) -> list[str]:
    found: list[str] = []
    absent = [frame.frame_index for frame in frames if frame.frame_index not in predictions]
    if absent:
        found.append(
            f"{len(absent)} of {len(frames)} frames with truth are not in the run and count as "
            f"missed, frame {absent[0]} first"
        )
    unknown = sorted(set(predictions) - set(truth))
    if unknown:
        found.append(
            f"{len(unknown)} frames of the run have no truth and do not count, "
            f"frame {unknown[0]} first"
        )
    return found


def _doubts(run: Run, frames: tuple[FrameTruth, ...]) -> list[str]:
    """What was noted of a csv, and what hints at results of something else, or in another unit."""
    found = [str(note) for note in cast(list[object], run.config.get(NOTES, []))]
    unknown = run.config.get("rows_of_unknown_objects")
    if isinstance(unknown, int) and unknown:
        names = cast(list[object], run.config.get("unknown_objects", []))
        listed = f" ({some(names)})" if names else ""
        found.append(
            f"{unknown} rows are of objects that the assembly does not have{listed}, and left out"
        )
    ratio = _wrong_unit(run, frames)
    if ratio is not None:
        found.append(
            f"poses lie {ratio:.3g} times as far from the camera as the truth: "
            "are they in another unit?"
        )
    return found


def _wrong_unit(run: Run, frames: tuple[FrameTruth, ...]) -> float | None:
    """How many times too far the poses lie, where only another unit explains it; else None."""
    said = [pose.T_camera_part[2, 3] for p in run.predictions for pose in p.poses.values()]
    true = [T[2, 3] for frame in frames for T in frame.T_camera_part.values()]
    if not said or not true or float(np.median(true)) <= 0:
        return None
    ratio = float(np.median(said)) / float(np.median(true))
    return None if 1e-2 < ratio < 1e2 else ratio
