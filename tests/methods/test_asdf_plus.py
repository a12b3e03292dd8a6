from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import (
    point_distance,
    rotation_about,
    rotation_angle,
    transform_from,
)
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus import AsdfPlus
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.base_votes_config import BaseVotesConfig
from asdfviz.methods.in_table import InTableConfig
from asdfviz.methods.kept_poses import HypothesesConfig
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.registration import RegistrationConfig, evidence, registered
from asdfviz.methods.still_there import StillThereConfig
from asdfviz.methods.yolov8pose import Yolov8Pose
from asdfviz.methods.yolov8pose_icp import Yolov8PoseIcpConfig
from asdfviz.methods.yolov8pose_state import Yolov8PoseStateConfig

pytestmark = pytest.mark.usefixtures("small_models")


def started(toy, method):
    method.reset(toy.assembly, toy.frame(0).camera, None)
    return method


def test_registration_turns_what_the_depth_shift_cannot(toy) -> None:
    true = toy.poses(joined=False)
    shape = part_shapes(toy.assembly, surface_points=1500)["block"]
    frame = toy.frame(1, true)
    turn = rotation_about(np.array([0.0, 0.6, 0.8]), np.radians(8.0))
    start = true["block"] @ transform_from(turn, np.array([0.0, 0.003, 0.0]))
    box = toy.detection("block", true["block"]).box_xyxy
    config = RegistrationConfig()
    found = registered(start, shape, frame, config=config)
    assert found is not None
    left = rotation_angle(found[:3, :3].T @ true["block"][:3, :3])
    assert np.degrees(left) < 3.0
    before = evidence(start, shape, frame, box_xyxy=box, config=config)
    after = evidence(found, shape, frame, box_xyxy=box, config=config)
    assert after.value(config) > before.value(config)
    assert evidence(found, shape, frame, box_xyxy=None, config=config).outline == 0
    assert registered(start, shape, frame, config=RegistrationConfig(enabled=False)) is None
    assert registered(start, shape, toy.frame(1), config=config) is None


def test_the_state_is_followed_and_a_hidden_part_placed(toy, detector) -> None:
    # Nothing is kept of a part without a box, so that only the group can place it.
    config = AsdfPlusConfig(hypotheses=HypothesesConfig(unseen=1.1))
    method = started(toy, AsdfPlus(config, detector=detector))
    said: list[int] = []
    prediction = None
    for index in range(12):
        poses = toy.poses(joined=index >= 5)
        names = poses if index < 11 else ("base",)
        boxes = [toy.detection(n, poses[n], noise_px=0.5, seed=index) for n in names]
        detector.answers[index] = (*boxes, *([toy.state_box(0.7)] if index >= 5 else []))
        prediction = method.step(toy.frame(index, poses))
        assert prediction.state is not None
        assert "group_fit" in prediction.state.terms
        said.append(prediction.state.index)
    assert said[:5] == [0] * 5
    assert said[8:] == [1] * 4
    assert prediction is not None
    assert prediction.poses["block"].stage == "group"
    truth = toy.poses(joined=True)["block"]
    assert np.linalg.norm(prediction.poses["block"].T_camera_part[:3, 3] - truth[:3, 3]) < 0.008
    assert {"detect", "refine", "register", "follow", "group"} <= set(prediction.runtime)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_hidden_base_stays_where_its_parts_have_it_whatever_looks_like_it(
    toy, detector, enabled: bool
) -> None:
    """A board hides the base, and something like it is found elsewhere."""
    config = AsdfPlusConfig(base_votes=BaseVotesConfig(enabled=enabled))
    method, true = started(toy, AsdfPlus(config, detector=detector)), toy.poses(joined=True)
    like_it = transform_from(np.eye(3), np.array([-0.16, -0.07, 0.0])) @ true["base"]
    told = dict[str, PoseEstimate]()
    for index in range(16):
        shot, is_hidden = toy.frame(index, true), index >= 10
        at = like_it if is_hidden else true["base"]
        if is_hidden:
            depth = np.minimum(shot.depth, toy.depth({"base": like_it}))
            board = toy.depth({"base": true["base"]}) < 0.74
            shot = replace(shot, depth=np.where(board, np.float32(0.3), depth))
        detector.answers[index] = (
            replace(toy.detection("base", at), score=0.4 if is_hidden else 0.9),
            toy.detection("block", true["block"]),
            toy.state_box(0.7),
        )
        told = method.step(shot).poses
    apart = 1.0
    if "base" in told:
        apart = point_distance(told["base"].T_camera_part, true["base"], np.zeros(3))
    assert (apart < 0.005) == enabled
    # What is held is as sure as that makes it, behind the board too.
    assert (told["block"].score > 0.9) == enabled


def test_poses_that_are_rather_wrong_are_withheld_but_kept(toy, detector) -> None:
    said = []
    for least in (0.0, 0.5):
        config = AsdfPlusConfig(least_score=least, in_table=InTableConfig(enabled=False))
        method, given = started(toy, AsdfPlus(config, detector=detector)), []
        for index in range(4):
            poses = toy.poses(joined=False)
            detector.answers[index] = (
                toy.detection("base", poses["base"]),
                # A box of a low score where nothing is: its pose is one that nothing speaks for.
                replace(toy.detection("block", poses["block"]), score=0.05),
            )
            given.append(method.step(toy.frame(index, {"base": poses["base"]})))
        said.append(given)
    for every, sure in zip(*said, strict=True):
        assert {n for n, p in every.poses.items() if p.score >= 0.5} == set(sure.poses)
        assert every.state is not None
        assert sure.state is not None
        np.testing.assert_array_equal(every.state.probabilities, sure.state.probabilities)
    assert "base" in said[1][-1].poses
    # Without depth the probability says too little.
    method = started(toy, AsdfPlus(AsdfPlusConfig(), detector=detector))
    seen = method.step(replace(toy.frame(0, {}), depth=None))
    assert {"base", "block"} <= set(seen.poses)
    assert any(p.poses.keys() > s.poses.keys() for p, s in zip(*said, strict=True))


@pytest.mark.parametrize("enabled", [True, False])
def test_a_look_alike_that_was_proposed_long_ago_is_not_told_once_the_part_is_gone(
    toy, detector, enabled: bool
) -> None:
    """It is kept as a runner-up, as depth agrees with it in every frame."""
    here, there = (transform_from(np.eye(3), np.array([x, 0.0, 0.6])) for x in (0.1, -0.15))
    config = AsdfPlusConfig(still_there=StillThereConfig(enabled=enabled), least_score=0.0)
    method, told = started(toy, AsdfPlus(config, detector=detector)), dict[str, PoseEstimate]()
    for index in range(30):
        shot = toy.photo(index, [here, there] if index < 15 else [there])
        shot.rgb[0, 0] = index  # what the fake detector reads
        T = there if index == 0 else here
        detector.answers[index] = (toy.detection("block", T),) if index < 15 else ()
        told = method.step(shot).poses
    assert ("block" in told) != enabled


def test_the_papers_variants_differ_in_their_stages(toy, detector) -> None:
    poses = toy.poses(joined=True)
    detector.answers[1] = tuple(toy.detection(name, T, noise_px=0.5) for name, T in poses.items())
    frame = toy.frame(1, poses)
    state = started(toy, Asdf(Yolov8PoseStateConfig(), detector=detector)).step(frame)
    icp = started(toy, Yolov8Pose(Yolov8PoseIcpConfig(), detector=detector)).step(frame)
    assert {pose.stage for pose in state.poses.values()} == {"pnp"}
    assert state.state is not None
    assert "relative_pose" in state.state.terms
    assert {pose.stage for pose in icp.poses.values()} == {"refined"}
    assert "refine" in icp.runtime
    switched = started(toy, Asdf(AsdfConfig(refinement="icp"), detector=detector)).step(frame)
    assert "refined" in {pose.stage for pose in switched.poses.values()}


def test_a_step_needs_a_reset(toy) -> None:
    with pytest.raises(MethodError, match="asdf_plus"):
        AsdfPlus(AsdfPlusConfig()).step(toy.frame(0))
