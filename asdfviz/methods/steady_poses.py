"""For how many frames parts have been found where they are.

Not in the paper. What is taken for a part by chance is taken for it now here, now there.
"""

from __future__ import annotations

from collections.abc import Mapping

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance
from asdfviz.state.twins import renamed, twins_by_name


class SteadyPoses:
    """Counts in one sequence."""

    def __init__(self, assembly: Assembly, *, apart: float, by_twins: bool = False) -> None:
        """Begin a sequence.

        Args:
            assembly: whose parts.
            apart: a part whose middle is no farther than this from where it was is there still, metres.
            by_twins: whether it counts, too, that one of its twins was there.
        """
        twins = twins_by_name(assembly)
        self._names = {name: twins[name] if by_twins else (name,) for name in assembly.parts}
        self._middles = {name: part.middle for name, part in assembly.parts.items()}
        self._apart = apart
        self._last: dict[str, tuple[Transform, int]] = {}

    def step(self, Ts_camera_part: Mapping[str, Transform]) -> dict[str, int]:
        """For how many frames before this one, one after another, every part was where it is."""
        counts = {name: self._frames(name, T) for name, T in Ts_camera_part.items()}
        self._last = {name: (Ts_camera_part[name], count) for name, count in counts.items()}
        return counts

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._last = renamed(self._last, names)

    def _frames(self, name: str, T_camera_part: Transform) -> int:
        middle = self._middles[name]
        known = [self._last[one] for one in self._names[name] if one in self._last]
        near = [n + 1 for T, n in known if point_distance(T, T_camera_part, middle) <= self._apart]
        return max(near, default=0)
