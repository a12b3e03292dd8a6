"""The names of all twins: of those that lie in a place, and of the base where it has a twin.

Which of two equal plates is the base shows when something is joined to one of them: that is the base,
whatever it was called before.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.state.base_turns import MEMORY, MOST, equal_bases, odds_joined
from asdfviz.state.relative_pose import RelativePoseConfig
from asdfviz.state.twins import PlaceNames, names_after, renamed, renamed_poses, twin_groups

SURE = 4.0
"""Log odds by which a twin must explain the parts better than the base: more than one sure part in one
frame, so that what passes by says nothing."""


class PartNames(PlaceNames):
    """Names twins by where they lie, and the base by what is joined to it; one for each sequence."""

    def __init__(self, assembly: Assembly, *, config: RelativePoseConfig) -> None:
        """Take an assembly, and how near its parts' poses are to their places."""
        super().__init__(assembly)
        self._config = config
        groups = (names for names in twin_groups(assembly) if assembly.base in names)
        self._twins = [name for names in groups for name in names if name != assembly.base]
        self._lead = 0.0

    def changes(
        self, poses: Mapping[str, Transform], *, held: Collection[str] = ()
    ) -> dict[str, str]:
        """As `PlaceNames.changes` has it, and the base's name with them."""
        base = self._base_changes(poses, held)
        others = super().changes(renamed(poses, base), held=[base.get(name, name) for name in held])
        return names_after(base, others)

    def _base_changes(
        self, poses: Mapping[str, Transform], held: Collection[str]
    ) -> dict[str, str]:
        """The base's name and that of its twin to which parts are joined, if there is one."""
        base = self._assembly.base
        twins = [name for name in self._twins if name in poses and name not in held]
        if base not in poses or not twins:
            return {}
        seen = {name: PoseEstimate(name, T, 1.0, "refined") for name, T in poses.items()}
        values = {name: self._value(seen, {name: base, base: name}) for name in twins}
        best = max(twins, key=lambda name: values[name])
        self._lead = min(MEMORY * self._lead + self._value(seen, {}) - values[best], MOST)
        if self._lead > -SURE:
            return {}
        self._lead = -self._lead
        return {base: best, best: base}

    def _value(self, seen: Mapping[str, PoseEstimate], names: Mapping[str, str]) -> float:
        """Log odds of the state that explains the parts best to nothing being joined, by these names."""
        poses, assembly = renamed_poses(seen, names), self._assembly
        equal = equal_bases(poses[assembly.base].T_camera_part, poses, assembly)
        return max(0.0, *(odds_joined(poses, T, assembly, config=self._config) for T in equal))
