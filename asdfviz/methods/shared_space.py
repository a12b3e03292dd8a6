"""A loose part shares no space with another: what stands in one is taken for something that it is not.

Not in the paper. A small part fits what it is laid on: a hinge as thick as a spindle agrees with the
spindle's depth and outline, and is followed there; a ball that a socket hides, on the socket. Joined parts do
stand in one another, as a screw does in its nut, and what is on its way there may seem to.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
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
    """What is nearer to a place where a state joins it than this is not loose, metres;"""
    held: float = 0.03
    """and than this, where the other one is joined: of 148 such pairs in 25 runs on fifteen sequences 119 had
    the loose part more than 20 mm off, and 26 more a pin on a spindle, by 5 to 14."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 < self.share <= 1 or not min(self.loose, self.held) >= 0:
            raise MethodError(
                f"shared_space.share is {self.share:g}, loose {self.loose:g} and held {self.held:g}: share "
                "must be above 0 and at most 1, loose and held 0 or more, metres"
            )


class SharedSpace:
    """Knows the solids of an assembly's parts."""

    def __init__(self, assembly: Assembly, *, config: SharedSpaceConfig) -> None:
        """Begin a sequence."""
        self._config, self._base, self._parts = config, assembly.base, assembly.parts
        self._spots = JoinedSpots(assembly)
        self._solids: dict[str, tuple[Points, Interior]] = {}
        """Points of the surface, and what is inside it, of those that were asked for."""

    def intruders(
        self, poses: Mapping[str, PoseEstimate], *, held: Collection[str] = ()
    ) -> frozenset[str]:
        """The loose parts that stand in others: the less sure one of two that are loose, and what stands in
        one that is held.

        Without a pose of the base nobody is known to be loose; what a state placed is not.

        Args:
            poses: of the parts.
            held: those that surely are where the state has them, maybe the base among them.
        """
        base = poses.get(self._base)
        if base is None or not self._config.enabled:
            return frozenset()
        Ts = {n: pose.T_camera_part for n, pose in poses.items()}
        loose = {
            n
            for n, pose in poses.items()
            if pose.stage != "group" and n not in held and n != self._base
        }
        near = self._touching({n: T for n, T in Ts.items() if n in loose or n in held}, loose)
        away = {
            name: self._spots.distance(name, Ts[name], base.T_camera_part)
            for name in {name for pair in near for name in pair if name in loose}
        }
        return frozenset(
            min(pair, key=lambda name: (name in held, poses[name].score))
            for pair in near
            if self._is_away(pair, away) and self._shared(*pair, Ts) >= self._config.share
        )

    def _is_away(self, pair: tuple[str, str], away: Mapping[str, float]) -> bool:
        """Whether none of two is near where it belongs."""
        least = self._config.loose if all(name in away for name in pair) else self._config.held
        return min(away[name] for name in pair if name in away) > least

    def _touching(
        self, Ts: Mapping[str, Transform], loose: Collection[str]
    ) -> list[tuple[str, str]]:
        """The pairs of parts that are near enough to each other for it, a loose one in each."""
        names = list(Ts)
        if len(names) < 2:
            return []
        middles = np.array([apply_to_point(Ts[n], self._parts[n].middle) for n in names])
        reach = np.array([self._parts[n].diameter / 2 for n in names])
        gaps = np.linalg.norm(middles[:, None] - middles[None], axis=2) - reach[:, None] - reach
        rows, columns = np.nonzero(np.triu(gaps < 0, k=1))
        pairs = ((names[i], names[j]) for i, j in zip(rows, columns, strict=True))
        return [(a, b) for a, b in pairs if a in loose or b in loose]

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
