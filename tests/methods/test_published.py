from __future__ import annotations

import dataclasses
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from asdfviz.datatypes import FramePrediction
from asdfviz.errors import MethodError
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_seg import AsdfSegConfig
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.part_poses import poses_from_keypoints
from asdfviz.methods.rivals import RivalsConfig
from asdfviz.methods.variants import first_poses
from asdfviz.methods.yolov8pose import Yolov8Pose, Yolov8PoseConfig
from asdfviz.methods.yolov8pose_icp import Yolov8PoseIcpConfig
from asdfviz.methods.yolov8pose_state import Yolov8PoseStateConfig
from asdfviz.pose.pnp import PnpConfig
from asdfviz.pose.translation import TranslationConfig
from asdfviz.state.fusion import FusionConfig

PUBLISHED = AsdfConfig(published=True)
KEYPOINTS = AsdfConfig(first_pose="keypoints", state_looks="boxes")
OURS = [
    AsdfConfig,
    Yolov8PoseStateConfig,
    Yolov8PoseConfig,
    Yolov8PoseIcpConfig,
    AsdfSegConfig,
]


def proposed(toy, detector, config: AsdfConfig, frame) -> FramePrediction:
    method = Asdf(config, detector=detector)
    method.reset(toy.assembly, frame.camera, None)
    return method.step(frame)


@pytest.mark.parametrize("kind", OURS)
def test_each_of_the_papers_methods_has_its_steps(kind) -> None:
    config, usual = kind(published=True), kind()
    assert config.first_pose == "keypoints"
    assert config.state_looks == "boxes"
    assert config.detector.confidence == 0.3
    assert config.pnp.solver == "ransac"
    assert (config.pnp.reprojection_px, config.pnp.reprojection_share) == (12.0, 0.0)
    assert (config.translation.coarse, config.translation.steps) == (False, 1)
    assert config.refinement == usual.refinement
    assert config.translation.sigma == usual.translation.sigma
    assert dataclasses.replace(config, detector=config.detector) == config
    assert not usual.published
    assert usual.first_pose is None


@pytest.mark.parametrize("kind", [AsdfPlusConfig, AsdfTrackConfig])
def test_what_goes_beyond_the_paper_was_never_published(kind) -> None:
    with pytest.raises(TypeError):
        kind(published=True)
    assert not kind().published


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"first_pose": "hypotheses"}, "first_pose is hypotheses"),
        ({"rivals": RivalsConfig(count=2)}, "rivals.count is 2"),
        ({"translation": TranslationConfig(steps=3)}, "translation.steps is 3"),
    ],
)
def test_what_contradicts_the_paper_is_refused(options, named: str) -> None:
    with pytest.raises(MethodError, match=named):
        AsdfConfig(published=True, **options)


def test_what_the_paper_leaves_open_stays_as_given() -> None:
    config = AsdfConfig(
        published=True,
        translation=TranslationConfig(weights="cauchy", sigma=0.04),
        fusion=FusionConfig(w_dl=0.4, w_p=0.6),
    )
    assert (config.translation.weights, config.translation.sigma) == ("cauchy", 0.04)
    assert (config.fusion.w_dl, config.fusion.sharpness) == (0.4, 1.0)


def test_crops_are_no_start_of_what_was_published(toy, tmp_path: Path) -> None:
    (tmp_path / "crops.safetensors").write_bytes(b"")
    assembly = dataclasses.replace(toy.assembly, path=str(tmp_path / "assembly.yaml"))
    assert first_poses(AsdfConfig(), assembly) == ["keypoints", "hypotheses"]
    assert first_poses(PUBLISHED, assembly) == ["keypoints"]


def test_poses_are_those_of_ransac_and_no_box_mends_them(toy, detector) -> None:
    poses = toy.poses(joined=False)
    boxes = {n: toy.detection(n, T, shrink=0.7, noise_px=1.0) for n, T in poses.items()}
    detector.answers[1] = tuple(boxes.values())
    frame = toy.frame(1)
    plain = poses_from_keypoints(
        boxes, frame, toy.assembly, config=PnpConfig(min_inliers=1, min_spread=0.0)
    )
    said = proposed(toy, detector, PUBLISHED, frame)
    ours = proposed(toy, detector, KEYPOINTS, frame)
    for name, pose in plain.items():
        assert np.array_equal(said.poses[name].T_camera_part, pose.T_camera_part)
        assert not np.array_equal(ours.poses[name].T_camera_part, pose.T_camera_part)


def test_collapsed_keypoints_are_given_to_pnp_all_the_same(toy, detector) -> None:
    T_camera_block = toy.poses(joined=False)["block"]
    detector.answers[1] = (toy.detection("block", T_camera_block, shrink=0.25),)
    frame = toy.frame(1)
    assert set(proposed(toy, detector, PUBLISHED, frame).poses) == {"block"}
    assert not proposed(toy, detector, KEYPOINTS, frame).poses


def test_one_step_moves_what_is_near_and_leaves_what_is_far(toy, detector) -> None:
    T_camera_base = toy.poses(joined=False)["base"]
    frame = toy.frame(1, {"base": T_camera_base})

    def error_mm(shrink: float, config: AsdfConfig) -> float:
        detector.answers[1] = (toy.detection("base", T_camera_base, shrink=shrink),)
        T = proposed(toy, detector, config, frame).poses["base"].T_camera_part
        return float(1e3 * np.linalg.norm(T[:3, 3] - T_camera_base[:3, 3]))

    assert error_mm(0.99, PUBLISHED) < 4
    assert error_mm(0.7, PUBLISHED) > 100
    assert error_mm(0.7, KEYPOINTS) < 12


def test_a_pose_that_depth_rules_out_stays_and_no_other_box_is_tried(toy, detector) -> None:
    poses = toy.poses(joined=False)
    wrong = poses["block"].copy()
    wrong[:3, 3] += [0.2, 0.05, -0.15]
    detector.answers[1] = (
        toy.detection("block", wrong, score=0.9),
        toy.detection("block", poses["block"], score=0.5),
    )
    frame = toy.frame(1, poses)
    said = proposed(toy, detector, PUBLISHED, frame).poses["block"].T_camera_part
    ours = proposed(toy, detector, KEYPOINTS, frame).poses["block"].T_camera_part
    assert np.linalg.norm(said[:3, 3] - wrong[:3, 3]) < 0.02
    assert np.linalg.norm(ours[:3, 3] - poses["block"][:3, 3]) < 0.02


def test_every_class_takes_its_best_box_whatever_else_is_there(toy, box_at) -> None:
    boxes = [
        box_at(toy.assembly.parts["base"].detector_class, 0, score=0.6),
        box_at(toy.assembly.parts["block"].detector_class, 1, score=0.5),
        box_at(toy.assembly.parts["block"].detector_class, 100, score=0.4),
    ]
    ours = assign_detections(boxes, toy.assembly)
    paper = assign_detections(boxes, toy.assembly, by_class=True)
    assert ours["block"].score == 0.4
    assert {name: box.score for name, box in paper.items()} == {"base": 0.6, "block": 0.5}


def test_a_class_may_be_in_the_place_of_its_like(toy, detector) -> None:
    T_camera_base = toy.poses(joined=False)["base"]
    base = toy.detection("base", T_camera_base)
    block = toy.detection("block", T_camera_base, score=0.5)
    detector.answers[1] = (base, dataclasses.replace(block, box_xyxy=base.box_xyxy))
    frame = toy.frame(1, {"base": T_camera_base})
    method = Yolov8Pose(Yolov8PoseConfig(published=True), detector=detector)
    method.reset(toy.assembly, frame.camera, None)
    assert set(method.step(frame).poses) == {"base", "block"}


def test_the_group_places_nothing_and_twins_keep_their_names(
    toy, detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("not in the paper")

    monkeypatch.setattr("asdfviz.methods.group_poses.GroupPoses.step", never)
    monkeypatch.setattr("asdfviz.state.base_turns.BaseTurns.told", never)
    monkeypatch.setattr("asdfviz.state.part_names.PartNames.changes", never)
    poses = toy.poses(joined=True)
    detector.answers[1] = tuple(toy.detection(name, T) for name, T in poses.items())
    said = proposed(toy, detector, PUBLISHED, toy.frame(1, poses))
    assert set(said.poses) == set(poses)
    assert set(said.runtime) == {"detect", "pnp", "refine", "state"}


def test_the_state_is_what_the_equations_say(toy, detector) -> None:
    method = Asdf(PUBLISHED, detector=detector)
    method.reset(toy.assembly, toy.frame(0).camera, None)
    fusion, previous = PUBLISHED.fusion, None
    for index in range(4):
        poses = toy.poses(joined=index >= 2)
        boxes = (toy.detection(name, T) for name, T in poses.items())
        detector.answers[index] = (*boxes, toy.state_box(0.6))
        state = method.step(toy.frame(index, poses)).state
        assert state is not None
        terms = MappingProxyType(dict(state.terms))
        now = fusion.w_dl * terms["appearance"] + fusion.w_p * terms["relative_pose"]
        expected = now / now.sum()
        if previous is not None:
            expected = fusion.w_f * expected + fusion.w_previous * terms["previous"]
            expected = expected / expected.sum()
        assert np.allclose(state.probabilities, expected, atol=1e-12)
        previous = state.probabilities
