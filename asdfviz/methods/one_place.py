"""Two parts are never in one place, unless the assembly joins them so.

A detector that takes one part for another puts both there, and a tracker holds both.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping

import numpy as np

from asdfviz.datatypes import Assembly, Part
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point

NEAR = 0.4
"""Middles nearer than this times the smaller diameter are in one place."""
MAY_BE = 0.8
"""Parts that any state joins nearer than this times the smaller diameter may be."""


class OnePlace:
    """Knows which pairs of parts exclude each other."""

    def __init__(self, assembly: Assembly) -> None:
        """Take an assembly, whose states say which parts lie within each other."""
        self._parts = assembly.parts
        self._pairs = [
            pair
            for pair in itertools.combinations(assembly.parts, 2)
            if not any(self._near(*pair, state.T_base_part, MAY_BE) for state in assembly.states)
        ]

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
            for pair in self._pairs
            if self._near(*pair, Ts_camera_part, NEAR)
        )

    def _near(self, a: str, b: str, Ts: Mapping[str, Transform], share: float) -> bool:
        if a not in Ts or b not in Ts:
            return False
        return are_near(self._parts[a], Ts[a], self._parts[b], Ts[b], share=share)


def are_near(a: Part, T_a: Transform, b: Part, T_b: Transform, *, share: float = NEAR) -> bool:
    """Whether the middles of two parts are nearer than this share of the smaller diameter.

    Args:
        a: one part.
        T_a: its pose T_camera_part, or in any other frame.
        b: the other part.
        T_b: its pose in the same frame.
        share: see above.
    """
    apart = apply_to_point(T_a, a.middle) - apply_to_point(T_b, b.middle)
    return float(np.linalg.norm(apart)) < share * min(a.diameter, b.diameter)
