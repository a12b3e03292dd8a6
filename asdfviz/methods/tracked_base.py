"""The tracked base: kept where all parts tell it to be.

Not in the paper. The little of a base that its parts and a hand leave free fits many a place, and a part
like it is found for it, so that the tracker takes it away step by step, and all that it holds with it. Where
it is tells what the detector makes of all parts (`BaseVotes`); the tracker finds it near there.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.track_memory import Track

ENOUGH = 2
"""So many held parts tell where the base is; one alone may leave it free to turn."""


class TrackedBase:
    """One for each sequence."""

    def __init__(self, base: str, votes: BaseVotes | None) -> None:
        """Keep what tells where it is.

        Args:
            base: its name.
            votes: of a frame's poses, asked after they were counted; None lets it be anywhere.
        """
        self._base, self._votes = base, votes

    @property
    def place(self) -> Mapping[str, Transform]:
        """T_camera_part of the base by the votes, if it is known."""
        place = None if self._votes is None else self._votes.place
        return {} if place is None else {self._base: place}

    def may_be(self, name: str, T_camera_part: Transform) -> bool:
        """Whether a part may be there, which all but the base may."""
        may_be = None if self._votes is None or name != self._base else self._votes.may_be
        return may_be is None or may_be(T_camera_part)

    def call_back(
        self, tracks: Mapping[str, Track], poses: Mapping[str, Transform], sure: dict[str, float]
    ) -> None:
        """Where the tracker has strayed it is not sure, and goes on from the place.

        Args:
            tracks: what is remembered of the parts.
            poses: where the tracker has them.
            sure: how sure these are, 0 to 1; changed.
        """
        base, place = self._base, self.place
        if base in poses and place and not self.may_be(base, poses[base]):
            tracks[base].T_now, sure[base] = place[base], 0.0

    def as_held(self, sure: dict[str, float], shown: Collection[str]) -> None:
        """It is as sure as the parts that it holds, `shown` those that fit the picture."""
        in_place = [sure[name] for name in shown]
        if len(in_place) >= ENOUGH:
            sure[self._base] = max(sure[self._base], float(np.median(in_place)))

    def keep(self, pose: PoseEstimate) -> None:
        """Tell the votes where it was found."""
        if self._votes is not None:
            self._votes.keep(pose)
