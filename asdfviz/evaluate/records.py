"""Lines up a run's poses with the truth: one record for each part that is there in a frame.

Sits between the pose errors and the protocols, which only differ in what they count.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth, PoseEstimate, Run
from asdfviz.errors import RunError
from asdfviz.evaluate.pose_errors import ErrorModel, PoseError, error_model, pose_error
from asdfviz.evaluate.twins import exchanged
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import is_rigid
from asdfviz.state.twins import twin_groups


@dataclass(frozen=True, slots=True, eq=False)
class PoseRecord:
    """One true part in one frame, and how far its estimate is off."""

    frame_index: int
    part: str
    visible: float
    """Visible share of the part's outline, 0 to 1."""
    error: PoseError | None
    """None where the run has no pose: a miss."""
    T_camera_truth: Transform
    T_camera_estimate: Transform | None
    score: float | None
    """How sure the run is of its pose, 0 to 1."""
    not_found: PoseError | None = None
    """Of a miss: what the row that says so would be off as a pose; see `asdfviz.evaluate.not_found`."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Every record, and the poses of parts that are not there."""

    records: tuple[PoseRecord, ...]
    false_positives: Mapping[str, tuple[int, ...]]
    """Frame numbers in which the part has a pose though the truth does not know it there."""
    exchanged: tuple[PoseRecord, ...]
    """As `records`, with the poses of twins given to whichever of them they fit."""
    exchanged_false_positives: Mapping[str, tuple[int, ...]]
    """As `false_positives`, likewise."""


def predictions_by_frame(run: Run, assembly: Assembly) -> dict[int, FramePrediction]:
    """Return the run's predictions by frame number, checked against the assembly.

    Raises:
        RunError: a frame comes twice, a part or state is unknown, or a pose is not rigid.
    """
    found: dict[int, FramePrediction] = {}
    for prediction in run.predictions:
        where = f"run of '{run.method}', frame {prediction.frame_index}"
        if prediction.frame_index in found:
            raise RunError(f"{where}: the frame comes twice; a run holds each frame once")
        for name, pose in prediction.poses.items():
            if name not in assembly.parts:
                known = ", ".join(assembly.parts)
                raise RunError(f"{where}: part '{name}' is not in {assembly.name}; parts: {known}")
            if not is_rigid(pose.T_camera_part):
                raise RunError(
                    f"{where}: the pose of '{name}' is not a rigid transform; "
                    "leave a part out that was not found"
                )
        state = prediction.state
        if state is not None and len(state.probabilities) != len(assembly.states):
            raise RunError(
                f"{where}: {len(state.probabilities)} state probabilities, expected "
                f"{len(assembly.states)} for {assembly.name}"
            )
        found[prediction.frame_index] = prediction
    return found


def compare_poses(
    predictions: Mapping[int, FramePrediction],
    truth: Iterable[FrameTruth],
    *,
    assembly: Assembly,
    visible: Mapping[int, Mapping[str, float]],
) -> Comparison:
    """Compare every pose of the frames in `truth`, but for those of parts that are unchecked there.

    Args:
        predictions: by frame number; a frame may be missing, which misses all its parts.
        truth: the frames that count.
        assembly: its parts are compared; objects that it does not know are left aside.
        visible: visible share by frame number and part, for every part of the truth.
    """
    models = {name: error_model(part) for name, part in assembly.parts.items()}
    groups = [names for names in twin_groups(assembly) if len(names) > 1]
    records: list[PoseRecord] = []
    after: list[PoseRecord] = []
    extra: dict[str, list[int]] = {name: [] for name in assembly.parts}
    extra_after: dict[str, list[int]] = {name: [] for name in assembly.parts}
    for frame in truth:
        prediction = predictions.get(frame.frame_index)
        poses: Mapping[str, PoseEstimate] = {} if prediction is None else prediction.poses
        given, measured = _given_to_twins(poses, frame, groups, models)
        # A frame whose state alone is known says nothing about which parts are there.
        if frame.T_camera_part or frame.lists_parts:
            _note_absent(extra, poses, frame)
            _note_absent(extra_after, given, frame)
        for name, model in models.items():
            T_camera_truth, pose = frame.T_camera_part.get(name), poses.get(name)
            if T_camera_truth is None:
                continue
            where = (frame.frame_index, name, visible[frame.frame_index][name])
            record = _record(where, pose, T_camera_truth, model, measured)
            records.append(record)
            if given.get(name) is not pose:
                record = _record(where, given.get(name), T_camera_truth, model, measured)
            after.append(record)
    return Comparison(tuple(records), _frozen(extra), tuple(after), _frozen(extra_after))


def _given_to_twins(
    poses: Mapping[str, PoseEstimate],
    frame: FrameTruth,
    groups: Iterable[Sequence[str]],
    models: Mapping[str, ErrorModel],
) -> tuple[dict[str, PoseEstimate], dict[tuple[str, str], float]]:
    """The poses by the twins that they fit, and the ADD(S) that was measured for it."""
    given = dict(poses)
    measured: dict[tuple[str, str], float] = {}
    for names in groups:
        given = {name: pose for name, pose in given.items() if name not in names}
        twin = models[names[0]]
        given |= exchanged(poses, frame.T_camera_part, names, twin, measured=measured)
    return given, measured


def _note_absent(found: Mapping[str, list[int]], poses: Iterable[str], frame: FrameTruth) -> None:
    for name in poses:
        if name not in frame.T_camera_part and name not in frame.unchecked:
            found[name].append(frame.frame_index)


def _frozen(found: Mapping[str, list[int]]) -> dict[str, tuple[int, ...]]:
    return {name: tuple(frames) for name, frames in found.items()}


def _record(
    where: tuple[int, str, float],
    pose: PoseEstimate | None,
    T_camera_truth: Transform,
    model: ErrorModel,
    measured: Mapping[tuple[str, str], float],
) -> PoseRecord:
    frame_index, name, visible = where
    error: PoseError | None = None
    if pose is not None:
        known = measured.get((pose.part, name))
        error = pose_error(pose.T_camera_part, T_camera_truth, model, known_add_s=known)
    return PoseRecord(
        frame_index=frame_index,
        part=name,
        visible=visible,
        error=error,
        T_camera_truth=T_camera_truth,
        T_camera_estimate=None if pose is None else pose.T_camera_part,
        score=None if pose is None else pose.score,
    )
