from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate, StateEstimate
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.part_poses import part_shapes


def estimate(name: str, T_camera_part: np.ndarray) -> PoseEstimate:
    return PoseEstimate(name, T_camera_part, 0.7, "refined")


@pytest.fixture
def group(toy) -> GroupPoses:
    shapes = part_shapes(toy.assembly, surface_points=900)
    return GroupPoses(toy.assembly, shapes, config=GroupConfig())


SURE = StateEstimate(np.array([0.05, 0.95]))
OPEN = StateEstimate(np.array([0.45, 0.55]))


def test_a_joined_part_that_was_not_found_is_placed(toy, group) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    found = group.step({"base": estimate("base", true["base"])}, SURE, frame)
    assert found["block"].stage == "group"
    assert np.allclose(found["block"].T_camera_part, true["block"])
    assert found["base"].stage == "refined"
    assert 0 < found["block"].score < 0.7
    assert set(found) == {"base", "block"}


def test_the_base_is_placed_by_its_joined_part(toy, group) -> None:
    true = toy.poses(joined=True)
    found = group.step({"block": estimate("block", true["block"])}, SURE, toy.frame(1, true))
    assert np.allclose(found["base"].T_camera_part, true["base"])


def test_an_uncertain_state_places_nothing(toy, group) -> None:
    true = toy.poses(joined=True)
    poses = {"base": estimate("base", true["base"])}
    for state in (OPEN, None):
        assert set(group.step(poses, state, toy.frame(1, true))) == {"base"}


def test_where_depth_shows_nothing_of_it_the_part_stays_absent(toy, group) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, {"base": true["base"]})
    assert set(group.step({"base": estimate("base", true["base"])}, SURE, frame)) == {"base"}


def test_a_wrong_pose_yields_and_a_right_one_stays(toy, group) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    off = true["block"] @ transform_from(np.eye(3), np.array([0.0, 0.05, 0.0]))
    wrong = {"base": estimate("base", true["base"]), "block": estimate("block", off)}
    found = group.step(wrong, SURE, frame)
    assert found["block"].stage == "group"
    assert np.allclose(found["block"].T_camera_part, true["block"])
    right = {name: estimate(name, T) for name, T in true.items()}
    kept = group.step(right, SURE, frame)
    assert {pose.stage for pose in kept.values()} == {"refined"}
