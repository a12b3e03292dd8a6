"""Which of its equal poses the base has, where it looks the same turned: the one that the parts tell.

Everything that is joined is compared and placed in the base's frame. Of a base with symmetries the
picture tells this frame only up to one of them, so the other parts have to: the equal pose is taken
under which some state explains their places best, one for all of them, since they share the base. It is
kept from frame to frame until others explain the parts better for some time, and where no part tells.

The paper's bases have no symmetries; this is ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.symmetry import Axis, Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import apply_to_point, inverse, rotation_angle, turn_about
from asdfviz.state.relative_pose import RelativePoseConfig, joined_or_not
from asdfviz.state.twin_places import twin_places

MEMORY = 0.9
"""Share of its lead that the pose which was told keeps from frame to frame."""
MOST = 6.0
"""It never leads by more than this log odds: about two sure parts."""
SAME_TURN = 0.3
"""Poses turned by less than this are one that is told more exactly, radians."""
BESIDE = 0.005
"""A part this far from an axis shows by its place how far the base is turned about it, metres."""


class BaseTurns:
    """Tells the base's pose from those that look the same; one for each sequence."""

    def __init__(self, assembly: Assembly, *, config: RelativePoseConfig) -> None:
        """Take an assembly, and how near its parts' poses are to their places."""
        self._assembly, self._config = assembly, config
        self._symmetries = assembly.parts[assembly.base].symmetries
        self._last: Transform | None = None
        self._lead = 0.0

    def told(self, poses: Mapping[str, PoseEstimate]) -> dict[str, PoseEstimate]:
        """The poses, the base's so that the others are where a state may have them."""
        base = poses.get(self._assembly.base)
        if base is None or not self._symmetries.is_symmetric:
            return dict(poses)
        now = self.like_last(base.T_camera_part)
        same, others = (now, self._value(now, poses)), list[tuple[Transform, float]]()
        for T in equal_bases(now, poses, self._assembly):
            one = T, self._value(T, poses)
            if rotation_angle(now[:3, :3].T @ T[:3, :3]) > SAME_TURN:
                others.append(one)
            elif one[1] > same[1] + 1e-9:
                same = one
        best = max(others, key=lambda one: one[1], default=same)
        self._lead = min(MEMORY * self._lead + same[1] - best[1], MOST)
        # Poses between which nothing tells differ by rounding alone.
        if self._lead < -1e-6:
            same, self._lead = best, -self._lead
        self._last = same[0]
        return {**poses, base.part: replace(base, T_camera_part=self._last)}

    def like_last(self, T_camera_base: Transform) -> Transform:
        """A pose of the base, so turned that it is nearest to the one that was told last."""
        if self._last is None:
            return T_camera_base
        return nearest_symmetric(T_camera_base, self._last, self._symmetries)

    def _value(self, T_camera_base: Transform, poses: Mapping[str, PoseEstimate]) -> float:
        return odds_joined(poses, T_camera_base, self._assembly, config=self._config)


def odds_joined(
    poses: Mapping[str, PoseEstimate],
    T_camera_base: Transform,
    assembly: Assembly,
    *,
    config: RelativePoseConfig,
) -> float:
    """Log odds of the state that explains the parts best, with the base there, to nothing being joined.

    Where nothing else was found that any state joins, they are even: 0.
    """
    base = replace(poses[assembly.base], T_camera_part=T_camera_base)
    told = joined_or_not({**poses, base.part: base}, assembly, config=config)
    if told is None:
        return 0.0
    joined, alone = told
    return float(joined.max()) - alone


def equal_bases(
    T_camera_base: Transform, poses: Mapping[str, PoseEstimate], assembly: Assembly
) -> Iterator[Transform]:
    """Poses that look like the base's: of continuous ones, those under which some part is in its place."""
    symmetries = assembly.parts[assembly.base].symmetries
    for S in (np.eye(4), *symmetries.discrete):
        T_equal = T_camera_base @ S
        yield T_equal
        for name, T_base_part in _possible(poses, assembly) if symmetries.continuous else ():
            T_camera_part, middle = poses[name].T_camera_part, assembly.parts[name].middle
            T_told = T_camera_part @ inverse(T_base_part)
            seen = apply_to_point(inverse(T_equal) @ T_camera_part, middle)
            there = apply_to_point(T_base_part, middle)
            for axis in symmetries.continuous:
                angle = _turn(seen - axis.offset, there - axis.offset, axis)
                if angle is None:
                    yield nearest_symmetric(T_equal, T_told, Symmetries((), (axis,)))
                else:
                    yield T_equal @ turn_about(axis.direction, axis.offset, angle)
            if len(symmetries.continuous) > 1:
                yield nearest_symmetric(T_equal, T_told, symmetries)


def _possible(
    poses: Mapping[str, PoseEstimate], assembly: Assembly
) -> Iterator[tuple[str, Transform]]:
    """The parts that were found, with every T_base_part that they or their twins may have."""
    for twins in twin_places(assembly):
        places = [place.T_base_part for of in twins.values() for place in of]
        yield from product((name for name in twins if name in poses), places)


def _turn(seen: Vector, there: Vector, axis: Axis) -> float | None:
    """The turn about an axis that brings one point beside the other, radians; None on the axis."""
    d = axis.direction
    a, b = there - d * (d @ there), seen - d * (d @ seen)
    if min(np.linalg.norm(a), np.linalg.norm(b)) < BESIDE:
        return None
    return float(np.arctan2(d @ np.cross(a, b), a @ b))
