"""For how many frames parts have been found where they are, by whichever of their twins' names.

Not in the paper. What is taken for a part by chance is taken for it now here, now there.
"""

from __future__ import annotations

from collections.abc import Mapping

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance
from asdfviz.state.twins import twins_by_name

APART = 0.006
"""A part whose middle is nearer than this to where it was is there still, metres."""


class SteadyPoses:
    """Counts in one sequence."""

    def __init__(self, assembly: Assembly) -> None:
        self._twins = twins_by_name(assembly)
        self._middles = {name: part.middle for name, part in assembly.parts.items()}
        self._last: dict[str, tuple[Transform, int]] = {}

    def step(self, poses: Mapping[str, PoseEstimate]) -> dict[str, int]:
        """For how many frames before this one, one after another, every part was where it is."""
        counts = {name: self._frames(name, pose.T_camera_part) for name, pose in poses.items()}
        self._last = {n: (poses[n].T_camera_part, count) for n, count in counts.items()}
        return counts

    def _frames(self, name: str, T_camera_part: Transform) -> int:
        middle = self._middles[name]
        known = [self._last[twin] for twin in self._twins[name] if twin in self._last]
        near = [n + 1 for T, n in known if point_distance(T, T_camera_part, middle) < APART]
        return max(near, default=0)
