"""Roughly where an assembly's states have its parts: what is farther away is loose."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, point_distance
from asdfviz.state.joint_places import JointPlaces


class JoinedSpots:
    """The places of all parts in all states, and how far joints let them go."""

    def __init__(self, assembly: Assembly) -> None:
        self._parts = assembly.parts
        joints = JointPlaces(assembly)
        self.places: dict[str, tuple[Transform, ...]] = {}
        """The different T_base_part of every part that any state joins."""
        self._reaches: dict[str, tuple[float, ...]] = {}
        for name in assembly.parts:
            found: dict[bytes, tuple[Transform, float]] = {}
            for state in assembly.states:
                if name in state.T_base_part and name != assembly.base:
                    T, joint = state.T_base_part[name], state.joints.get(name)
                    reach = 0.0 if joint is None else joints.reach(name, T, joint)
                    before = found.get(T.tobytes(), (T, 0.0))[1]
                    found[T.tobytes()] = T, max(reach, before)
            if found:
                self.places[name] = tuple(T for T, _ in found.values())
                self._reaches[name] = tuple(reach for _, reach in found.values())

    def distance(self, name: str, T_camera_part: Transform, T_camera_base: Transform) -> float:
        """How far a part is from where any state may have it, metres; infinite if none joins it."""
        T_base_part, middle = inverse(T_camera_base) @ T_camera_part, self._parts[name].middle
        places = zip(self.places.get(name, ()), self._reaches.get(name, ()), strict=True)
        beyond = (point_distance(T, T_base_part, middle) - reach for T, reach in places)
        return max(min(beyond, default=np.inf), 0.0)
