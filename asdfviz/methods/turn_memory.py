"""The turns in which a part may be, and what is known of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Rotation, Transform
from asdfviz.geometry.transforms import rotation_about
from asdfviz.methods.refinding import QUARTER_TURNS


def _turns() -> tuple[Rotation, ...]:
    """Half turns first, as most parts that are taken for turned are taken end for end; quarter turns;
    a third and two thirds of those, for what has several lobes; then all that a cube has besides."""
    axes = np.eye(3)
    slight = [rotation_about(a, s * np.pi / 6) for s in (1, -1, 2, -2) for a in axes]
    cube = sorted(
        QUARTER_TURNS[1:], key=lambda R: (np.count_nonzero(np.diag(R)) < 3, -float(np.trace(R)))
    )
    return (*cube[:9], *slight, *cube[9:])


TURNS = _turns()
SPUN = tuple(half @ slight for half in TURNS[:3] for slight in TURNS[9:21])
"""Taken end for end and turned besides, as what lies on its side or has a handle is."""


@dataclass(slots=True, eq=False)
class TurnMemory:
    """What is known of one part's turns."""

    T_camera_part: Transform
    """The pose when it was last in it."""
    turns: tuple[Rotation, ...] = TURNS
    """That are tried: those of all parts, and in which it was and was wrong."""
    lead: Float64[np.ndarray, "turns"] = field(init=False)
    """Of each over the pose that is believed."""
    last: int = -1
    """That was tried."""
    fresh: int = field(init=False)
    """That were not tried yet."""
    rested: int = 0
    """Frames since the last try."""
    left: int = 0
    """Frames since it was last in this pose."""

    def __post_init__(self) -> None:
        """Nothing is known yet."""
        self.lead = np.zeros(len(self.turns))
        self.fresh = len(self.turns)

    @property
    def wrong(self) -> tuple[Rotation, ...]:
        """Turns of it that it was in and that were wrong, the last first."""
        return self.turns[len(TURNS) :]

    def out(self, lead: float) -> Float64[np.ndarray, "n 3 3"]:
        """Turns that are no longer open: behind by that much, or wrong before and not ahead now."""
        # Turns that are no others, as the part is symmetric, have no lead.
        out = np.isfinite(self.lead) & (self.lead <= -lead)
        out[len(TURNS) :] = True
        return np.stack(self.turns)[out]
