"""Roughly where an assembly's states have its parts: what is farther away is loose."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Assembly, Joint, Part
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, point_distance
from asdfviz.state.joints import nearest_in_joint, spread_of


class JoinedSpots:
    """The places of all parts in all states, and how far joints let them go."""

    def __init__(self, assembly: Assembly) -> None:
        self._parts = assembly.parts
        self.places: dict[str, tuple[Transform, ...]] = {}
        """The different T_base_part of every part that any state joins."""
        self._joints: dict[str, list[tuple[Transform, Joint | None]]] = {}
        """The same with the different joints of each."""
        for name in assembly.parts:
            found: dict[tuple[bytes, int], tuple[Transform, Joint | None]] = {}
            for state in assembly.states:
                if name in state.T_base_part and name != assembly.base:
                    T, joint = state.T_base_part[name], state.joints.get(name)
                    found[T.tobytes(), id(joint)] = T, joint
            if found:
                self._joints[name] = list(found.values())
                self.places[name] = tuple({key: T for (key, _), (T, _) in found.items()}.values())

    def distance(self, name: str, T_camera_part: Transform, T_camera_base: Transform) -> float:
        """How far a part is from where any state may have it, metres; infinite if none joins it."""
        T_base_part, part = inverse(T_camera_base) @ T_camera_part, self._parts[name]
        places = self._joints.get(name, ())
        return min((_beyond(part, T_base_part, *place) for place in places), default=np.inf)


def _beyond(part: Part, T_base_part: Transform, T_nominal: Transform, joint: Joint | None) -> float:
    """How far a part's middle is from where the joint lets it be, however it looks the same."""
    if joint is None:
        return point_distance(T_nominal, T_base_part, part.middle)
    same = [T_base_part, *(T_base_part @ S for S in part.symmetries.discrete)]
    near = [
        nearest_in_joint(T, T_nominal, joint, center_part=part.middle, spread=spread_of(part))
        for T in same
    ]
    return min(point_distance(T, T_near, part.middle) for T, T_near in zip(same, near, strict=True))
