"""One frame's prediction as one line of JSON, and back."""

from __future__ import annotations

import json
from typing import Any, cast, get_args

import numpy as np

from asdfviz.data.json_files import Json
from asdfviz.datatypes import Detection, FramePrediction, PoseEstimate, Stage, StateEstimate
from asdfviz.errors import RunError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import is_rigid


def prediction_line(prediction: FramePrediction) -> str:
    """Write a prediction without a line break.

    Raises:
        RunError: a pose or a probability is not finite.
    """
    content = {
        "frame": prediction.frame_index,
        "poses": {name: _pose_content(pose) for name, pose in prediction.poses.items()},
        "state": None if prediction.state is None else _state_content(prediction.state),
        "detections": [_detection_content(detection) for detection in prediction.detections],
        "runtime": {stage: float(seconds) for stage, seconds in prediction.runtime.items()},
    }
    if prediction.not_found:
        content["not_found"] = {name: T.tolist() for name, T in prediction.not_found.items()}
    try:
        return json.dumps(content, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    except ValueError as error:
        raise RunError(
            f"frame {prediction.frame_index}: a pose, score, box or probability is not finite; "
            "leave out what was not found"
        ) from error


def prediction_from(line: Json) -> FramePrediction:
    """Read a prediction back.

    Raises:
        RunError: a field is missing or of a wrong kind, a pose is not rigid.
    """
    state, runtime = line.find("state"), line.get("runtime").items()
    not_found = line.find("not_found")
    return FramePrediction(
        frame_index=line.get("frame").integer(),
        poses={name: _pose(name, raw) for name, raw in line.get("poses").items().items()},
        state=None if state is None else _state(state),
        detections=tuple(_detection(raw) for raw in line.get("detections").entries()),
        runtime={stage: seconds.number() for stage, seconds in runtime.items()},
        not_found={}
        if not_found is None
        else {n: _rigid(n, T) for n, T in not_found.items().items()},
    )


def _pose_content(pose: PoseEstimate) -> dict[str, object]:
    return {
        "T_camera_part": pose.T_camera_part.tolist(),
        "score": float(pose.score),
        "stage": pose.stage,
    }


def _pose(name: str, raw: Json) -> PoseEstimate:
    T_camera_part = _rigid(name, raw.get("T_camera_part"))
    stage = raw.get("stage").text()
    if stage not in get_args(Stage):
        raise raw.get("stage").fail(f"one of {', '.join(get_args(Stage))}")
    return PoseEstimate(
        part=name,
        T_camera_part=T_camera_part,
        score=raw.get("score").number(),
        stage=cast(Stage, stage),
    )


def _rigid(name: str, field: Json) -> Transform:
    T_camera_part = _read_only(field.numbers(16).reshape(4, 4))
    if not is_rigid(T_camera_part, tolerance=1e-2):
        raise RunError(f"{field.where} of '{name}' is no rigid transform (metres, row by row)")
    return T_camera_part


def _state_content(state: StateEstimate) -> dict[str, object]:
    content: dict[str, object] = {
        "probabilities": state.probabilities.tolist(),
        "terms": {name: _or_null(term) for name, term in state.terms.items()},
    }
    if state.unfolded:
        content["unfolded"] = {name: _or_null(term) for name, term in state.unfolded.items()}
    return content


def _state(raw: Json) -> StateEstimate:
    probabilities = _vector(raw.get("probabilities"))
    if len(probabilities) == 0 or np.isnan(probabilities).any():
        raise raw.get("probabilities").fail("one finite number a state")
    unfolded = raw.find("unfolded")  # runs of old programs lack it
    return StateEstimate(
        probabilities=probabilities,
        terms=_vectors(raw.get("terms")),
        unfolded={} if unfolded is None else _vectors(unfolded),
    )


def _detection_content(detection: Detection) -> dict[str, object]:
    return {
        "label": detection.label,
        "box_xyxy": detection.box_xyxy.tolist(),
        "keypoints_px": [_or_null(pixel) for pixel in detection.keypoints_px],
        "keypoint_scores": _or_null(detection.keypoint_scores),
        "score": float(detection.score),
    }


def _detection(raw: Json) -> Detection:
    pixels = [_vector(pixel) for pixel in raw.get("keypoints_px").entries()]
    if any(len(pixel) != 2 for pixel in pixels):
        raise raw.get("keypoints_px").fail("pairs u, v")
    return Detection(
        label=raw.get("label").text(),
        box_xyxy=_read_only(raw.get("box_xyxy").numbers(4)),
        keypoints_px=_read_only(np.array(pixels, dtype=np.float64).reshape(-1, 2)),
        keypoint_scores=_vector(raw.get("keypoint_scores")),
        score=raw.get("score").number(),
    )


def _or_null(values: np.ndarray) -> list[float | None]:
    """Numbers as a list; null stands for NaN, which JSON does not have."""
    return [None if np.isnan(value) else float(value) for value in values]


def _vector(field: Json) -> np.ndarray:
    values = [np.nan if e.value is None else e.number() for e in field.entries()]
    return _read_only(np.array(values, dtype=np.float64))


def _vectors(field: Json) -> dict[str, np.ndarray]:
    return {name: _vector(values) for name, values in field.items().items()}


def _read_only(array: np.ndarray) -> Any:
    array.flags.writeable = False
    return array
