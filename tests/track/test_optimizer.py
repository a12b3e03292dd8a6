from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Joint
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import inverse, is_rigid, rotation_about, transform_from
from asdfviz.track.links import Link
from asdfviz.track.optimizer import Group, OptimizerConfig, adjoint, jacobian, move, newton_step

T_ROOT_PART = transform_from(
    rotation_about(np.array([0.2, 0.5, -0.4]), 0.9), np.array([0.05, -0.02, 0.03])
)
T_CAMERA_ROOT = transform_from(
    rotation_about(np.array([1.0, 0.5, 0.3]), -0.6), np.array([0.1, 0.0, 0.6])
)
AXIS = np.array([0.0, 0.6, 0.8])


def twist_between(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    """Small (rotation, translation) that moves pose a to pose b on the part's side."""
    D = inverse(T_a) @ T_b
    return np.array([D[2, 1], D[0, 2], D[1, 0], *D[:3, 3]])


def test_move_stays_rigid_over_thousands_of_steps() -> None:
    T = T_CAMERA_ROOT.copy()
    for _ in range(5000):
        move(T, np.array([0.03, -0.02, 0.01, 1e-4, 0.0, -1e-4]))
    assert is_rigid(T, tolerance=1e-12)
    T = T_CAMERA_ROOT.copy()
    move(T, np.array([0.3, -0.2, 0.1, 0.01, 0.02, 0.03]))
    theta_r = np.array([0.3, -0.2, 0.1])
    step = transform_from(
        rotation_about(theta_r, float(np.linalg.norm(theta_r))), np.array([0.01, 0.02, 0.03])
    )
    np.testing.assert_allclose(T, T_CAMERA_ROOT @ step, atol=1e-6)


def test_adjoint_moves_a_fixed_part_as_its_root_moves() -> None:
    Ad = np.zeros((6, 6))
    adjoint(T_ROOT_PART, Ad)
    for i in range(6):
        theta = np.zeros(6)
        theta[i] = 1e-6
        T_moved = T_CAMERA_ROOT.copy()
        move(T_moved, theta)
        seen = twist_between(T_CAMERA_ROOT @ T_ROOT_PART, T_moved @ T_ROOT_PART)
        np.testing.assert_allclose(seen / 1e-6, Ad[:, i], atol=1e-5)


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "cylindrical", "ball"])
def test_joint_columns_are_those_of_finite_differences(kind: str) -> None:
    joint = Joint(kind, AXIS, np.array([0.01, 0.02, 0.0]), slide=(-0.1, 0.1), turn=(-2.0, 2.0))  # type: ignore[arg-type]
    screws = np.array([one.screw for one in Link(1, T_ROOT_PART, joint).freedoms])
    J, columns = np.zeros((6, 6 + len(screws))), np.arange(len(screws))
    jacobian(T_ROOT_PART, 1, np.ones(len(screws), np.int64), columns, screws, J)
    for d in range(len(screws)):
        link = Link(1, T_ROOT_PART, joint)
        step = np.zeros(len(screws))
        step[d] = 1e-6
        link.move(step)
        seen = twist_between(T_ROOT_PART, link.T_root_member)
        np.testing.assert_allclose(seen / 1e-6, J[:, 6 + d], atol=1e-5)


def test_newton_step_equals_numpy() -> None:
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(2, 6, 8))
    hessians = roots @ roots.transpose(0, 2, 1)
    gradients = rng.normal(size=(2, 6))
    screws, owners = rng.normal(size=(2, 6)), np.array([1, 1])
    poses = np.stack([np.eye(4), T_ROOT_PART])
    regularisation = rng.uniform(1, 2, 8)
    theta = np.zeros(8)
    assert newton_step(
        gradients,
        np.tril(hessians),
        poses,
        owners,
        np.arange(2),
        screws,
        regularisation,
        np.zeros((8, 8)),
        theta,
    )
    Ad = np.zeros((6, 6))
    adjoint(T_ROOT_PART, Ad)
    J0 = np.concatenate([np.eye(6), np.zeros((6, 2))], axis=1)
    J1 = np.concatenate([Ad, Ad @ screws.T], axis=1)
    A = J0.T @ hessians[0] @ J0 + J1.T @ hessians[1] @ J1 + np.diag(regularisation)
    np.testing.assert_allclose(theta, np.linalg.solve(A, J0.T @ gradients[0] + J1.T @ gradients[1]))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_step_that_is_no_number_moves_nothing(bad: float) -> None:
    group = Group(0, (), OptimizerConfig())
    poses = T_CAMERA_ROOT[None].copy()
    gradients = np.zeros((1, 6))
    gradients[0, 2] = bad
    assert not group.step(poses, gradients, np.zeros((1, 6, 6)))
    np.testing.assert_array_equal(poses[0], T_CAMERA_ROOT)


def test_tikhonov_alone_divides_the_gradient() -> None:
    group = Group(0, (), OptimizerConfig(rotation=1000.0, translation=30000.0))
    poses = np.eye(4)[None].copy()
    gradients = np.array([[1.0, 0.0, 0.0, 0.0, 30.0, 0.0]])
    assert group.step(poses, gradients, np.zeros((1, 6, 6)))
    np.testing.assert_allclose(
        twist_between(np.eye(4), poses[0]), [1e-3, 0, 0, 0, 1e-3, 0], atol=1e-9
    )


def test_a_joint_takes_only_what_it_may() -> None:
    joint = Joint("prismatic", AXIS, np.zeros(3), slide=(-0.001, 0.001))
    link = Link(1, T_ROOT_PART, joint)
    group = Group(0, [link], OptimizerConfig(rotation=1e9, translation=1e-6))
    poses = np.stack([T_CAMERA_ROOT, T_CAMERA_ROOT @ T_ROOT_PART])
    # The part is pulled along the axis and across it; the root is held by its own Hessian.
    pull = T_ROOT_PART[:3, :3].T @ (0.01 * AXIS + 0.02 * np.array([1.0, 0, 0]))
    gradients = np.stack([np.zeros(6), np.concatenate([np.zeros(3), pull])])
    hessians = np.stack([np.eye(6) * 1e9, np.diag([0.0, 0, 0, 1, 1, 1])])
    assert group.step(poses, gradients, hessians)
    assert link.slide == pytest.approx(0.001)
    np.testing.assert_allclose(poses[0], T_CAMERA_ROOT, atol=1e-8)
    np.testing.assert_allclose(poses[1], poses[0] @ link.T_root_member, atol=1e-12)
    travel = (inverse(poses[0]) @ poses[1])[:3, 3] - T_ROOT_PART[:3, 3]
    np.testing.assert_allclose(travel, 0.001 * AXIS, atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "slide", "turn"),
    [("cylindrical", 0.01, 0.5), ("revolute", 0.0, -1.2), ("prismatic", 0.02, 0.0)],
)
def test_a_link_adopts_an_observed_pose(kind: str, slide: float, turn: float) -> None:
    joint = Joint(kind, AXIS, np.array([0.01, 0, 0]), slide=(-0.05, 0.05), turn=(-2.0, 2.0))  # type: ignore[arg-type]
    there = Link(1, T_ROOT_PART, joint, slide=slide, turn=turn)
    link = Link(1, T_ROOT_PART, joint)
    link.adopt(there.T_root_member)
    assert (link.slide, link.turn) == pytest.approx((slide, turn))
    fixed = Link(1, T_ROOT_PART)
    fixed.adopt(there.T_root_member)
    np.testing.assert_array_equal(fixed.T_root_member, T_ROOT_PART)


HALF_TURN = transform_from(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))


@pytest.mark.parametrize("degrees", [0, 20, 45, 80, 90])
@pytest.mark.parametrize("kind", ["revolute", "cylindrical"])
@pytest.mark.parametrize("S", [np.eye(4), HALF_TURN])
def test_a_link_adopts_a_pose_that_looks_the_same(kind: str, degrees: float, S: np.ndarray) -> None:
    """A lever that looks the same after half a turn, on a hinge of a quarter of one."""
    axis, turn = T_ROOT_PART[:3, 2], np.deg2rad(degrees)
    ranges = {"turn": (0.0, np.pi / 2), "slide": (0.0, 0.02)}
    joint = Joint(kind, axis, T_ROOT_PART[:3, 3], **ranges)  # type: ignore[arg-type]
    slide = 0.01 if kind == "cylindrical" else 0.0
    there = Link(1, T_ROOT_PART, joint, slide=slide, turn=turn)
    link = Link(1, T_ROOT_PART, joint)
    link.adopt(there.T_root_member @ S, Symmetries(discrete=(HALF_TURN,)))
    assert (link.slide, link.turn) == pytest.approx((slide, turn), abs=1e-9)


def test_a_round_part_is_turned_about_its_joint_alone() -> None:
    """A bar across a shaft, turned about itself besides, as nobody can see."""
    joint = Joint("revolute", T_ROOT_PART[:3, 0], T_ROOT_PART[:3, 3], turn=(-2.0, 2.0))
    there, link = Link(1, T_ROOT_PART, joint, turn=1.2), Link(1, T_ROOT_PART, joint)
    spin = transform_from(rotation_about(np.array([0.0, 0, 1]), 2.5), np.zeros(3))
    axis = Axis(np.array([0.0, 0, 1]), np.zeros(3))
    link.adopt(there.T_root_member @ spin, Symmetries(continuous=(axis,)))
    assert link.turn == pytest.approx(1.2)


@pytest.mark.parametrize(("degrees", "held"), [(10, 10), (13.9, 13.9), (14.1, 14), (40, 14)])
def test_a_ball_is_held_at_its_rim(degrees: float, held: float) -> None:
    joint = Joint("ball", AXIS, np.array([0.01, 0, 0]), turn=(-np.deg2rad(14), np.deg2rad(14)))
    for axis in np.random.default_rng(0).normal(size=(100, 3)):
        seen, link = Link(1, T_ROOT_PART, joint), Link(1, T_ROOT_PART, joint)
        seen.R_ball = rotation_about(axis, np.deg2rad(degrees))
        link.adopt(seen.T_root_member)
        expected = rotation_about(axis, np.deg2rad(held))
        np.testing.assert_allclose(link.R_ball, expected, atol=1e-7)
        again = Link(1, T_ROOT_PART, joint)
        again.adopt(link.T_root_member)  # to within rounding of the rim
        np.testing.assert_allclose(again.R_ball, expected, atol=1e-7)


def geared(kind: str, *, member: int, **ranges: tuple[float, float]) -> Link:
    joint = Joint(kind, AXIS, np.array([0.01, 0.02, 0.0]), link="rack", **ranges)  # type: ignore[arg-type]
    return Link(member, T_ROOT_PART, joint)


def test_geared_joints_are_as_far_as_most_that_slide_say() -> None:
    """A wheel whose pose says something else, and one rack of three that is quite elsewhere."""
    racks = [geared("prismatic", member=k, slide=(-0.02, 0.06)) for k in (1, 2, 3)]
    wheel = geared("revolute", member=4, turn=(-1.0, 1.5))
    screw = geared("cylindrical", member=5, slide=(0.0, 0.04), turn=(-9.0, 9.0))
    for rack, at in zip(racks, (0.019, 0.021, -0.02), strict=True):
        rack.slide = at
    screw.slide, screw.turn, wheel.turn = 0.0195, 2.0, -0.9
    Group(0, [*racks, wheel, screw], OptimizerConfig())
    assert [rack.slide for rack in racks] == pytest.approx([0.019] * 3)
    assert wheel.turn == pytest.approx(-1.0 + 2.5 * 0.4875)
    assert screw.slide == pytest.approx(0.0195)
    assert screw.turn == 2.0, "what turns freely is turned as it was"


def test_where_nothing_slides_turns_tell_how_far_geared_joints_are() -> None:
    wheels = [geared("revolute", member=k, turn=(0.0, 2.0 * k)) for k in (1, 2)]
    wheels[0].turn, wheels[1].turn = 1.0, 2.4
    Group(0, wheels, OptimizerConfig())
    assert [wheel.turn for wheel in wheels] == pytest.approx([1.1, 2.2])
    alone = Link(1, T_ROOT_PART, Joint("prismatic", AXIS, np.zeros(3), slide=(0.0, 1.0)))
    assert alone.share is None


def test_a_rack_that_is_pulled_turns_its_wheel() -> None:
    rack = geared("prismatic", member=1, slide=(0.0, 0.05))
    wheel = geared("revolute", member=2, turn=(-1.0, 1.0))
    wheel.share = rack.share  # type: ignore[assignment]
    group = Group(0, [rack, wheel], OptimizerConfig(rotation=1e-9, translation=1e-9))
    poses = np.stack([T_CAMERA_ROOT, *(T_CAMERA_ROOT @ k.T_root_member for k in (rack, wheel))])
    pull = np.concatenate([np.zeros(3), T_ROOT_PART[:3, :3].T @ (0.01 * AXIS)])
    gradients = np.stack([np.zeros(6), pull, np.zeros(6)])
    hessians = np.stack([np.eye(6) * 1e9, np.diag([0.0, 0, 0, 1, 1, 1]), np.zeros((6, 6))])
    assert group.step(poses, gradients, hessians)
    assert 0.005 < rack.slide <= 0.0101
    assert wheel.share == pytest.approx(rack.share)
    np.testing.assert_allclose(poses[2], poses[0] @ wheel.T_root_member, atol=1e-12)
