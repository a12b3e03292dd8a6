"""What the table says of turns of a part: one that has it stand in the table, or lie on a side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import table_near
from asdfviz.pose.standing import RestConfig, Stance, sides
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

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.worse, self.place) < 0:
            raise MethodError(
                f"turns.table.worse is {self.worse:g} and place {self.place:g}: use 0 or more"
            )


class TurnTable:
    """The table in the frames of one sequence, and how its parts could stand on it."""

    def __init__(self, parts: Mapping[str, Part], *, config: TurnTableConfig) -> None:
        """Begin a sequence."""
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
