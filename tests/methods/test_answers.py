"""A method's answer is input: whatever it gets wrong is one error with the method, frame and part."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.data.run_files import load_run, save_run
from asdfviz.datatypes import Assembly, Detection, FramePrediction, PoseEstimate, Run, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.methods.answers import check_answer

STATE = StateEstimate(np.full(4, 0.25))


@pytest.fixture(scope="module")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


def pose(**changes: Any) -> Any:
    values: dict[str, Any] = {
        "part": "jaw",
        "T_camera_part": np.eye(4),
        "score": 0.9,
        "stage": "pnp",
    }
    return unchecked(PoseEstimate, **{**values, **changes})


def detection(**changes: Any) -> Any:
    values: dict[str, Any] = {
        "label": "jaw",
        "box_xyxy": np.array([1.0, 2.0, 3.0, 4.0]),
        "keypoints_px": np.zeros((17, 2)),
        "keypoint_scores": np.ones(17),
        "score": 0.5,
    }
    return unchecked(Detection, **{**values, **changes})


def unchecked(cls: Any, **values: Any) -> Any:
    """An instance past the shape checks that only these tests turn on."""
    made = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def answer(**changes: Any) -> Any:
    values: dict[str, Any] = {
        "frame_index": 7,
        "poses": {"jaw": pose()},
        "state": STATE,
        "detections": (detection(),),
        "runtime": {"think": 0.1},
        "not_found": {},
    }
    return unchecked(FramePrediction, **{**values, **changes})


def test_a_whole_answer_passes_and_can_be_saved(clamp: Assembly, tmp_path: Path) -> None:
    given = answer()
    assert check_answer(given, clamp, frame_index=7, method="m") is given
    save_run(Run("m", {}, "s", "a", "1", (given,)), tmp_path)
    assert load_run(tmp_path, assembly=clamp).predictions[0].poses["jaw"].score == 0.9


def test_nothing_found_is_an_answer(clamp: Assembly) -> None:
    nothing = FramePrediction(7, {}, None)
    assert check_answer(nothing, clamp, frame_index=7, method="m") is nothing


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (None, "step() returned None, expected a FramePrediction"),
        ({}, "step() returned a dict"),
        (answer(frame_index=8), "it answered for frame 8"),
        (answer(poses=None), "poses must be a mapping, got None"),
        (answer(poses={"lid": pose(part="lid")}), "no part 'lid' in corner_clamp; parts: base"),
        (answer(poses={"jaw": np.eye(4)}), "pose of 'jaw' is a ndarray, expected a PoseEstimate"),
        (answer(poses={"base": pose()}), "the pose of 'base' says that it is of 'jaw'"),
        (answer(poses={"jaw": pose(T_camera_part=np.eye(4)[:3])}), "'jaw' is not a rigid"),
        (answer(poses={"jaw": pose(T_camera_part=np.eye(4).tolist())}), "'jaw' is not a rigid"),
        (answer(poses={"jaw": pose(T_camera_part=np.full((4, 4), np.nan))}), "not a rigid"),
        (answer(poses={"jaw": pose(T_camera_part=2 * np.eye(4))}), "'jaw' is not a rigid"),
        (answer(poses={"jaw": pose(score=float("nan"))}), "the score of 'jaw' is nan"),
        (answer(poses={"jaw": pose(score=7.0)}), "score of 'jaw' is 7.0, expected a number from 0"),
        (answer(poses={"jaw": pose(score=-0.1)}), "the score of 'jaw' is -0.1"),
        (answer(poses={"jaw": pose(score="high")}), "the score of 'jaw' is 'high'"),
        (answer(poses={"jaw": pose(stage="luck")}), "the stage of 'jaw' is 'luck', use pnp or"),
        (answer(not_found=None), "not_found must be a mapping, got None"),
        (answer(not_found={"lid": np.eye(4)}), "no part 'lid' in corner_clamp; parts: base"),
        (answer(not_found={"jaw": np.zeros((4, 4))}), "not_found: the pose of 'jaw' is not a"),
        (answer(state=2), "the state is a int, expected a StateEstimate or None"),
        (answer(state=unchecked(StateEstimate, probabilities=[1, 0, 0, 0])), "must be an array"),
        (answer(state=unchecked(StateEstimate, probabilities=np.ones((4, 4)))), "of 4 numbers"),
        (answer(state=StateEstimate(np.ones(3))), "3 state probabilities, corner_clamp has 4"),
        (answer(state=StateEstimate(np.full(4, np.nan))), "probability is not finite"),
        (answer(detections=None), "detections must be a tuple, got None"),
        (answer(detections=("x",)), "a detection is a str"),
        (answer(detections=(detection(keypoints_px=np.zeros(34)),)), "keypoints_px (n x 2)"),
        (answer(detections=(detection(keypoint_scores=np.ones(3)),)), "keypoint_scores (n)"),
        (answer(detections=(detection(box_xyxy=np.full(4, np.inf)),)), "4 finite numbers"),
        (answer(detections=(detection(score=None),)), "and a score"),
        (answer(runtime=None), "runtime must be a mapping"),
        (answer(runtime={"think": "long"}), "the runtime of 'think' is 'long', expected seconds"),
    ],
)
def test_a_wrong_answer_is_one_error(clamp: Assembly, wrong: object, message: str) -> None:
    with pytest.raises(MethodError, match=f"method 'm', frame 7.*{re.escape(message)}"):
        check_answer(wrong, clamp, frame_index=7, method="m")


@pytest.mark.parametrize("probabilities", [[2.0, -1, 0, 0], [1.0, 1, 0, 0], [0.0, 0, 0, 0]])
def test_probabilities_that_are_none(clamp: Assembly, probabilities: list[float]) -> None:
    said = answer(state=StateEstimate(np.array(probabilities)))
    with pytest.raises(MethodError, match="0 or more and sum to 1"):
        check_answer(said, clamp, frame_index=7, method="mine")
