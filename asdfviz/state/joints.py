"""How far an observed relative pose is from a nominal one, a joint's freedom left out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from asdfviz.datatypes import Joint, Part, State
from asdfviz.geometry.shapes import Rotation, Transform, Vector
from asdfviz.geometry.symmetry import Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import (
    apply_to_point,
    inverse,
    rotation_about,
    rotation_angle,
    transform_from,
)

CLOSE = math.radians(5.0)
"""Rotations nearer than this are not compared with others that look the same."""


class Deviation(NamedTuple):
    """What is left between two poses of a part in the base part's frame."""

    distance: float
    """Between the part's centres, metres."""
    angle: float
    """Between the rotations, radians."""

    def within(self, distance: float, angle_deg: float) -> bool:
        """Whether both are less than this, metres and degrees."""
        return self.distance < distance and self.angle < math.radians(angle_deg)


def deviation(
    T_base_part: Transform,
    T_nominal: Transform,
    *,
    center_part: Vector,
    symmetries: Symmetries,
    joint: Joint | None = None,
) -> Deviation:
    """Return how far `T_base_part` is from the nearest pose that looks and moves like the nominal.

    Args:
        T_base_part: the observed pose in the base part's frame.
        T_nominal: where the state has the part, same frame.
        center_part: the part's middle in its own frame; distances are taken there, because the
            CAD frame's origin may lie far outside the part.
        symmetries: poses that look the same count as the same.
        joint: what the joined part may still do; poses within its range count as the same.
    """
    T_near = nearest_symmetric(T_base_part, T_nominal, symmetries)
    if joint is None:
        return _apart(T_near, T_nominal, center_part)
    # The nearest to the nominal may be out of the joint's range, and another that looks the same in it.
    found: list[Deviation] = []
    for S in (np.eye(4), *symmetries.discrete):
        T_allowed = nearest_in_joint(T_near @ S, T_nominal, joint, center_part=center_part)
        T_same = nearest_symmetric(T_base_part, T_allowed, symmetries)
        found.append(_apart(T_same, T_allowed, center_part))
        if found[-1].angle < CLOSE or joint.turn[0] == joint.turn[1]:
            break
    return min(found, key=lambda off: off.angle)


def off_place(T_base_part: Transform, part: Part, state: State) -> Deviation:
    """Return how far a part in the base part's frame is from where a state that places it has it."""
    return deviation(
        T_base_part,
        state.T_base_part[part.name],
        center_part=part.middle,
        symmetries=part.symmetries,
        joint=state.joints.get(part.name),
    )


def _apart(T_near: Transform, T_allowed: Transform, center_part: Vector) -> Deviation:
    between = apply_to_point(T_near, center_part)
    between = between - apply_to_point(T_allowed, center_part)
    return Deviation(
        float(np.linalg.norm(between)), rotation_angle(T_near[:3, :3].T @ T_allowed[:3, :3])
    )


def nearest_in_joint(
    T_base_part: Transform, T_nominal: Transform, joint: Joint, *, center_part: Vector
) -> Transform:
    """Return the pose nearest to `T_base_part` that the joint lets the nominal pose reach.

    The turn is the part of the motion's rotation about the axis (its twist), the slide the part of
    the centre's travel along it, each held to the joint's range. A ball without a range turns freely.
    """
    R_motion = (T_base_part @ inverse(T_nominal))[:3, :3]
    turn = np.eye(3)
    if joint.kind == "ball":
        turn = _limited_rotation(R_motion, joint.turn)
    elif joint.kind in ("revolute", "cylindrical"):
        turn = rotation_about(joint.axis, nearest_turn(R_motion, joint))
    T_turned = transform_from(turn, joint.origin - turn @ joint.origin) @ T_nominal
    if joint.kind in ("prismatic", "cylindrical"):
        travel = (T_base_part - T_turned)[:3] @ np.append(center_part, 1.0)
        T_turned[:3, 3] += np.clip(travel @ joint.axis, *joint.slide) * joint.axis
    return T_turned


def nearest_turn(R_motion: Rotation, joint: Joint) -> float:
    """The part of a rotation in the base part's frame that is about a joint's axis, radians, held to the
    joint's range; -pi to pi where that is a whole turn."""
    skew = np.array(
        [
            R_motion[2, 1] - R_motion[1, 2],
            R_motion[0, 2] - R_motion[2, 0],
            R_motion[1, 0] - R_motion[0, 1],
        ]
    )
    d = joint.axis
    twist = float(np.arctan2(d @ skew, np.trace(R_motion) - d @ R_motion @ d))
    low, high = joint.turn
    if high - low >= 2 * np.pi:
        return twist
    equal_turns = twist + 2 * np.pi * np.arange(-3, 4)
    held = np.clip(equal_turns, low, high)
    return float(held[np.abs(held - equal_turns).argmin()])


def _limited_rotation(R_motion: Rotation, turn: tuple[float, float]) -> Rotation:
    angle = rotation_angle(R_motion)
    limit = max(abs(turn[0]), abs(turn[1])) or np.pi
    if angle <= limit:
        return R_motion
    # The axis is the eigenvector to eigenvalue 1, which is well defined even at a half turn.
    values, vectors = np.linalg.eig(R_motion)
    axis = np.real(vectors[:, int(np.abs(values - 1).argmin())])
    ends = [rotation_about(axis, limit), rotation_about(axis, -limit)]
    return min(ends, key=lambda R: rotation_angle(R.T @ R_motion))
