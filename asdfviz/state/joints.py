"""How far an observed relative pose is from a nominal one, a joint's freedom left out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from asdfviz.datatypes import Joint, Part, State
from asdfviz.geometry.shapes import Rotation, Transform, Vector
from asdfviz.geometry.symmetry import Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import limited_rotation, rotation_about, rotation_angle

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
    for S in (None, *symmetries.discrete):
        T_equal = T_near if S is None else T_near @ S
        T_allowed = nearest_in_joint(T_equal, T_nominal, joint, center_part=center_part)
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
    gap = T_near[:3] - T_allowed[:3]
    x, y, z = (gap[:, :3] @ center_part + gap[:, 3]).tolist()
    angle = rotation_angle(T_near[:3, :3].T @ T_allowed[:3, :3])
    return Deviation(math.sqrt(x * x + y * y + z * z), angle)


def nearest_in_joint(
    T_base_part: Transform, T_nominal: Transform, joint: Joint, *, center_part: Vector
) -> Transform:
    """Return the pose nearest to `T_base_part` that the joint lets the nominal pose reach.

    The turn is the part of the motion's rotation about the axis (its twist), the slide the part of
    the centre's travel along it, each held to the joint's range. A ball without a range turns freely.
    """
    # Asked a hundred times a frame, so in plain numbers where numpy takes longer.
    T_turned = T_nominal.copy()
    if joint.kind != "prismatic":
        R_motion = T_base_part[:3, :3] @ T_nominal[:3, :3].T
        if joint.kind == "ball":
            turn = limited_rotation(R_motion, joint.turn)
        else:
            turn = rotation_about(joint.axis, nearest_turn(R_motion, joint))
        T_turned[:3, :3] = turn @ T_nominal[:3, :3]
        T_turned[:3, 3] = turn @ (T_nominal[:3, 3] - joint.origin) + joint.origin
    if joint.kind in ("prismatic", "cylindrical"):
        gap = T_base_part[:3] - T_turned[:3]
        travel = float((gap[:, :3] @ center_part + gap[:, 3]) @ joint.axis)
        T_turned[:3, 3] += min(max(travel, joint.slide[0]), joint.slide[1]) * joint.axis
    return T_turned


def nearest_turn(R_motion: Rotation, joint: Joint) -> float:
    """The part of a rotation in the base part's frame that is about a joint's axis, radians, held to the
    joint's range; -pi to pi where that is a whole turn."""
    (a, b, c), (d, e, f), (g, h, i) = R_motion.tolist()
    x, y, z = joint.axis.tolist()
    along = x * (a * x + b * y + c * z) + y * (d * x + e * y + f * z) + z * (g * x + h * y + i * z)
    twist = math.atan2(x * (h - f) + y * (c - g) + z * (d - b), a + e + i - along)
    low, high = joint.turn
    if high - low >= 2 * np.pi:
        return twist
    equal_turns = [twist + 2 * math.pi * turns for turns in range(-3, 4)]
    held = [(min(max(turn, low), high), turn) for turn in equal_turns]
    return min(held, key=lambda one: abs(one[0] - one[1]))[0]
