"""How parts would look in other turns, drawn among their neighbours and on the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.methods.drawn_looks import Placed, drawn_looks
from asdfviz.methods.lying_climb import climbed, coarse
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_table import TurnTable
from asdfviz.track.bodies import Body

NEAR = 0.6
"""Of the sum of their diameters: parts farther apart do not hide each other."""
COARSE_PX = 64.0
"""Parts that look larger are laid down in a picture of half the size, or a quarter."""


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
        looks = self._drawn([T_now, T_other], frame, frame, name, T_now)
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
        stood = [self._table.stood(name, T, table) for T in both]
        part, corners = self._parts[name], self._table.corners(name)
        seen = coarse(frame, projected_box(T_now, corners, frame), side_px=COARSE_PX)
        looks_of = partial(self._drawn, seen=seen, frame=frame, name=name, T_now=T_now)
        for T in stood:
            if T is None:
                return None
            both.append(climbed(T, looks_of, middle=part.middle, table=table))
        looks = looks_of(both)
        return None if looks is None else float(looks[1::2].max() - looks[::2].max())

    def _drawn(
        self, Ts: Sequence[Transform], seen: Frame, frame: Frame, name: str, T_now: Transform
    ) -> Scores | None:
        """How much a part in these poses would look like what is `seen` of the frame."""
        return drawn_looks(
            seen,
            self._parts[name].mesh,
            np.stack(Ts),
            table=self._table.near(frame, name, T_now),
            config=self._config.drawn,
            smear=self._smear and self._smear.now,
            others=self._near(name, T_now),
        )

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
