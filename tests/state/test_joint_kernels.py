from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Joint
from asdfviz.geometry.symmetry import Axis, Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import (
    limited_rotation,
    rotation_about,
    rotation_angle,
    transform_from,
)
from asdfviz.state.joint_kernels import nearest_alike
from asdfviz.state.joints import nearest_in_joint

X, Z = np.eye(3)[0], np.eye(3)[2]
MIDDLE = np.array([0.01, -0.02, 0.03])
HALF_TURN = transform_from(rotation_about(X, np.pi), np.array([0.0, 0.002, 0.004]))
KINDS = {
    "none": Symmetries(),
    "half a turn": Symmetries((HALF_TURN,)),
    "round": Symmetries((), (Axis(Z, MIDDLE),)),
    "round, and end for end": Symmetries((HALF_TURN,), (Axis(Z, MIDDLE),)),
    "ball": Symmetries((), (Axis(Z, MIDDLE), Axis(X, MIDDLE))),
}


def poses(count: int):
    rng = np.random.default_rng(5)
    for _ in range(count):
        axis, turn = rng.normal(size=3), rng.uniform(0, np.pi)
        yield transform_from(rotation_about(axis, turn), 0.1 * rng.normal(size=3))


@pytest.mark.parametrize("kind", KINDS)
def test_the_nearest_that_looks_alike_is_that_of_the_plain_definition(kind: str) -> None:
    symmetries = KINDS[kind]
    middle = symmetries.ball_middle
    packed = (
        np.array(symmetries.discrete).reshape(-1, 4, 4),
        np.array([[a.direction, a.offset] for a in symmetries.continuous]).reshape(-1, 2, 3),
        np.zeros((0, 3)) if middle is None else middle[None],
    )
    assert (middle is not None) == (kind == "ball")
    for T_a, T_b in zip(poses(20), list(poses(40))[20:], strict=True):
        told = nearest_alike(T_a, T_b, *packed)
        assert np.allclose(told, nearest_symmetric(T_a, T_b, symmetries), atol=1e-12)


@pytest.mark.parametrize("limit", [0.0, 0.5])
def test_a_ball_turns_as_all_points_tell_by_kabsch(limit: float) -> None:
    rng = np.random.default_rng(6)
    joint = Joint("ball", Z, MIDDLE, turn=(-limit, limit))
    points = rng.normal(size=(400, 3))
    # Deviation `spread` along each axis about the centre, and no correlation.
    points = np.linalg.solve(np.linalg.cholesky(np.cov(points.T, bias=True)), points.T).T
    points -= points.mean(axis=0)
    spread, centre = 0.02, np.array([0.05, 0.0, -0.01])
    points = centre + spread * points
    for T_seen, T_nominal in zip(poses(10), list(poses(20))[10:], strict=True):
        T = nearest_in_joint(T_seen, T_nominal, joint, center_part=centre, spread=spread)
        seen, placed = (points @ P[:3, :3].T + P[:3, 3] - joint.origin for P in (T_seen, T_nominal))
        U, _, Vt = np.linalg.svd(seen.T @ placed)
        R = limited_rotation(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt, joint.turn)
        turned = T[:3, :3] @ T_nominal[:3, :3].T
        assert rotation_angle(turned.T @ R) < 1e-6
        held = T_nominal[:3, 3] - joint.origin
        assert np.allclose(T[:3, 3], R @ held + joint.origin, atol=1e-9)
