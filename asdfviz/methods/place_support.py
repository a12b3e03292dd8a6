"""Whether a track sits on the right thing: what the detector said of its place, and of another one.

A tracker learns the colours of whatever it sits on, so that its own judgement speaks for a wrong place
as much as for the right one. The detector has no such memory: a part that it keeps finding elsewhere,
and hardly where it is tracked, is elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.geometry.shapes import Vector


@dataclass(frozen=True)
class SupportConfig:
    """How boxes count; each by the square of its score, since poor boxes are mostly false."""

    fades: float = 0.97
    """What is left of a place's support after each frame."""
    most: float = 4.0
    """Support never grows above this: what was seen often may still be moved."""
    lead: float = 1.0
    """By this much another place must be ahead,"""
    lost_lead: float = 0.1
    """or by this much while the part is not surely seen where it is tracked."""
    apart: float = 1.0
    """Places are different that are farther apart than this times the part's diameter."""


@dataclass(slots=True, eq=False)
class PlaceSupport:
    """Of one track."""

    own: float = 0.0
    """Support of the place where the part is tracked."""
    elsewhere: float = 0.0
    """Support of another place,"""
    place: Vector | None = None
    """which is here, camera frame, metres."""

    def hear(
        self,
        tracked: Vector,
        detected: Vector,
        *,
        score: float,
        diameter: float,
        is_sure: bool,
        config: SupportConfig,
    ) -> bool:
        """Take in a box; return whether the part is believed to be where it was detected now.

        Args:
            tracked: the part's middle as it is tracked, camera frame, metres.
            detected: where the detector has it, same frame.
            score: of the box, 0 to 1.
            diameter: of the part, metres.
            is_sure: whether the track fitted the picture in the frame before.
            config: how boxes count.
        """
        reach = config.apart * diameter
        if float(np.linalg.norm(detected - tracked)) < reach:
            self.own = min(self.own + score**2, config.most)
            return False
        if self.place is None or float(np.linalg.norm(detected - self.place)) > reach:
            if score**2 < self.elsewhere:
                return False
            self.elsewhere = 0.0
        self.place = detected
        self.elsewhere = min(self.elsewhere + score**2, config.most)
        return self.elsewhere > self.own + (config.lead if is_sure else config.lost_lead)

    def fade(self, config: SupportConfig) -> None:
        """A frame passes."""
        self.own *= config.fades
        self.elsewhere *= config.fades
