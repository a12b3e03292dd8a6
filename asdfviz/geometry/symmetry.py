"""Symmetries of a part: the transforms that leave its shape as it is.

A part's frame moves by a symmetry on the right: T_camera_part @ S looks the same as T_camera_part.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from asdfviz.geometry.shapes import Rotation, Transform, Transforms, Vector
from asdfviz.geometry.transforms import apply_to_point, rotation_angle, transform_from, turn_about

MEET = 1e-4
"""Axes that pass each other nearer than this meet, metres."""
ACROSS = 0.01
"""Sine of the angle from which two axes are not parallel."""


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """An axis that a part may be turned about freely."""

    direction: Vector
    """Unit vector in the part's frame."""
    offset: Vector
    """A point on the axis, metres, in the part's frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Symmetries:
    """Discrete symmetries (identity left out) and continuous ones, as in BOP's models_info."""

    discrete: tuple[Transform, ...] = ()
    continuous: tuple[Axis, ...] = ()

    @property
    def is_symmetric(self) -> bool:
        """Whether any pose but the true one looks the same."""
        return bool(self.discrete or self.continuous)

    def about(self, origin: Vector) -> Symmetries:
        """The same in a frame with the same axes and its origin at this point of the part's frame."""
        to, back = transform_from(np.eye(3), -origin), transform_from(np.eye(3), origin)
        return Symmetries(
            tuple(to @ S @ back for S in self.discrete),
            tuple(Axis(axis.direction, axis.offset - origin) for axis in self.continuous),
        )

    @property
    def ball_middle(self) -> Vector | None:
        """The point about which every rotation looks the same, part's frame; None: the part is no ball.

        Two axes that meet and are not parallel suffice: turns about them make up every rotation.
        """
        for a, b in combinations(self.continuous, 2):
            normal = np.cross(a.direction, b.direction)
            sine, gap = float(np.linalg.norm(normal)), b.offset - a.offset
            if sine > ACROSS and abs(float(gap @ normal)) / sine < MEET:
                along = float(np.cross(gap, b.direction) @ normal) / sine**2
                return a.offset + along * a.direction
        return None

    def transforms(self, *, step: float = 0.0) -> Transforms:
        """Every symmetric transform S, identity first, continuous axes cut into steps.

        Args:
            step: largest turn between neighbours, radians; 0 means BOP's ceil(pi / 0.01) = 315 steps.
        """
        count = 315 if step <= 0 else int(np.ceil(2 * np.pi / step))
        turns = [np.eye(4)]
        for axis in self.continuous:
            angles = np.arange(count) * (2 * np.pi / count)
            turns = [turn @ _turn_about(axis, angle) for turn in turns for angle in angles]
        return np.stack([turn @ S for S in (np.eye(4), *self.discrete) for turn in turns])


def _turn_about(axis: Axis, angle: float) -> Transform:
    return turn_about(axis.direction, axis.offset, angle)


def nearest_symmetric(
    T_camera_part: Transform, T_reference: Transform, symmetries: Symmetries
) -> Transform:
    """Return the equivalent T_camera_part @ S whose rotation is nearest to the reference's.

    Exact for one continuous axis, whose best turn is solved for, not searched, and for a ball.
    """
    if not symmetries.is_symmetric:
        return T_camera_part
    middle = symmetries.ball_middle
    if middle is not None:
        return _with_rotation(T_camera_part, T_reference[:3, :3], middle)
    best, best_angle = T_camera_part, np.inf
    for S in (None, *symmetries.discrete):
        candidate = T_camera_part if S is None else T_camera_part @ S
        for axis in symmetries.continuous:
            candidate = candidate @ _turn_about(axis, _best_turn(candidate, T_reference, axis))
        angle = rotation_angle(candidate[:3, :3].T @ T_reference[:3, :3])
        if angle < best_angle - 1e-12:
            best, best_angle = candidate, angle
    return best


def _with_rotation(T_camera_part: Transform, R_camera_part: Rotation, middle: Vector) -> Transform:
    """The pose turned so about a point of the part, which stays."""
    return transform_from(
        R_camera_part, apply_to_point(T_camera_part, middle) - R_camera_part @ middle
    )


def symmetric_angle(T_a: Transform, T_b: Transform, symmetries: Symmetries) -> float:
    """Smallest angle between two rotations of a part, radians; poses that look alike count as one."""
    T_near = nearest_symmetric(T_a, T_b, symmetries)
    return rotation_angle(T_near[:3, :3].T @ T_b[:3, :3])


def _best_turn(T_a: Transform, T_b: Transform, axis: Axis) -> float:
    """Angle about the axis that brings rotation a nearest to rotation b (maximal trace)."""
    R, d = T_a[:3, :3].T @ T_b[:3, :3], axis.direction
    (a, b, c), (e, f, g), (h, i, j) = R.tolist()
    skew = np.array([i - g, c - h, e - b])
    return float(np.arctan2(d @ skew, a + f + j - d @ R @ d))


def canonical(T_camera_part: Transform, symmetries: Symmetries) -> Transform:
    """Return the one representative of all equivalent poses that a network is taught.

    About a continuous axis the part is turned until a fixed direction across the axis points
    towards the camera; among discrete symmetries the one is taken whose frame looks most towards
    the camera. Both follow from the view alone, so equal images get equal labels. A ball's frame is
    turned as the camera's.
    """
    middle = symmetries.ball_middle
    if middle is not None:
        return _with_rotation(T_camera_part, np.eye(3), middle)
    best, best_key = T_camera_part, -np.inf
    for S in (np.eye(4), *symmetries.discrete):
        candidate = T_camera_part @ S
        for axis in symmetries.continuous:
            candidate = candidate @ _turn_about(axis, _turn_to_camera(candidate, axis))
        key = _facing(candidate)
        if key > best_key + 1e-9:
            best, best_key = candidate, key
    return best


def _turn_to_camera(T_camera_part: Transform, axis: Axis) -> float:
    # From the axis, not from the frame's origin, which moves when the part is turned.
    towards = -T_camera_part[:3, :3].T @ T_camera_part[:3, 3] - axis.offset
    x = across(axis.direction)
    y = np.cross(axis.direction, x)
    return float(np.arctan2(towards @ y, towards @ x))


def across(direction: Vector) -> Vector:
    """A fixed unit vector at right angles to `direction`, continuous almost everywhere."""
    basis = np.eye(3)[int(np.abs(direction).argmin())]
    side = basis - direction * (basis @ direction)
    return side / np.linalg.norm(side)


def _facing(T_camera_part: Transform) -> float:
    """A number that differs between symmetric poses: how far odd axes look at the camera."""
    towards = -T_camera_part[:3, :3].T @ T_camera_part[:3, 3]
    towards = towards / (np.linalg.norm(towards) + 1e-12)
    return float(towards @ np.array([1.0, 0.618, 0.382]))
