"""Edits of poses as a person sees them: along and about the picture's axes."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.annotate.edits import (
    gizmo_pose,
    moved_group,
    nudged,
    pose_from_gizmo,
    rotated,
)
from asdfviz.datatypes import Assembly
from asdfviz.errors import AnnotationError
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, inverse, is_rigid, rotation_about, transform_from

K = np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]])
CENTRE = np.array([0.02, 0.01, 0.005])


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.array([0.02, -0.03, 0.6]) + rng.normal(size=3) * 0.02
    return transform_from(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), t)


def pixel(T_camera_part: np.ndarray) -> np.ndarray:
    """Where the part's centre is seen, and its depth."""
    centre_camera = apply(T_camera_part, CENTRE[None])
    return np.append(project(centre_camera, K)[0], centre_camera[0, 2])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_nudge_moves_the_part_that_way_in_the_picture(axis: int, sign: int) -> None:
    before = pose(0)
    after = nudged(before, 0.01 * sign * np.eye(3)[axis])
    change = pixel(after) - pixel(before)
    assert np.sign(change[axis]) == sign
    np.testing.assert_array_equal(after[:3, :3], before[:3, :3])
    np.testing.assert_allclose(np.linalg.norm(after[:3, 3] - before[:3, 3]), 0.01)


def test_a_turn_keeps_the_centre_and_is_right_handed() -> None:
    before = pose(1)
    after = rotated(before, np.array([0, 0, 1.0]), np.deg2rad(90), centre_part=CENTRE)
    np.testing.assert_allclose(pixel(after), pixel(before), atol=1e-9)
    # About the axis into the picture, right-handed: what pointed right now points down.
    part_right = before[:3, :3].T @ np.array([1.0, 0, 0])
    np.testing.assert_allclose(after[:3, :3] @ part_right, [0, 1, 0], atol=1e-12)


def test_a_thousand_turns_stay_rigid_and_come_back() -> None:
    T_camera_part = pose(2)
    for axis in (np.array([0, 1.0, 0]), np.array([0, -1.0, 0])):
        for _ in range(500):
            T_camera_part = rotated(T_camera_part, axis, 0.3, centre_part=CENTRE)
    np.testing.assert_allclose(T_camera_part, pose(2), atol=1e-10)
    assert is_rigid(T_camera_part, tolerance=1e-12)


def test_edits_leave_their_input_alone() -> None:
    before = pose(3)
    copy = before.copy()
    before.flags.writeable = False
    nudged(before, np.ones(3))
    rotated(before, np.ones(3), 1.0, centre_part=CENTRE)
    pose_from_gizmo(gizmo_pose(before, CENTRE), CENTRE)
    moved_group({"base": before, "lid": before}, "base", pose(4), attached=("base", "lid"))
    np.testing.assert_array_equal(before, copy)


def test_the_centre_of_a_part(boxes: Assembly) -> None:
    np.testing.assert_allclose(boxes.parts["lid"].middle, CENTRE)


def test_a_gizmo_holds_the_part_at_its_centre() -> None:
    T_camera_part = pose(5)
    T_camera_gizmo = gizmo_pose(T_camera_part, CENTRE)
    np.testing.assert_allclose(T_camera_gizmo[:3, 3], apply(T_camera_part, CENTRE[None])[0])
    np.testing.assert_allclose(pose_from_gizmo(T_camera_gizmo, CENTRE), T_camera_part, atol=1e-14)


def test_a_gizmo_in_single_precision_makes_a_rigid_pose() -> None:
    rough = gizmo_pose(pose(6), CENTRE).astype(np.float32).astype(np.float64)
    T_camera_part = pose_from_gizmo(rough, CENTRE)
    assert is_rigid(T_camera_part, tolerance=1e-14)
    np.testing.assert_allclose(T_camera_part, pose(6), atol=1e-6)


def test_a_joined_group_moves_as_one_body() -> None:
    before = {"base": pose(0), "lid": pose(1), "pin": pose(2)}
    after = moved_group(before, "lid", pose(7), attached=("base", "lid"))
    assert set(after) == {"base", "lid"}
    np.testing.assert_array_equal(after["lid"], pose(7))
    np.testing.assert_allclose(
        inverse(after["lid"]) @ after["base"], inverse(before["lid"]) @ before["base"], atol=1e-12
    )


@pytest.mark.parametrize(
    ("part", "attached", "moved"),
    [
        ("pin", ("base", "lid"), {"pin"}),
        ("base", ("base",), {"base"}),
        ("base", ("base", "lid", "pin"), {"base", "lid"}),
    ],
)
def test_who_moves_along(part: str, attached: tuple[str, ...], moved: set[str]) -> None:
    poses = {"base": pose(0), "lid": pose(1)}
    assert set(moved_group(poses, part, pose(3), attached=attached)) == moved


def test_a_joined_part_without_a_pose_cannot_lead() -> None:
    with pytest.raises(AnnotationError, match="'pin' has no pose to move base"):
        moved_group({"base": pose(0)}, "pin", pose(1), attached=("base", "pin"))
