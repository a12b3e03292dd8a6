"""What `asdf_plus` finds where no hand could have brought the part since it was seen: less sure than it seems.

Not in the paper. While a part is hidden, the networks find the next best thing of its look, wherever that
is. A part seldom leaps, so whoever says that it did has to be surer than what was seen before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance
from asdfviz.state.twins import renamed, twins_by_name


@dataclass(frozen=True, slots=True)
class LeapsConfig:
    """How fast parts are, and how much is believed that seems faster."""

    speed: float = 0.5
    """Of a part in a hand, metres a second;"""
    slack: float = 0.05
    """so many metres more are no leap in any frame."""
    odds: float = 0.2
    """Factor on the odds that a pose is right which would be a leap; 1 believes all."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        for name in ("speed", "slack"):
            if not getattr(self, name) >= 0:
                raise MethodError(f"leaps.{name} is {getattr(self, name):g}, use 0 or more")
        if not 0 <= self.odds <= 1:
            raise MethodError(f"leaps.odds is {self.odds:g}, use 0 to 1")


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Where a part was seen last."""

    T_camera_part: Transform
    time: float
    sure: float
    """The best score since it came there, 0 to 1."""


class Leaps:
    """Remembers where the parts of one sequence were seen last."""

    def __init__(self, assembly: Assembly, *, config: LeapsConfig) -> None:
        """Begin a sequence."""
        self._parts, self._config = assembly.parts, config
        self._twins = twins_by_name(assembly)
        self._seen: dict[str, _Seen] = {}

    def step(self, poses: Mapping[str, PoseEstimate], time: float) -> dict[str, PoseEstimate]:
        """The poses of a frame, those less sure that a part leapt to.

        Args:
            poses: as found.
            time: of the frame, seconds.
        """
        doubted: dict[str, PoseEstimate] = {}
        seen: dict[str, _Seen] = {}
        for name, pose in poses.items():
            before, sure = self._nearest(name, pose.T_camera_part, time), pose.score
            if before is not None:
                leapt = self._beyond(name, before, pose.T_camera_part, time) > 0
                if leapt and pose.score < before.sure:
                    doubted[name] = replace(pose, score=self._doubted(pose.score))
                    continue
                sure = pose.score if leapt else max(pose.score, before.sure)
            doubted[name] = pose
            seen[name] = _Seen(pose.T_camera_part, time, sure)
        self._seen |= seen
        return doubted

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._seen = renamed(self._seen, names)

    def _nearest(self, name: str, T_camera_part: Transform, time: float) -> _Seen | None:
        """Of the part, or of a twin: their names are found out later."""
        if name not in self._seen:
            return None
        seen = [self._seen[twin] for twin in self._twins[name] if twin in self._seen]
        return min(seen, key=lambda one: self._beyond(name, one, T_camera_part, time))

    def _beyond(self, name: str, seen: _Seen, T_camera_part: Transform, time: float) -> float:
        """Metres that a pose is farther away than a hand could bring the part."""
        config = self._config
        way = point_distance(seen.T_camera_part, T_camera_part, self._parts[name].middle)
        return way - config.slack - config.speed * max(time - seen.time, 0.0)

    def _doubted(self, score: float) -> float:
        odds = self._config.odds * score
        return odds / (odds + 1 - score) if odds > 0 else 0.0
