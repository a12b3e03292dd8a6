"""Parts that are near their places and not in them: on their way in, or out.

From a centimetre or two away a part covers about what it covers in its place, so whoever looks at the
place alone takes it for joined. Its own pose tells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from asdfviz.datatypes import Assembly, PoseEstimate, State
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, point_distance
from asdfviz.state.colors import is_black
from asdfviz.state.joint_places import JointPlaces
from asdfviz.state.joints import off_place
from asdfviz.state.twins import twins_by_name

SURE = 0.5
"""Score from which a part is where its pose has it."""
ALIGNED = 0.4
"""A part is turned as in its place, within this, once it is near; one that is not has a doubtful pose, radians."""


class NearPlaces:
    """The places of all parts in all states of an assembly."""

    def __init__(self, assembly: Assembly, *, in_place: float, near: float, black: float) -> None:
        """Take an assembly.

        Args:
            assembly: whose states.
            in_place: farther from where any state has it a part is not joined, metres.
            near: nearer than this it is near, metres.
            black: of parts that are no brighter, 0 to 255, it is never sure: depth has them
                centimetres too deep.
        """
        self._assembly, self._in_place, self._near = assembly, in_place, near
        self._joints = JointPlaces(assembly)
        places = {
            (name, T.tobytes(), id(state.joints.get(name))): (name, state)
            for state in assembly.states
            for name, T in state.T_base_part.items()
            if name != assembly.base
        }
        self._places = {
            name: [place for place in places.values() if place[0] in names]
            for name, names in twins_by_name(assembly).items()
            if name != assembly.base and not is_black(assembly.parts[name].color, black)
        }
        """Of every part, where it or a twin is in some state."""

    def loose(
        self, T_camera_base: Transform, poses: Mapping[str, PoseEstimate]
    ) -> dict[str, Transform]:
        """T_base_part of all parts that surely are near one of their places and in none."""
        T_base_camera, found = inverse(T_camera_base), dict[str, Transform]()
        for name, places in self._places.items():
            pose = poses.get(name)
            if pose is not None and pose.score >= SURE and places:
                T_base_part = T_base_camera @ pose.T_camera_part
                if self._in_place < self._off(T_base_part, places) < self._near:
                    found[name] = T_base_part
        return found

    def _off(self, T_base_part: Transform, places: Sequence[tuple[str, State]]) -> float:
        """How far a part is from the nearest of some places, metres; infinite where that is far, or the
        part is turned otherwise."""
        least, parts, is_aligned = math.inf, self._assembly.parts, False
        for name, state in places:
            part, T_place = parts[name], state.T_base_part[name]
            # What it cannot reach needs no closer look, which takes long.
            reach = self._joints.reach(name, T_place, state.joints.get(name)) + self._near
            if point_distance(T_base_part, T_place, part.middle) < reach:
                off = off_place(T_base_part, part, state)
                if off.distance < least:
                    least, is_aligned = off.distance, off.angle < ALIGNED
            if least <= self._in_place:
                break
        return least if is_aligned else math.inf
