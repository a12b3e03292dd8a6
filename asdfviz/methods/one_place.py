"""Two parts are never in one place, unless the assembly joins them so.

A detector that takes one part for another puts both there, and a tracker holds both.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform, Vector
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
        reach = share * min(self._parts[a].diameter, self._parts[b].diameter)
        return float(np.linalg.norm(self._middle(a, Ts) - self._middle(b, Ts))) < reach

    def _middle(self, name: str, Ts: Mapping[str, Transform]) -> Vector:
        return apply_to_point(Ts[name], self._parts[name].middle)
