"""How far an observed relative pose is from a nominal one, a joint's freedom left out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Joint, Part, State
from asdfviz.geometry.shapes import Rotation, Transform, Vector
from asdfviz.geometry.symmetry import Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import (
    apply_to_point,
    limited_rotation,
    rotation_about,
    rotation_angle,
)

CLOSE = math.radians(5.0)
"""Rotations nearer than this are not compared with others that look the same."""


SPREAD = 0.2
"""Of a part's diameter."""


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
    spread: float | None = None,
) -> Deviation:
    """Return how far `T_base_part` is from the nearest pose that looks and moves like the nominal.

    Args:
        T_base_part: the observed pose in the base part's frame.
        T_nominal: where the state has the part, same frame.
        center_part: the part's middle in its own frame; distances are taken there, because the
            CAD frame's origin may lie far outside the part.
        symmetries: poses that look the same count as the same.
        joint: what the joined part may still do; poses within its range count as the same.
        spread: of the part, as `nearest_in_joint` takes it.
    """
    T_near = nearest_symmetric(T_base_part, T_nominal, symmetries)
    if joint is None:
        return _apart(T_near, T_nominal, center_part)
    # The nearest to the nominal may be out of the joint's range, and another that looks the same in it.
    found: list[Deviation] = []
    for S in (None, *symmetries.discrete):
        T_equal = T_near if S is None else T_near @ S
        T_allowed = nearest_in_joint(
            T_equal, T_nominal, joint, center_part=center_part, spread=spread
        )
        T_same = nearest_symmetric(T_base_part, T_allowed, symmetries)
        found.append(_apart(T_same, T_allowed, center_part))
        if found[-1].angle < CLOSE or joint.turn[0] == joint.turn[1]:
            break
    return min(found, key=lambda off: off.angle)


def off_place(T_base_part: Transform, part: Part, state: State) -> Deviation:
    """Return how far a part in the base part's frame is from where a state that places it has it."""
    return off_nominal(T_base_part, part, state.T_base_part[part.name], state.joints.get(part.name))


def off_nominal(
    T_base_part: Transform, part: Part, T_nominal: Transform, joint: Joint | None
) -> Deviation:
    """Return how far a part in the base part's frame is from a nominal pose, its joint's freedom left out."""
    return deviation(
        T_base_part,
        T_nominal,
        center_part=part.middle,
        symmetries=part.symmetries,
        joint=joint,
        spread=spread_of(part),
    )


def spread_of(part: Part) -> float:
    """Deviation of a part's surface from its middle along each axis, metres, about."""
    return SPREAD * part.diameter


def _apart(T_near: Transform, T_allowed: Transform, center_part: Vector) -> Deviation:
    gap = T_near[:3] - T_allowed[:3]
    x, y, z = (gap[:, :3] @ center_part + gap[:, 3]).tolist()
    angle = rotation_angle(T_near[:3, :3].T @ T_allowed[:3, :3])
    return Deviation(math.sqrt(x * x + y * y + z * z), angle)


def nearest_in_joint(
    T_base_part: Transform,
    T_nominal: Transform,
    joint: Joint,
    *,
    center_part: Vector,
    spread: float | None = None,
) -> Transform:
    """Return the pose nearest to `T_base_part` that the joint lets the nominal pose reach.

    The turn is that after which the part's points are nearest to where they are in `T_base_part`
    (Kabsch 1976), or by its rotation alone, the slide the part of the centre's travel along the axis,
    each held to the joint's range. A ball without a range turns freely.

    Args:
        T_base_part: the observed pose in the base part's frame.
        T_nominal: where the state has the part, same frame.
        joint: what it may still do there.
        center_part: the part's middle in its own frame, metres.
        spread: of its points about that along each axis, metres: a part on a long arm is turned as its
            place tells, one in the middle of its joint as its rotation does. None: as that does always.
    """
    # Asked a hundred times a frame, so in plain numbers where numpy takes longer.
    T_turned = T_nominal.copy()
    if joint.kind != "prismatic":
        motion = T_base_part[:3, :3] @ T_nominal[:3, :3].T
        if spread is not None:
            seen, placed = (apply_to_point(T, center_part) for T in (T_base_part, T_nominal))
            motion = spread**2 * motion + np.outer(seen - joint.origin, placed - joint.origin)
        if joint.kind == "ball":
            turn = limited_rotation(_nearest_rotation(motion), joint.turn)
        else:
            turn = rotation_about(joint.axis, nearest_turn(motion, joint))
        T_turned[:3, :3] = turn @ T_nominal[:3, :3]
        T_turned[:3, 3] = turn @ (T_nominal[:3, 3] - joint.origin) + joint.origin
    if joint.kind in ("prismatic", "cylindrical"):
        gap = T_base_part[:3] - T_turned[:3]
        travel = float((gap[:, :3] @ center_part + gap[:, 3]) @ joint.axis)
        T_turned[:3, 3] += min(max(travel, joint.slide[0]), joint.slide[1]) * joint.axis
    return T_turned


def _nearest_rotation(motion: Float64[np.ndarray, "3 3"]) -> Rotation:
    """The rotation that is nearest to a sum of products of points, seen by placed."""
    U, _, Vt = np.linalg.svd(motion)
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt


def nearest_turn(motion: Float64[np.ndarray, "3 3"], joint: Joint) -> float:
    """The part of a rotation in the base part's frame, or of a sum of products of points, that is about a
    joint's axis, radians, held to the joint's range; -pi to pi where that is a whole turn."""
    (a, b, c), (d, e, f), (g, h, i) = motion.tolist()
    x, y, z = joint.axis.tolist()
    along = x * (a * x + b * y + c * z) + y * (d * x + e * y + f * z) + z * (g * x + h * y + i * z)
    twist = math.atan2(x * (h - f) + y * (c - g) + z * (d - b), a + e + i - along)
    low, high = joint.turn
    if high - low >= 2 * np.pi:
        return twist
    equal_turns = [twist + 2 * math.pi * turns for turns in range(-3, 4)]
    held = [(min(max(turn, low), high), turn) for turn in equal_turns]
    return min(held, key=lambda one: abs(one[0] - one[1]))[0]
