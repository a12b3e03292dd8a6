from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.symmetry import (
    Axis,
    Symmetries,
    across,
    canonical,
    nearest_symmetric,
    symmetric_angle,
)
from asdfviz.geometry.transforms import apply, rotation_about, rotation_angle, transform_from

Z = np.array([0.0, 0.0, 1.0])
TILTED = np.array([1.0, 2.0, -1.0]) / 6**0.5


def half_turn(axis: np.ndarray, through: np.ndarray | None = None) -> np.ndarray:
    R = rotation_about(axis, np.pi)
    point = np.zeros(3) if through is None else through
    return transform_from(R, point - R @ point)


def folds(count: int, axis: np.ndarray = Z) -> tuple[np.ndarray, ...]:
    turns = [rotation_about(axis, 2 * np.pi * k / count) for k in range(1, count)]
    return tuple(transform_from(R, np.zeros(3)) for R in turns)


KINDS = {
    "none": Symmetries(),
    "two-fold": Symmetries(discrete=folds(2)),
    "six-fold": Symmetries(discrete=folds(6)),
    "box": Symmetries(discrete=(half_turn(np.eye(3)[0]), half_turn(np.eye(3)[1]), half_turn(Z))),
    "two-fold off centre": Symmetries(discrete=(half_turn(Z, np.array([0.01, 0.02, 0.0])),)),
    "bolt": Symmetries(continuous=(Axis(Z, np.zeros(3)),)),
    "tilted bolt off centre": Symmetries(continuous=(Axis(TILTED, np.array([0.01, 0.0, 0.02])),)),
    "cylinder": Symmetries((half_turn(np.eye(3)[0]),), (Axis(Z, np.zeros(3)),)),
}
BALLS = {
    "two axes": Symmetries(continuous=(Axis(Z, np.zeros(3)), Axis(np.eye(3)[0], np.zeros(3)))),
    "two tilted axes that meet off centre": Symmetries(
        continuous=(
            Axis(Z, np.array([0.01, 0.02, -0.05])),
            Axis(TILTED, np.array([0.01, 0.02, 0.03]) + 0.2 * TILTED),
        )
    ),
    "three axes": Symmetries(continuous=tuple(Axis(d, np.zeros(3)) for d in np.eye(3))),
}
SYMMETRIC = [k for k in KINDS if k != "none"]


def poses(count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [
        transform_from(
            rotation_about(rng.normal(size=3), rng.uniform(0, np.pi)),
            rng.uniform([-0.2, -0.2, 0.4], [0.2, 0.2, 1.0]),
        )
        for _ in range(count)
    ]


def angle_between(T_a: np.ndarray, T_b: np.ndarray) -> float:
    return rotation_angle(T_a[:3, :3].T @ T_b[:3, :3])


def test_without_symmetry_there_is_the_identity_alone() -> None:
    transforms = KINDS["none"].transforms()
    np.testing.assert_array_equal(transforms, np.eye(4)[None])
    assert not KINDS["none"].is_symmetric


def test_continuous_axes_are_cut_as_in_bop() -> None:
    assert len(KINDS["bolt"].transforms()) == 315
    assert len(KINDS["cylinder"].transforms()) == 630
    assert len(KINDS["cylinder"].transforms(step=np.pi / 2)) == 8
    np.testing.assert_array_equal(KINDS["cylinder"].transforms()[0], np.eye(4))


@pytest.mark.parametrize("kind", KINDS)
def test_seen_from_another_point_the_same_poses_look_the_same(kind: str) -> None:
    origin = np.array([0.03, -0.01, 0.02])
    shift = transform_from(np.eye(3), origin)
    moved = KINDS[kind].about(origin).transforms(step=np.pi / 2)
    for S, S_moved in zip(KINDS[kind].transforms(step=np.pi / 2), moved, strict=True):
        np.testing.assert_allclose(shift @ S_moved, S @ shift, atol=1e-12)


def test_an_axis_stays_where_it_is() -> None:
    axis = KINDS["tilted bolt off centre"].continuous[0]
    on_axis = np.append(axis.offset + 0.03 * axis.direction, 1.0)
    for S in KINDS["tilted bolt off centre"].transforms(step=0.5):
        np.testing.assert_allclose(S @ on_axis, on_axis, atol=1e-12)


@pytest.mark.parametrize("kind", list(KINDS))
def test_nearest_symmetric_equals_brute_force(kind: str) -> None:
    symmetries = KINDS[kind]
    all_of_them = symmetries.transforms(step=0.002 if symmetries.continuous else 0.0)
    for T, reference in zip(poses(4), poses(4, seed=9), strict=True):
        found = nearest_symmetric(T, reference, symmetries)
        by_force = min(angle_between(T @ S, reference) for S in all_of_them)
        assert angle_between(found, reference) == pytest.approx(by_force, abs=1e-3)
        assert angle_between(found, reference) <= by_force + 1e-9
        # It is one of the symmetric poses, not merely a near rotation.
        S_found = np.linalg.inv(T) @ found
        assert min(np.abs(S_found - S).max() for S in all_of_them) < 2e-3


@pytest.mark.parametrize("kind", SYMMETRIC)
def test_nearest_symmetric_of_an_equivalent_pose_is_the_reference(kind: str) -> None:
    for T in poses(3):
        for S in KINDS[kind].transforms(step=0.7):
            assert angle_between(nearest_symmetric(T @ S, T, KINDS[kind]), T) < 1e-6


@pytest.mark.parametrize("kind", SYMMETRIC)
def test_canonical_is_the_same_for_all_equivalent_poses(kind: str) -> None:
    for T in poses(6):
        expected = canonical(T, KINDS[kind])
        for S in KINDS[kind].transforms(step=0.7):
            np.testing.assert_allclose(canonical(T @ S, KINDS[kind]), expected, atol=1e-6)


@pytest.mark.parametrize("kind", list(KINDS))
def test_canonical_is_an_equivalent_pose_and_settled(kind: str) -> None:
    symmetries = KINDS[kind]
    step = 0.002 if symmetries.continuous else 0.0
    for T in poses(2):
        found = canonical(T, symmetries)
        S_found = np.linalg.inv(T) @ found
        assert min(np.abs(S_found - S).max() for S in symmetries.transforms(step=step)) < 2e-3
        np.testing.assert_allclose(canonical(found, symmetries), found, atol=1e-6)


@pytest.mark.parametrize("kind", list(BALLS))
def test_every_rotation_of_a_ball_looks_the_same(kind: str) -> None:
    ball = BALLS[kind]
    middle = np.array([0.01, 0.02, 0.03]) if "off centre" in kind else np.zeros(3)
    assert ball.ball_middle == pytest.approx(middle, abs=1e-12)
    for T, reference in zip(poses(20), poses(20, seed=9), strict=True):
        assert symmetric_angle(T, reference, ball) < 1e-9
        settled = canonical(T, ball)
        for found in (nearest_symmetric(T, reference, ball), settled):
            np.testing.assert_allclose(apply(found, middle[None]), apply(T, middle[None]))
        turn = poses(1, seed=3)[0][:3, :3]
        equal = T @ transform_from(turn, middle - turn @ middle)
        np.testing.assert_allclose(canonical(equal, ball), settled, atol=1e-12)


@pytest.mark.parametrize("axes", [(Z, Z), (Z, np.eye(3)[0])])
def test_axes_that_are_parallel_or_do_not_meet_make_no_ball(
    axes: tuple[np.ndarray, np.ndarray],
) -> None:
    beside = np.array([0.0, 0.01, 0.0])
    pair = Symmetries(continuous=(Axis(axes[0], np.zeros(3)), Axis(axes[1], beside)))
    assert pair.ball_middle is None


def test_a_part_without_symmetry_keeps_its_pose() -> None:
    (T,) = poses(1)
    np.testing.assert_array_equal(canonical(T, KINDS["none"]), T)
    np.testing.assert_array_equal(nearest_symmetric(T, np.eye(4), KINDS["none"]), T)


@pytest.mark.parametrize("direction", [Z, TILTED, np.array([1.0, 0.0, 0.0])])
def test_across_is_a_unit_vector_at_right_angles(direction: np.ndarray) -> None:
    assert across(direction) @ direction == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(across(direction)) == pytest.approx(1)
