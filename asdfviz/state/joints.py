"""How far an observed relative pose is from a nominal one, a joint's freedom left out."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Joint, Part, State
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.symmetry import Symmetries

SPREAD = 0.2
"""Of a part's diameter."""

_Range: TypeAlias = Float64[np.ndarray, "2"]
_PackedJoint: TypeAlias = tuple[int, Vector, Vector, _Range, _Range]
_PackedSymmetries: TypeAlias = tuple[
    Float64[np.ndarray, "n 4 4"], Float64[np.ndarray, "m 2 3"], Float64[np.ndarray, "middles 3"]
]


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
    gap, angle = _kernels().deviation(
        T_base_part,
        T_nominal,
        center_part,
        -1.0 if spread is None else spread,
        _packed_joint(joint),
        _packed(symmetries),
    )
    return Deviation(gap, angle)


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
    spread = -1.0 if spread is None else spread
    return _kernels().nearest_held(
        T_base_part, T_nominal, center_part, spread, *_packed_joint(joint)
    )


@functools.cache
def _kernels() -> Any:
    """The compiled loops. They need numba, which is absent where networks are trained: parts are loaded
    there, but none is compared."""
    from asdfviz.state import joint_kernels

    return joint_kernels


@functools.lru_cache(maxsize=1024)
def _packed_joint(joint: Joint | None) -> _PackedJoint:
    """A joint as the compiled loops take it."""
    kernels = _kernels()
    if joint is None:
        nothing = np.zeros(3)
        return kernels.FREE, nothing, nothing, np.zeros(2), np.zeros(2)
    kind = {
        "prismatic": kernels.PRISMATIC,
        "revolute": kernels.REVOLUTE,
        "cylindrical": kernels.CYLINDRICAL,
        "ball": kernels.BALL,
    }[joint.kind]
    return kind, joint.axis, joint.origin, np.array(joint.turn), np.array(joint.slide)


@functools.lru_cache(maxsize=1024)
def _packed(symmetries: Symmetries) -> _PackedSymmetries:
    """Symmetries as the compiled loops take them."""
    axes = [np.stack([axis.direction, axis.offset]) for axis in symmetries.continuous]
    middle = symmetries.ball_middle
    return (
        np.stack(symmetries.discrete) if symmetries.discrete else np.zeros((0, 4, 4)),
        np.stack(axes) if axes else np.zeros((0, 2, 3)),
        np.zeros((0, 3)) if middle is None else middle[None].copy(),
    )


def nearest_turn(motion: Float64[np.ndarray, "3 3"], joint: Joint) -> float:
    """The part of a rotation in the base part's frame, or of a sum of products of points, that is about a
    joint's axis, radians, held to the joint's range; -pi to pi where that is a whole turn."""
    _, axis, _, turn, _ = _packed_joint(joint)
    return _kernels().nearest_turn(np.ascontiguousarray(motion), axis, turn)
