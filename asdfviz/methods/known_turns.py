"""A base's first pose in a turn that was found wrong before, put right.

Not in the paper. A network that never learnt which end is which proposes the wrong one in every frame.
Contours find that out, and the pose that is kept is turned; but where the base is is told by first
poses, and a base that is taken end for end there would have every other part in a wrong place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol, runtime_checkable

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point, transform_from
from asdfviz.methods.base_votes import BaseVotes


@runtime_checkable
class Allows(Protocol):
    """Knows turns of parts that were ruled out."""

    def allows(self, frame: Frame, name: str, T_now: Transform, T_other: Transform) -> bool:
        """Whether a part that is kept at the first pose T_camera_part may rather be at the second."""
        ...


class KnownTurns:
    """Of the base, in one sequence."""

    def __init__(self, assembly: Assembly, turns: Allows | None) -> None:
        """Keep what knows them; None where nothing does."""
        self._base, self._turns = assembly.parts[assembly.base], turns

    def mended(self, own: PoseEstimate, T_known: Transform | None, frame: Frame) -> PoseEstimate:
        """The base's pose, turned about its middle as the known one is where its own turn is ruled out.

        Args:
            own: of this frame.
            T_known: T_camera_part that is trusted most so far, None where none is.
            frame: that shows it.
        """
        if T_known is None or self._turns is None:
            return own
        if self._turns.allows(frame, own.part, T_known, own.T_camera_part):
            return own
        R, middle = T_known[:3, :3], self._base.middle
        there = apply_to_point(own.T_camera_part, middle)
        return replace(own, T_camera_part=transform_from(R, there - R @ middle))

    def told(
        self, own: PoseEstimate | None, T_known: Transform | None, frame: Frame, votes: BaseVotes
    ) -> PoseEstimate | None:
        """The same of what votes told of a frame, once more is known of it; they go by that."""
        if own is None:
            return None
        right = self.mended(own, T_known, frame)
        votes.mended(right.T_camera_part)
        return right
