"""Two parts are never in one place, unless the assembly joins them so.

A detector that takes one part for another puts both there, and a tracker holds both.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping

import numpy as np

from asdfviz.datatypes import Assembly, Part, PoseEstimate, State
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.state.joint_places import JointPlaces
from asdfviz.state.twins import twin_groups

NEAR = 0.4
"""Middles nearer than this times the smaller diameter are in one place."""
MAY_BE = 0.8
"""Parts that any state joins nearer than this times the smaller diameter may be; yet they and twins are
not where they are twice as near as any state has them (the same two figures),"""
BESIDE = 0.3
"""if no joint brings their middles nearer than this times the smaller diameter."""


class OnePlace:
    """Knows which pairs of parts exclude each other."""

    def __init__(self, assembly: Assembly) -> None:
        """Take an assembly, whose states say which parts lie within each other."""
        self._parts = assembly.parts
        joints = JointPlaces(assembly)
        alike = [frozenset(group) for group in twin_groups(assembly)]
        self._limits: dict[tuple[str, str], float] = {}
        """How near to each other, metres, the middles of a pair are in one place."""
        for pair in itertools.combinations(assembly.parts, 2):
            a, b = (self._parts[name] for name in pair)
            may_be = MAY_BE * min(a.diameter, b.diameter)
            apart = min(
                (self._apart(*pair, s.T_base_part) for s in assembly.states), default=np.inf
            )
            # One taken for its twin lies where that does, however near they are when joined.
            if apart >= may_be or any(group.issuperset(pair) for group in alike):
                self._limits[pair] = NEAR / MAY_BE * min(apart, may_be)
                continue
            near = min(self._nearest(*pair, state, joints) for state in assembly.states)
            if near >= BESIDE * min(a.diameter, b.diameter):
                self._limits[pair] = NEAR / MAY_BE * near

    def intruders(
        self,
        Ts_camera_part: Mapping[str, Transform],
        sure: Mapping[str, float],
        *,
        joined: Collection[str] = (),
    ) -> frozenset[str]:
        """The less sure part of every pair that shares a place.

        Args:
            Ts_camera_part: poses found.
            sure: how probably each of them is right.
            joined: parts that the state holds; they stay.
        """
        return frozenset(
            min(pair, key=lambda name: (name in joined, sure[name]))
            for pair, limit in self._limits.items()
            if self._apart(*pair, Ts_camera_part) < limit
        )

    def alone(
        self, poses: Mapping[str, PoseEstimate], *, joined: Collection[str] = ()
    ) -> dict[str, PoseEstimate]:
        """The poses without intruders; `joined` as there."""
        Ts = {name: pose.T_camera_part for name, pose in poses.items()}
        out = self.intruders(Ts, {n: pose.score for n, pose in poses.items()}, joined=joined)
        return {name: pose for name, pose in poses.items() if name not in out}

    def _nearest(self, a: str, b: str, state: State, joints: JointPlaces) -> float:
        """Between the middles of two parts at least, metres, however a state's joints stand."""
        apart = self._apart(a, b, state.T_base_part)
        reaches = (
            joints.reach(name, state.T_base_part[name], state.joints.get(name))
            for name in (a, b)
            if name in state.joints
        )
        return apart if apart == np.inf else apart - sum(reaches)

    def _apart(self, a: str, b: str, Ts: Mapping[str, Transform]) -> float:
        """Between the middles of two parts, metres; inf where one of them has no pose."""
        if a not in Ts or b not in Ts:
            return np.inf
        return _distance(self._parts[a], Ts[a], self._parts[b], Ts[b])


def are_near(a: Part, T_a: Transform, b: Part, T_b: Transform, *, share: float = NEAR) -> bool:
    """Whether the middles of two parts are nearer than this share of the smaller diameter.

    Args:
        a: one part.
        T_a: its pose T_camera_part, or in any other frame.
        b: the other part.
        T_b: its pose in the same frame.
        share: see above.
    """
    return _distance(a, T_a, b, T_b) < share * min(a.diameter, b.diameter)


def _distance(a: Part, T_a: Transform, b: Part, T_b: Transform) -> float:
    return float(np.linalg.norm(apply_to_point(T_a, a.middle) - apply_to_point(T_b, b.middle)))
