"""What crops told of a part in a frame, and what of it is remembered in the next."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from asdfviz.datatypes import Detection, PoseEstimate
from asdfviz.detector.crop_answer import REACH, CropAnswer
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries, symmetric_angle
from asdfviz.pose.hypotheses import Settled
from asdfviz.state.twins import renamed


@dataclass(frozen=True, slots=True, eq=False)
class LookedAt:
    """What a crop tells of one part."""

    settled: tuple[Settled, ...]
    """Poses on which outline (and depth) agree, best first; at least one."""
    answer: CropAnswer
    """What the network said."""
    detection: Detection
    """Around which the crop was cut."""
    symmetries: Symmetries
    """Of the part."""

    def likely(self, T_camera_part: Transform) -> float:
        """The network's preference for a pose's rotation, 0 to 1."""
        return min(1.0, self.answer.likelihood(T_camera_part[:3, :3], self.symmetries))


class LastLooks:
    """What crops told of the parts of one sequence last: what rests is not looked at in every frame."""

    def __init__(self) -> None:
        """Nothing was looked at yet."""
        self._looks: dict[str, LookedAt] = {}

    def step(self, now: Mapping[str, LookedAt], found: Collection[str]) -> Mapping[str, LookedAt]:
        """What is known in a frame.

        Args:
            now: what its crops tell.
            found: parts that were detected; others are forgotten.
        """
        self._looks = {name: look for name, look in self._looks.items() if name in found} | dict(
            now
        )
        return self._looks

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._looks = renamed(self._looks, names)


@dataclass(frozen=True, slots=True, eq=False)
class Before:
    """Where a part was in the frame before."""

    T_camera_part: Transform
    liked: float = 1.0
    """What the network thought of its rotation while it was there, 0 to 1; new ones are believed."""

    def followed_by(
        self, T_camera_part: Transform, likely: float, symmetries: Symmetries, *, memory: float
    ) -> Before:
        """The part, of these symmetries, in the next frame, where the network says `likely` of its rotation.

        `memory` is the weight of that frame, 0 to 1.
        """
        if symmetric_angle(T_camera_part, self.T_camera_part, symmetries) > REACH:
            return Before(T_camera_part)
        return Before(T_camera_part, self.liked + memory * (likely - self.liked))


def remembered(
    pose: PoseEstimate,
    before: Before | None,
    look: LookedAt | None,
    symmetries: Symmetries,
    *,
    memory: float,
) -> Before:
    """A part's pose, with what the network thought of its rotation so far.

    Args:
        pose: in this frame.
        before: what was remembered in the one before, if anything.
        look: what a crop tells in this frame; without, the rotation is no more nor less believed.
        symmetries: of the part.
        memory: weight of this frame, 0 to 1.
    """
    T = pose.T_camera_part
    if before is None:
        return Before(T)
    if look is None:
        return before.followed_by(T, before.liked, symmetries, memory=0.0)
    return before.followed_by(T, look.likely(T), symmetries, memory=memory)
