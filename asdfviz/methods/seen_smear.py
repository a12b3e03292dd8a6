"""How a depth camera smears edges, found by looking at parts that lie in view.

Not in the paper. A time-of-flight camera mixes what is near and far along an edge, and on the side away
from its light it draws near things out by ten pixels and more, or hardly at all: cameras differ, and so
do distances. To small parts that is as much as one end of them differs from the other. So depth of poses
that are about right is drawn with several smears, and the one that agrees best over some parts and
frames is taken for all that is drawn from then on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import longer_side
from asdfviz.geometry.shapes import Box, Transform
from asdfviz.methods.drawn_looks import smear_gaps
from asdfviz.methods.drawn_smear import Smear
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import table_near

DEVIATIONS = (0.0024, 0.0034, Smear().deviation, 0.0055)
"""That are tried, shares of the focal length;"""
TRAILS = tuple(0.005 * k for k in range(-5, 8))
"""trails that are, the same: 0.018 is 11 pixels of an Azure Kinect's picture of 1280x720."""
NONE = TRAILS.index(0.0)
TRIES = 5
"""For each look: what is hidden or has no table around it shows nothing."""


@dataclass(frozen=True)
class SmearConfig:
    """When a smear that was seen is believed."""

    enabled: bool = True
    """On or off: if off, edges are smeared alike on all sides."""
    looks: int = 40
    """After so many no more parts are looked at: a camera stays as it is."""
    least: int = 3
    """So many have to be in before any is believed,"""
    gain: float = 0.03
    """and a trail has to lower the mean gap between drawn and measured depth by this share."""
    side_px: tuple[float, float] = (20.0, 140.0)
    """Longer side of the box of a part that is looked at, pixels."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.looks, self.least) < 1 or not 0 <= self.gain < 1:
            raise MethodError(
                f"smear.looks is {self.looks}, least {self.least} and gain {self.gain:g}: looks and least "
                "must be 1 or more, gain 0 or more and below 1"
            )


class SeenSmear:
    """The smear of one sequence's depth camera."""

    def __init__(self, parts: Mapping[str, Part], *, config: SmearConfig) -> None:
        """Begin a sequence: nothing is known."""
        self.now = Smear()
        """What is known so far."""
        self._parts, self._config = parts, config
        self._by_trail = np.zeros(len(TRAILS))
        """Sum of mean gaps;"""
        self._by_deviation = np.zeros(len(DEVIATIONS))
        """those with the trail that is believed now."""
        self._asked = dict.fromkeys(parts, 0)
        self._looks = 0

    def see(self, frame: Frame, poses: Mapping[str, Transform]) -> None:
        """Look at the one of some parts at poses T_camera_part that was asked the least.

        Args:
            frame: with depth, or nothing is seen.
            poses: about right, of parts with nothing but a table around them.
        """
        is_done = max(self._looks, sum(self._asked.values()) // TRIES) >= self._config.looks
        if not self._config.enabled or frame.depth is None or is_done:
            return
        for name in sorted(poses, key=lambda name: self._asked[name]):
            box = projected_box(poses[name], self._parts[name].mesh.vertices, frame)
            smallest, largest = self._config.side_px
            if smallest <= longer_side(box) <= largest:
                self._asked[name] += 1
                self._look(frame, name, poses[name], box)
                return

    def _look(self, frame: Frame, name: str, T_camera_part: Transform, box_xyxy: Box) -> None:
        table, trail = table_near(frame, box_xyxy), self.now.trail
        if table is None:
            return
        smears = [*(Smear(trail=t) for t in TRAILS), *(Smear(d, trail) for d in DEVIATIONS)]
        mesh = self._parts[name].mesh
        gaps = smear_gaps(frame, mesh, T_camera_part, table=table, smears=smears)
        if gaps is not None:
            self._looks += 1
            self._by_trail += gaps[: len(TRAILS)]
            self._by_deviation += gaps[len(TRAILS) :]
            self._believe()

    def _believe(self) -> None:
        """Take the trail that agrees best so far, if it is clearly better than none, then the deviation."""
        if self._looks < self._config.least:
            return
        best = int(self._by_trail.argmin())
        is_better = self._by_trail[best] < (1 - self._config.gain) * self._by_trail[NONE]
        trail = TRAILS[best if is_better else NONE]
        if trail != self.now.trail:
            self.now = Smear(trail=trail)
            self._by_deviation[:] = 0
        else:
            self.now = Smear(DEVIATIONS[int(self._by_deviation.argmin())], trail)
