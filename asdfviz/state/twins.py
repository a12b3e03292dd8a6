"""Twins: parts of one detector class and one mesh, which no camera can tell apart.

What tells them apart is where they end: the one that lies at a place of the finished assembly goes by
the name that belongs there, whatever it was called while it lay about. Who follows them from frame to
frame knows besides which of them was where.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import product
from typing import TypeVar

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, point_distance
from asdfviz.state.joints import off_place

NEAR = 0.015
"""A part this near to a place, metres, is on it."""
FOLLOWED = 0.05
"""One this near to where it was, metres, may be the same."""
OWN_NAME = 0.003
"""Metres by which the name that a part has is preferred."""
NOT_THERE = 0.01
"""Metres by which any name is preferred to that of a part which surely is somewhere else."""

_Value = TypeVar("_Value")


def twin_groups(assembly: Assembly) -> tuple[tuple[str, ...], ...]:
    """All parts, in groups of those that cannot be told apart; one without twins stands alone."""
    groups: dict[tuple[str, bytes, bytes], list[str]] = {}
    for name, part in assembly.parts.items():
        key = (part.detector_class, part.mesh.vertices.tobytes(), part.mesh.faces.tobytes())
        groups.setdefault(key, []).append(name)
    return tuple(tuple(names) for names in groups.values())


def twins_by_name(assembly: Assembly) -> dict[str, tuple[str, ...]]:
    """Of every part the names of all that cannot be told from it, its own among them."""
    return {name: names for names in twin_groups(assembly) for name in names}


def loose_in_states(assembly: Assembly, names: Collection[str]) -> tuple[int, ...]:
    """How many of these parts every state leaves loose."""
    return tuple(sum(n not in state.T_base_part for n in names) for state in assembly.states)


class PlaceNames:
    """Names twins by where they lie; one for each assembly."""

    def __init__(self, assembly: Assembly) -> None:
        """Take an assembly, whose last step says where each name belongs."""
        self._assembly = assembly
        self._groups = [names for names in twin_groups(assembly) if len(names) > 1]

    def changes(
        self, poses: Mapping[str, Transform], *, held: Collection[str] = ()
    ) -> dict[str, str]:
        """From the names to be changed to the new ones: a permutation.

        Args:
            poses: T_camera_part of what was found, by the names they go by now; without the base
                part nothing changes.
            held: by the base in their places, whatever their poses say: they keep their names.
        """
        base = self._assembly.base
        if not self._groups or base not in poses:
            return {}
        T_base_camera = inverse(poses[base])
        changed: dict[str, str] = {}
        for group in self._groups:
            cost = np.full((len(group), len(group)), NEAR)
            for i, name in enumerate(group):
                if name in held:
                    cost[i, i] = -NEAR
                elif name in poses:
                    T_base_part = T_base_camera @ poses[name]
                    cost[i] = [self._distance(T_base_part, place) for place in group]
            changed |= _cheapest(group, cost)
        return changed

    def follows(
        self,
        poses: Mapping[str, Transform],
        before: Mapping[str, Transform],
        *,
        sure: Collection[str] = (),
    ) -> dict[str, str]:
        """From the names to be changed to those of the twins that were nearest: a permutation.

        Args:
            poses: T_camera_part of what was found, by the names they go by now.
            before: T_camera_part of what was known, by the right names.
            sure: to be where they are known, or seen there lately: what is found elsewhere is a twin
                that is not.
        """
        changed: dict[str, str] = {}
        for group in self._groups:
            middle = self._assembly.parts[group[0]].middle
            cost = np.full((len(group), len(group)), FOLLOWED)
            for (i, now), (j, then) in product(enumerate(group), repeat=2):
                if now in poses and then in before:
                    farthest = FOLLOWED + NOT_THERE if then in sure else FOLLOWED
                    apart = point_distance(poses[now], before[then], middle)
                    cost[i, j] = apart if apart < FOLLOWED else farthest
            changed |= _cheapest(group, cost)
        return changed

    def _distance(self, T_base_part: Transform, name: str) -> float:
        """From the place that belongs to a name, metres, none above NEAR."""
        done = self._assembly.steps[-1]
        if name not in done.T_base_part:
            return NEAR
        return min(off_place(T_base_part, self._assembly.parts[name], done).distance, NEAR)


def _cheapest(group: tuple[str, ...], cost: Float64[np.ndarray, "n n"]) -> Mapping[str, str]:
    """From the names that change (rows) to those they change to (columns)."""
    pairs = cheapest_pairs(cost - OWN_NAME * np.eye(len(group)))
    return {group[i]: group[j] for i, j in pairs if i != j}


def names_after(first: Mapping[str, str], then: Mapping[str, str]) -> dict[str, str]:
    """Both changes of names as one: from the old names to those that `then` gives the names of `first`."""
    both = {**then, **{old: then.get(new, new) for old, new in first.items()}}
    return {old: new for old, new in both.items() if old != new}


def renamed(values: Mapping[str, _Value], names: Mapping[str, str]) -> dict[str, _Value]:
    """The values by their new names."""
    return {names.get(name, name): value for name, value in values.items()}


def renamed_poses(
    poses: Mapping[str, PoseEstimate], names: Mapping[str, str]
) -> dict[str, PoseEstimate]:
    """The poses by their new names."""
    return {name: replace(pose, part=name) for name, pose in renamed(poses, names).items()}
