"""Rigid transforms as 4x4 matrices, named T_a_b: p_a = T_a_b @ p_b."""

from __future__ import annotations

import math

import numpy as np

from asdfviz.geometry.shapes import Points, Rotation, Transform, Vector

FARTHEST = 1e9
"""No translation is as long, metres: squares of longer ones would soon overflow."""


def transform_from(R: Rotation, t: Vector) -> Transform:
    """Build T_a_b from the rotation R_a_b and the translation t_a_b (metres)."""
    T = np.zeros((4, 4))
    T[:3, :3] = R
    T[:3, 3] = t
    T[3, 3] = 1.0
    return T


def inverse(T_a_b: Transform) -> Transform:
    """Return T_b_a without a general matrix inversion, so that it stays rigid."""
    R_b_a = T_a_b[:3, :3].T
    return transform_from(R_b_a, -R_b_a @ T_a_b[:3, 3])


def apply(T_a_b: Transform, points_b: Points) -> Points:
    """Move points from frame b to frame a."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def apply_to_point(T_a_b: Transform, point_b: Vector) -> Vector:
    """Move one point from frame b to frame a."""
    return T_a_b[:3, :3] @ point_b + T_a_b[:3, 3]


def point_distance(T_a_b: Transform, T_a_c: Transform, point: Vector) -> float:
    """How far apart both frames have a point of these coordinates, in the unit of the translations."""
    apart = (T_a_b - T_a_c)[:3]
    x, y, z = (apart[:, :3] @ point + apart[:, 3]).tolist()
    return math.sqrt(x * x + y * y + z * z)


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product of two vectors."""
    # Plain numbers: numpy takes thirty times as long for three of them.
    (p, q, r), (u, v, w) = a.tolist(), b.tolist()
    return np.array([q * w - r * v, r * u - p * w, p * v - q * u])


def is_rigid(T_a_b: Transform, *, tolerance: float = 1e-3) -> bool:
    """Whether the matrix is finite, right-handed, orthonormal, nearer than FARTHEST and ends in 0 0 0 1."""
    if not (np.abs(T_a_b) < FARTHEST).all():  # nor is NaN
        return False
    R = T_a_b[:3, :3]
    orthonormal = np.abs(R @ R.T - np.eye(3)).max() < tolerance and np.linalg.det(R) > 0
    return bool(orthonormal and np.abs(T_a_b[3] - [0, 0, 0, 1]).max() < tolerance)


def orthonormalized(T_a_b: Transform) -> Transform:
    """Return the nearest rigid transform, to undo the rounding of a text file."""
    U, _, Vt = np.linalg.svd(T_a_b[:3, :3])
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return transform_from(R, T_a_b[:3, 3].copy())


def rotation_angle(R: Rotation) -> float:
    """Return the angle of a rotation in radians, 0 to pi; exact near both ends."""
    # Plain numbers: numpy takes ten times as long for nine of them.
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    x, y, z = h - f, c - g, d - b
    return math.atan2(math.sqrt(x * x + y * y + z * z), a + e + i - 1.0)


def rotation_about(axis: Vector, angle: float) -> Rotation:
    """Rotation by `angle` radians about `axis` (any length but zero), by Rodrigues' formula."""
    a, b, c = axis.tolist()
    length = math.sqrt(a * a + b * b + c * c)
    x, y, z = a / length, b / length, c / length
    sine, rest = math.sin(angle), 1.0 - math.cos(angle)
    return np.array(
        [
            [1.0 - rest * (y * y + z * z), rest * x * y - sine * z, rest * x * z + sine * y],
            [rest * x * y + sine * z, 1.0 - rest * (x * x + z * z), rest * y * z - sine * x],
            [rest * x * z - sine * y, rest * y * z + sine * x, 1.0 - rest * (x * x + y * y)],
        ]
    )


def turn_about(axis: Vector, point: Vector, angle: float) -> Transform:
    """Turn by `angle` radians about the axis (any length but zero) through a point, same frame."""
    R = rotation_about(axis, angle)
    return transform_from(R, point - R @ point)


def limited_rotation(R: Rotation, turn: tuple[float, float]) -> Rotation:
    """The rotation nearest to one within a ball joint's range, radians; without a range it is as it was."""
    angle = rotation_angle(R)
    limit = max(abs(turn[0]), abs(turn[1])) or np.pi
    if angle <= limit:
        return R
    # The axis is the eigenvector to eigenvalue 1, which is well defined even at a half turn.
    values, vectors = np.linalg.eig(R)
    axis = np.real(vectors[:, int(np.abs(values - 1).argmin())])
    ends = [rotation_about(axis, limit), rotation_about(axis, -limit)]
    return min(ends, key=lambda R_end: rotation_angle(R_end.T @ R))


def turns_freely(turn: tuple[float, float]) -> bool:
    """Whether a joint of this range, radians, turns so far that its link does not tell how far."""
    return turn[1] - turn[0] > 1.9 * np.pi
