"""Checks what a method answered before it is kept: a plug-in is code from outside, its answer input."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from asdfviz.datatypes import (
    Assembly,
    Detection,
    FramePrediction,
    PoseEstimate,
    Stage,
    StateEstimate,
)
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import is_rigid

SUM_TOLERANCE = 1e-3
"""By this the probabilities of the states may miss 1, and a score leave 0 to 1: methods round."""


def check_answer(
    answer: object, assembly: Assembly, *, frame_index: int, method: str
) -> FramePrediction:
    """Return the answer if it is a whole prediction of that frame that a run can hold.

    Raises:
        MethodError: with the method, the frame, the part or field, and what would be right.
    """
    where = f"method '{method}', frame {frame_index}"
    if not isinstance(answer, FramePrediction):
        raise MethodError(f"{where}: step() returned {_kind(answer)}, expected a FramePrediction")
    if answer.frame_index != frame_index:
        raise MethodError(f"{where}: it answered for frame {answer.frame_index}")
    for name, pose in _mapping(answer.poses, f"{where}: poses").items():
        _check_pose(name, pose, assembly, where)
    for name, T_camera_part in _mapping(answer.not_found, f"{where}: not_found").items():
        _check_part(name, assembly, where)
        _check_transform(name, T_camera_part, f"{where}: not_found")
    if cast(object, answer.state) is not None:
        _check_state(answer.state, assembly, where)
    for detection in _items(answer.detections, f"{where}: detections"):
        _check_detection(detection, where)
    for stage, seconds in _mapping(answer.runtime, f"{where}: runtime").items():
        if not _is_number(seconds):
            raise MethodError(f"{where}: the runtime of '{stage}' is {seconds!r}, expected seconds")
    return answer


def _check_part(name: object, assembly: Assembly, where: str) -> None:
    if name not in assembly.parts:
        raise MethodError(
            f"{where}: no part '{name}' in {assembly.name}; parts: {', '.join(assembly.parts)}"
        )


def _check_transform(name: object, T_camera_part: object, where: str) -> None:
    if not _is_array(T_camera_part, (4, 4)) or not is_rigid(cast(Transform, T_camera_part)):
        raise MethodError(
            f"{where}: the pose of '{name}' is not a rigid transform (4x4 array, metres)"
        )


def _check_pose(name: object, pose: object, assembly: Assembly, where: str) -> None:
    _check_part(name, assembly, where)
    if not isinstance(pose, PoseEstimate):
        raise MethodError(
            f"{where}: the pose of '{name}' is {_kind(pose)}, expected a PoseEstimate"
        )
    if pose.part != name:
        raise MethodError(f"{where}: the pose of '{name}' says that it is of '{pose.part}'")
    _check_transform(name, pose.T_camera_part, where)
    if not _is_number(pose.score) or abs(pose.score - 0.5) > 0.5 + SUM_TOLERANCE:
        raise MethodError(
            f"{where}: the score of '{name}' is {pose.score!r}, expected a number from 0 to 1"
        )
    if pose.stage not in get_args(Stage):
        raise MethodError(
            f"{where}: the stage of '{name}' is {pose.stage!r}, use {' or '.join(get_args(Stage))}"
        )


def _check_state(state: object, assembly: Assembly, where: str) -> None:
    if not isinstance(state, StateEstimate):
        raise MethodError(f"{where}: the state is {_kind(state)}, expected a StateEstimate or None")
    probabilities = state.probabilities
    expected = len(assembly.states)
    if not _is_array(probabilities, (None,)):
        raise MethodError(
            f"{where}: the state's probabilities must be an array of {expected} numbers"
        )
    if len(probabilities) != expected:
        raise MethodError(
            f"{where}: {len(probabilities)} state probabilities, "
            f"{assembly.name} has {expected} states"
        )
    if not np.isfinite(probabilities).all():
        raise MethodError(
            f"{where}: a state's probability is not finite; say state=None where it is not known"
        )
    if probabilities.min() < 0 or abs(float(probabilities.sum()) - 1) > SUM_TOLERANCE:
        raise MethodError(
            f"{where}: the states' probabilities must be 0 or more and sum to 1, "
            f"got {np.round(probabilities, 3).tolist()}"
        )


def _check_detection(detection: object, where: str) -> None:
    if not isinstance(detection, Detection):
        raise MethodError(f"{where}: a detection is {_kind(detection)}, expected a Detection")
    count = len(detection.keypoints_px) if _is_array(detection.keypoints_px, (None, 2)) else -1
    sound = (
        count >= 0
        and _is_array(detection.keypoint_scores, (count,))
        and _is_array(detection.box_xyxy, (4,))
        and bool(np.isfinite(detection.box_xyxy).all())
        and _is_number(detection.score)
    )
    if not sound:
        raise MethodError(
            f"{where}: the detection of '{detection.label}' needs arrays box_xyxy (4 finite "
            "numbers), keypoints_px (n x 2) and keypoint_scores (n), and a score"
        )


def _mapping(value: object, where: str) -> Mapping[object, object]:
    if not isinstance(value, Mapping):
        raise MethodError(f"{where} must be a mapping, got {_kind(value)}")
    return cast(Mapping[object, object], value)


def _items(value: object, where: str) -> tuple[object, ...]:
    if not isinstance(value, (tuple, list)):
        raise MethodError(f"{where} must be a tuple, got {_kind(value)}")
    return tuple(cast(tuple[object, ...], value))


def _is_array(value: object, shape: tuple[int | None, ...]) -> bool:
    """Whether this is an array of real numbers of that shape; None stands for any length."""
    if not isinstance(value, np.ndarray):
        return False
    array = cast(NDArray[np.generic], value)
    if array.dtype.kind not in "fiu" or array.ndim != len(shape):
        return False
    return all(wanted in (None, got) for wanted, got in zip(shape, array.shape, strict=True))


def _is_number(value: object) -> bool:
    kinds = (int, float, np.integer, np.floating)
    return isinstance(value, kinds) and bool(np.isfinite(cast(float, value)))


def _kind(value: object) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
