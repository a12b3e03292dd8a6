from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from asdfviz.datatypes import FramePrediction
from asdfviz.errors import MethodError, WeightsError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus import AsdfPlus
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.network import NetworkConfig
from asdfviz.methods.unlike_twins import UnlikeTwins
from asdfviz.methods.yolov8pose import Yolov8Pose, Yolov8PoseConfig
from asdfviz.pose.translation import TranslationConfig
from asdfviz.state.lately_loose import LatelyLooseConfig


def started(toy, detector, config: AsdfConfig | None = None) -> Asdf:
    method = Asdf(config or AsdfConfig(), detector=detector)
    method.reset(toy.assembly, toy.frame(0).camera, None)
    return method


def error_mm(prediction: FramePrediction, name: str, T_camera_part: np.ndarray) -> float:
    found = prediction.poses[name].T_camera_part
    return float(1e3 * np.linalg.norm(found[:3, 3] - T_camera_part[:3, 3]))


def test_an_empty_picture_gives_nothing(toy, detector) -> None:
    prediction = started(toy, detector).step(toy.frame(0))
    assert prediction.frame_index == 0
    assert dict(prediction.poses) == {}
    assert prediction.state is None
    assert set(prediction.runtime) == {"detect", "pnp", "refine", "state", "group"}


def test_shrunken_noisy_keypoints_still_end_at_the_true_place(toy, detector) -> None:
    poses = toy.poses(joined=False)
    detector.answers[1] = tuple(
        toy.detection(name, T, shrink=0.7, noise_px=1.0) for name, T in poses.items()
    )
    asdf = started(toy, detector).step(toy.frame(1, poses))
    baseline = Yolov8Pose(Yolov8PoseConfig(), detector=detector)
    baseline.reset(toy.assembly, toy.frame(0).camera, None)
    raw = baseline.step(toy.frame(1, poses))
    for name, T_camera_part in poses.items():
        assert error_mm(asdf, name, T_camera_part) < 12
        assert error_mm(raw, name, T_camera_part) > 100
        assert asdf.poses[name].stage == "refined"
        assert raw.poses[name].stage == "pnp"
        assert 0 < asdf.poses[name].score <= 0.8


def test_what_is_proposed_is_the_step_without_its_state(toy, detector) -> None:
    poses = toy.poses(joined=False)
    detector.answers[1] = tuple(toy.detection(name, T) for name, T in poses.items())
    config = AsdfConfig(group=GroupConfig(enabled=False))
    frame = toy.frame(1, poses)
    whole, proposed = started(toy, detector, config), started(toy, detector, config)
    said, half = whole.step(frame), proposed.propose(frame)
    assert said.state is not None
    assert half.state is None
    assert set(half.poses) == set(said.poses)
    for name, pose in half.poses.items():
        assert np.array_equal(pose.T_camera_part, said.poses[name].T_camera_part)
    looks = said.state.terms.get("appearance")
    assert (proposed.looks is None) == (looks is None)
    assert looks is None or np.array_equal(looks, np.array(proposed.looks))


def test_what_does_not_look_as_its_twins_do_is_no_part(
    toy, detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = toy.poses(joined=False)
    frame, boxes = (
        toy.frame(1, poses),
        tuple(toy.detection(name, T) for name, T in poses.items()),
    )
    detector.answers[1], told = boxes, list[set[str]]()

    def judged(self: UnlikeTwins, _: object, at: Mapping[str, Transform]) -> frozenset[str]:
        told.append(set(at))
        return frozenset({"block"})

    asdf = started(toy, detector)
    assert set(asdf.step(frame).poses) == set(poses)
    monkeypatch.setattr(UnlikeTwins, "strangers", judged)
    assert "block" not in asdf.step(frame).poses
    assert "block" not in asdf.assigned
    assert told == [set(poses)]
    asdf.step(frame)
    assert "block" not in told[1], "what lies there is known for good"


def test_without_depth_poses_stay_at_pnp(toy, detector) -> None:
    poses = toy.poses(joined=True)
    detector.answers[1] = tuple(toy.detection(name, T) for name, T in poses.items())
    prediction = started(toy, detector).step(toy.frame(1))
    assert {pose.stage for pose in prediction.poses.values()} == {"pnp"}
    assert error_mm(prediction, "block", poses["block"]) < 3


def test_a_part_whose_keypoints_collapsed_is_absent(toy, detector) -> None:
    poses = toy.poses(joined=True)
    detector.answers[1] = (
        toy.detection("base", poses["base"]),
        toy.detection("block", poses["block"], shrink=0.1),
    )
    prediction = started(toy, detector).step(toy.frame(1, poses))
    assert set(prediction.poses) == {"base"}
    assert len(prediction.detections) == 2


def test_the_state_follows_the_block_onto_the_base(toy, detector) -> None:
    method = started(toy, detector)
    said: list[int] = []
    state = None
    for index in range(12):
        poses = toy.poses(joined=index >= 6)
        boxes = [toy.detection(n, T, noise_px=0.5, seed=index) for n, T in poses.items()]
        detector.answers[index] = (*boxes, *([toy.state_box(0.7)] if index >= 6 else []))
        state = method.step(toy.frame(index, poses)).state
        assert state is not None
        assert state.probabilities.sum() == pytest.approx(1.0)
        said.append(state.index)
    assert said[:6] == [0] * 6
    assert said[8:] == [1] * 4
    assert state is not None
    assert set(state.terms) == {"appearance", "relative_pose", "previous"}


def test_a_block_that_was_loose_is_not_on_the_base_as_soon_as_a_hand_takes_it(
    toy, detector
) -> None:
    loose, config = toy.poses(joined=False), AsdfConfig()
    boxes = tuple(toy.detection(name, T) for name, T in loose.items())
    in_hand = (toy.detection("base", loose["base"]), toy.state_box(0.7))
    detector.answers = {i: boxes if i < 10 else in_hand for i in range(40)}

    def said(config: AsdfConfig) -> list[int]:
        method = started(toy, detector, config)
        states = [method.step(toy.frame(i, loose)).state for i in range(40)]
        assert states[12] is not None
        assert ("lately_loose" in states[12].terms) == config.lately_loose.enabled
        return [-1 if state is None else state.index for state in states]

    forgotten = dataclasses.replace(config, lately_loose=LatelyLooseConfig(enabled=False))
    assert said(forgotten).index(1) < said(config).index(1) < 40


def test_reset_starts_a_sequence_anew(toy, detector) -> None:
    poses = toy.poses(joined=True)
    detector.answers[1] = tuple(toy.detection(name, T) for name, T in poses.items())
    method = started(toy, detector)
    first = method.step(toy.frame(1, poses))
    method.step(toy.frame(1, poses))
    method.reset(toy.assembly, toy.frame(0).camera, None)
    again = method.step(toy.frame(1, poses))
    assert first.state is not None
    assert again.state is not None
    assert (again.state.probabilities == first.state.probabilities).all()
    for name in poses:
        assert (again.poses[name].T_camera_part == first.poses[name].T_camera_part).all()


def test_stages_can_be_switched_off(toy, detector) -> None:
    poses = toy.poses(joined=True)
    detector.answers[1] = tuple(toy.detection(name, T) for name, T in poses.items())
    config = dataclasses.replace(AsdfConfig(), translation=TranslationConfig(enabled=False))
    prediction = started(toy, detector, config).step(toy.frame(1, poses))
    assert {pose.stage for pose in prediction.poses.values()} == {"pnp"}


def test_the_baseline_takes_its_state_from_the_box_alone(toy, detector) -> None:
    poses = toy.poses(joined=False)
    boxes = tuple(toy.detection(name, T) for name, T in poses.items())
    detector.answers = {1: (*boxes, toy.state_box(0.8)), 2: boxes}
    method = Yolov8Pose(Yolov8PoseConfig(), detector=detector)
    method.reset(toy.assembly, toy.frame(0).camera, None)
    shown, absent = method.step(toy.frame(1)), method.step(toy.frame(2))
    assert shown.state is not None
    assert absent.state is not None
    assert (shown.state.index, absent.state.index) == (1, 0)
    assert set(shown.state.terms) == {"appearance"}


@pytest.mark.parametrize("method", [Asdf(AsdfConfig()), Yolov8Pose(Yolov8PoseConfig())])
def test_missing_weights_say_where_and_how(toy, method) -> None:
    with pytest.raises(WeightsError, match=r"/toy/weights\.safetensors.*asdfviz train"):
        method.reset(toy.assembly, toy.frame(0).camera, None)


def test_named_weights_are_looked_for_where_they_were_named(toy, tmp_path: Path) -> None:
    config = AsdfConfig(detector=NetworkConfig(weights=tmp_path / "mine.safetensors"))
    with pytest.raises(WeightsError, match=r"mine\.safetensors"):
        Asdf(config).reset(toy.assembly, toy.frame(0).camera, None)


def test_a_step_needs_a_reset(toy) -> None:
    for method in (Asdf(AsdfConfig()), Yolov8Pose(Yolov8PoseConfig())):
        with pytest.raises(MethodError, match="reset"):
            method.step(toy.frame(0))


HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.mark.usefixtures("small_models")
@pytest.mark.parametrize("make", [(Asdf, AsdfConfig), (AsdfPlus, AsdfPlusConfig)])
def test_a_base_that_is_found_turned_and_looks_the_same_hides_no_state(
    make: tuple[type, type], toy, detector
) -> None:
    """The boxes of the state say nothing here: relative poses, and what is drawn, have to."""
    kind, config = make
    base = dataclasses.replace(
        toy.assembly.parts["base"], symmetries=Symmetries(discrete=(HALF_TURN,))
    )
    assembly = dataclasses.replace(toy.assembly, parts={**toy.assembly.parts, "base": base})
    method = kind(config(), detector=detector)
    method.reset(assembly, toy.frame(0).camera, None)
    poses = toy.poses(joined=True)
    seen = {**poses, "base": poses["base"] @ HALF_TURN}
    said = []
    for index in range(10):
        names = seen if index < 9 else ("base",)
        detector.answers[index] = tuple(toy.detection(n, seen[n]) for n in names)
        said.append(method.step(toy.frame(index, poses)))
    assert [p.state.index for p in said[4:]] == [1] * 6
    # And the block that no box shows in the end is not put on the other side.
    assert error_mm(said[-1], "block", poses["block"]) < 8


def test_a_base_that_lies_right_of_its_twin_is_known_by_what_is_joined_to_it(toy, detector) -> None:
    twin = dataclasses.replace(toy.assembly.parts["base"], name="base-copy")
    parts = {**toy.assembly.parts, "base-copy": twin}
    toy = dataclasses.replace(toy, assembly=dataclasses.replace(toy.assembly, parts=parts))
    poses = toy.poses(joined=True)
    poses["base-copy"] = poses["base"].copy()
    poses["base-copy"][0, 3] -= 0.2
    method = Asdf(AsdfConfig(), detector=detector)
    method.reset(toy.assembly, toy.frame(0).camera, None)
    detector.answers[1] = tuple(toy.detection(name, T) for name, T in poses.items())
    said = [method.step(toy.frame(1)) for _ in range(10)]
    assert said[-1].state is not None
    assert said[-1].state.index == 1
    assert error_mm(said[-1], "base", poses["base"]) < 5
    assert error_mm(said[-1], "base-copy", poses["base-copy"]) < 5
