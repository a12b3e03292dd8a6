"""Two loose parts do not share space: what stands in another is taken for something that it is not.

Not in the paper. A small part fits what it is laid on: a hinge as thick as a spindle agrees with the
spindle's depth and outline, and is followed there. Joined parts do stand in one another, as a screw does in
its nut, and what is on its way there may seem to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.inside import Interior, inside, interior_of
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Points, Transform
from asdfviz.geometry.transforms import apply, apply_to_point, inverse
from asdfviz.state.joined_spots import JoinedSpots

SAMPLES = 150
"""Points of a part's surface that are tried."""


@dataclass(frozen=True)
class SharedSpaceConfig:
    """When two poses exclude each other."""

    enabled: bool = True
    """On or off."""
    share: float = 0.3
    """Of one part's surface at least so much is inside the other one: of 204 such pairs in six runs on five
    sequences 203 had a wrong pose, in all but 7 of them the less sure one's."""
    loose: float = 0.05
    """What is nearer to a place where a state joins it than this is not loose, metres."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 < self.share <= 1 or self.loose < 0:
            raise MethodError(
                f"shared_space.share is {self.share:g} and loose {self.loose:g}: share must be above 0 and "
                "at most 1, loose 0 or more, metres"
            )


class SharedSpace:
    """Knows the solids of an assembly's parts."""

    def __init__(self, assembly: Assembly, *, config: SharedSpaceConfig) -> None:
        """Begin a sequence; the base is left out, as everything is told from where it is."""
        self._config, self._base = config, assembly.base
        self._parts = {n: part for n, part in assembly.parts.items() if n != assembly.base}
        self._spots = JoinedSpots(assembly)
        self._solids: dict[str, tuple[Points, Interior]] = {}
        """Points of the surface, and what is inside it, of those that were asked for."""

    def intruders(self, poses: Mapping[str, PoseEstimate]) -> frozenset[str]:
        """The less sure one of every pair of loose parts that stand in one another; what a state placed is not.

        Without a pose of the base nobody is known to be loose.
        """
        base = poses.get(self._base)
        if base is None or not self._config.enabled:
            return frozenset()
        found = {n: poses[n] for n in self._parts if n in poses}
        Ts = {n: pose.T_camera_part for n, pose in found.items() if pose.stage != "group"}
        if len(Ts) < 2:
            return frozenset()
        near = self._touching(Ts)
        away = {
            name: self._spots.distance(name, Ts[name], base.T_camera_part)
            for name in {name for pair in near for name in pair}
        }
        return frozenset(
            min(pair, key=lambda name: poses[name].score)
            for pair in near
            if min(away[name] for name in pair) > self._config.loose
            and self._shared(*pair, Ts) >= self._config.share
        )

    def _touching(self, Ts: Mapping[str, Transform]) -> list[tuple[str, str]]:
        """The pairs of parts that are near enough to each other for it."""
        names = list(Ts)
        middles = np.array([apply_to_point(Ts[n], self._parts[n].middle) for n in names])
        reach = np.array([self._parts[n].diameter / 2 for n in names])
        gaps = np.linalg.norm(middles[:, None] - middles[None], axis=2) - reach[:, None] - reach
        rows, columns = np.nonzero(np.triu(gaps < 0, k=1))
        return [(names[i], names[j]) for i, j in zip(rows, columns, strict=True)]

    def _shared(self, a: str, b: str, Ts: Mapping[str, Transform]) -> float:
        """The share of either one's surface that is inside the other, the larger one."""
        T_b_a = inverse(Ts[b]) @ Ts[a]
        return max(self._inside(a, b, T_b_a), self._inside(b, a, inverse(T_b_a)))

    def _inside(self, a: str, b: str, T_b_a: Transform) -> float:
        (surface, _), (_, interior) = self._solid(a), self._solid(b)
        return float(inside(apply(T_b_a, surface), interior).mean())

    def _solid(self, name: str) -> tuple[Points, Interior]:
        """Prepared when it is first asked for: most parts never come near another one."""
        if name not in self._solids:
            mesh = self._parts[name].mesh
            surface = surface_points(mesh.vertices, mesh.faces, SAMPLES, seed=3)
            self._solids[name] = surface, interior_of(mesh.vertices[mesh.faces])
        return self._solids[name]
