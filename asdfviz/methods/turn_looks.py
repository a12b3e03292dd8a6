"""How parts would look in other turns, drawn among their neighbours and on the table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.methods.drawn_looks import Placed, drawn_looks
from asdfviz.methods.lying_climb import COARSE_PX, climbed, coarse
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_table import TurnTable
from asdfviz.track.bodies import Body

LooksOf: TypeAlias = Callable[[Sequence[Transform]], Scores | None]
"""How much a part in each of some poses would look like what is seen; None where that is unknown."""

NEAR = 0.6
"""Of the sum of their diameters: parts farther apart do not hide each other."""


class TurnLooks:
    """Compares turns of the parts of one sequence by how they would look."""

    def __init__(
        self,
        parts: Mapping[str, Part],
        bodies: Mapping[str, Body],
        table: TurnTable,
        *,
        config: TurnConfig,
        smear: SeenSmear | None = None,
    ) -> None:
        """Begin a sequence; `smear` is what others see of the depth camera's."""
        self._parts, self._bodies, self._table = parts, bodies, table
        self._config, self._smear = config, smear
        self.around: Mapping[str, Transform] = {}
        """Where parts surely are, T_camera_part, as last told: they hide others."""

    def ahead(self, frame: Frame, name: str, T_now: Transform, T_other: Transform) -> float | None:
        """By how much another pose of a part would look more like what is seen; None if unknown."""
        if not self._config.drawn.enabled:
            return None
        looks = self._looks_of(frame, name, T_now)([T_now, T_other])
        return None if looks is None else float(looks[1] - looks[0])

    def laid_ahead(
        self, frame: Frame, name: str, T_now: Transform, T_other: Transform
    ) -> float | None:
        """The same of a part that lies on the table, in either pose laid as it looks best there.

        What contours and depth settle may be tilted by some degrees, in the right turn more than in a
        wrong one, which then looks better. None where it does not lie there, or that is unknown.
        """
        table = self._table.near(frame, name, T_now)
        if table is None or not self._config.drawn.enabled:
            return None
        both = [T_now, T_other]
        stood = [T for T in (self._table.stood(name, T, table) for T in both) if T is not None]
        if len(stood) < len(both):
            return None
        middle, corners = self._parts[name].middle, self._table.corners(name)
        seen = coarse(frame, projected_box(T_now, corners, frame), side_px=COARSE_PX)
        looks_of = self._looks_of(frame, name, T_now, seen=seen)
        looks = looks_of(
            [*both, *(climbed(T, looks_of, middle=middle, table=table) for T in stood)]
        )
        return None if looks is None else float(looks[1::2].max() - looks[::2].max())

    def _looks_of(
        self, frame: Frame, name: str, T_now: Transform, *, seen: Frame | None = None
    ) -> LooksOf:
        """How much a part in other poses would look like the frame, or what is `seen` of it."""
        looks = partial(
            drawn_looks,
            seen or frame,
            self._parts[name].mesh,
            table=self._table.near(frame, name, T_now),
            config=self._config.drawn,
            smear=self._smear and self._smear.now,
            others=self._near(name, T_now),
        )
        return lambda Ts: looks(np.stack(Ts))

    def _near(self, name: str, T_camera_part: Transform) -> list[Placed]:
        """Parts that may be before or behind one at this pose."""
        middle, reach = self._middle(name, T_camera_part), self._parts[name].diameter
        return [
            (self._parts[other].mesh, T)
            for other, T in self.around.items()
            if other != name
            and np.linalg.norm(self._middle(other, T) - middle)
            < NEAR * (reach + self._parts[other].diameter)
        ]

    def _middle(self, name: str, T_camera_part: Transform) -> Vector:
        return apply_to_point(T_camera_part, self._bodies[name].model.centre)
