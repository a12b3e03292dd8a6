"""What the table says of turns of a part: one that has it stand in the table, or lie on a side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.shapes import Points, Transform
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import table_near
from asdfviz.pose.standing import (
    RestConfig,
    Stance,
    height_above,
    sides,
    standing_on,
)
from asdfviz.pose.table import SunkConfig, Table


@dataclass(frozen=True)
class TurnTableConfig:
    """What the table says of turns; the paper has no such step."""

    enabled: bool = True
    """On or off."""
    sunk: SunkConfig = field(default_factory=SunkConfig)
    """Against those that have the part stand in it."""
    rest: RestConfig = field(default_factory=RestConfig)
    """For those that have it lie on a side."""
    worse: float = 0.05
    """A pose against which it speaks by this more than against the part's own is ruled out at once,"""
    place: float = 0.3
    """if their centres are nearer than this share of the part's diameter: what was moved may be lower."""
    lies_deg: float = 30.0
    """A part lies on the table that is turned from a side by no more than this, degrees,"""
    lies: float = 0.012
    """and whose lowest corner is nearer to it than this, metres. Before such a one is turned, it is laid
    down in both turns, and they are compared once more; at 0 none lies there."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.worse, self.place, self.lies_deg, self.lies) < 0:
            raise MethodError(
                f"turns.table.worse is {self.worse:g}, place {self.place:g}, lies_deg {self.lies_deg:g} "
                f"and lies {self.lies:g}: use 0 or more"
            )


class TurnTable:
    """The table in the frames of one sequence, and how its parts could stand on it."""

    def __init__(self, parts: Mapping[str, Part], *, config: TurnTableConfig) -> None:
        """Begin a sequence."""
        self._config = config
        self._stances: dict[str, Stance] = {}
        if config.enabled:
            self._stances = {
                n: Stance(hull_corners(p.mesh.vertices), sides(p.mesh), config.sunk, config.rest)
                for n, p in parts.items()
            }
        self._looked: dict[str, tuple[Frame, Transform, Table | None]] = {}

    def said(
        self, frame: Frame, name: str, T_now: Transform, T_other: Transform
    ) -> tuple[float, float]:
        """By how much it speaks for another pose of a part rather, and by how much against it."""
        table = self.near(frame, name, T_now)
        if table is None or frame.depth is None:
            return 0.0, 0.0
        stance, both, K = self._stances[name], np.stack([T_now, T_other]), frame.camera.K
        now_against, against = stance.against(both, table, depth=frame.depth, K=K)
        now, other = stance.in_favour(both, table)
        worse = float(against - now_against)
        return float(other - now) - worse, worse

    def near(self, frame: Frame, name: str, T_now: Transform) -> Table | None:
        """Around a part, found once for all its other poses; None where it is not known or asked."""
        stance, known = self._stances.get(name), self._looked.get(name)
        if stance is None:
            return None
        if known is None or known[0] is not frame or not np.array_equal(known[1], T_now):
            table = table_near(frame, projected_box(T_now, stance.corners, frame))
            known = self._looked[name] = (frame, T_now, table)
        return known[2]

    def corners(self, name: str) -> Points:
        """Spanning a part's outline, in its frame, metres."""
        return self._stances[name].corners

    def stood(self, name: str, T_camera_part: Transform, table: Table) -> Transform | None:
        """The pose on the nearest side of the part, if it lies on the table about so; None if not."""
        stance, config = self._stances[name], self._config
        height = height_above(T_camera_part, stance.corners, table)
        if not len(stance.downs) or abs(height) >= config.lies:
            return None
        looks_down = stance.downs @ T_camera_part[:3, :3].T @ -table.normal
        down = stance.downs[looks_down.argmax()]
        stood = standing_on(T_camera_part, down, stance.corners, table)
        return stood[0] if stood and stood[1] <= np.deg2rad(config.lies_deg) else None
