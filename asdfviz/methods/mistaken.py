"""What `asdf_plus` takes for a part, though it stood there while the part was elsewhere, has another tint, or
is too far away.

Not in the paper. See `still_there`, `own_colors` and `leaps`: once a hand has a small part, the networks find the
next best thing of its look, which lay there all along. Where a state would have the part only its tint is
asked for: a pin that is put in changes its place by a few pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.leaps import Leaps, LeapsConfig
from asdfviz.methods.own_colors import OwnColors, OwnColorsConfig
from asdfviz.methods.steady_poses import SteadyPoses
from asdfviz.methods.still_there import AWAY, StillThere, StillThereConfig
from asdfviz.state.joined_spots import JoinedSpots
from asdfviz.state.twins import renamed

SURE = 0.8
"""Score from which a part surely is where its pose has it."""
LAIN = 8
"""A part surely lay somewhere that was there for so many frames; what is in a hand may be anything."""
PATIENCE = 30
"""In so many frames one after the other a part may have another tint; then the one that is known was wrong."""


class Mistaken:
    """Remembers where the parts of one sequence surely were, and what the picture showed then."""

    def __init__(
        self,
        assembly: Assembly,
        *,
        config: StillThereConfig,
        own: OwnColorsConfig,
        leaps: LeapsConfig,
    ) -> None:
        """Begin a sequence."""
        self._base = assembly.base
        self._spots = JoinedSpots(assembly)
        self._still = StillThere(assembly, config=config)
        self._own = OwnColors(assembly, config=own)
        self._leaps, self._base_leaps = (Leaps(assembly, config=leaps) for _ in range(2))
        self._refused: dict[str, int] = {}
        """For how many frames one after the other parts had another tint,"""
        self._unlike: frozenset[str] = frozenset()
        """and which have it in this one."""
        self._steady = SteadyPoses(assembly, apart=AWAY)
        """For how many frames parts surely have been where they are."""

    def found(
        self,
        frame: Frame,
        proposed: Mapping[str, PoseEstimate],
        T_camera_base: Transform | None,
        *,
        scores: Mapping[str, float] = MappingProxyType({}),
    ) -> frozenset[str]:
        """The parts whose poses are those of other things.

        Args:
            frame: that the poses are of.
            proposed: first poses.
            T_camera_base: where the base is; None: it is not known.
            scores: of the boxes that they come from.
        """
        lay = self._still.lay
        poses = {n: pose.T_camera_part for n, pose in proposed.items() if n != self._base}
        unlike = self._own.others(frame, poses, lay)
        loose = {n: T for n, T in poses.items() if self._is_away(proposed[n], T_camera_base)}
        self._unlike |= unlike
        return unlike | self._still.others(frame, loose, lay, lambda _, names: names, scores=scores)

    def doubted(self, frame: Frame, poses: Mapping[str, PoseEstimate]) -> dict[str, PoseEstimate]:
        """The poses of a frame, those less sure to which parts leapt."""
        return self._leaps.step(poses, frame.time)

    def doubted_base(self, frame: Frame, base: PoseEstimate | None) -> PoseEstimate | None:
        """Where the group has the base, less sure if the group leapt there; None stays None."""
        if base is None:
            return None
        # What the base by itself was taken for says nothing of the group.
        return self._base_leaps.step({base.part: base}, frame.time)[base.part]

    def see(
        self,
        frame: Frame,
        poses: Mapping[str, PoseEstimate],
        scores: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """What the frame's poses are in the end, and the scores of the boxes that parts were found in."""
        sure = {n: p.T_camera_part for n, p in poses.items() if p.score >= SURE}
        before = self._steady.step(sure)
        lying = {name: T for name, T in sure.items() if before[name] + 1 >= LAIN}
        self._still.see(frame, lying, scores=scores)
        self._own.see(frame, lying)
        self._refused = {n: self._refused.get(n, 0) + 1 for n in self._unlike}
        self._own.forget(frozenset(n for n, frames in self._refused.items() if frames > PATIENCE))
        self._unlike = frozenset()

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._steady.rename(names)
        self._still.rename(names)
        self._own.rename(names)
        self._leaps.rename(names)
        self._refused = renamed(self._refused, names)
        self._unlike = frozenset(names.get(name, name) for name in self._unlike)

    def _is_away(self, pose: PoseEstimate, T_camera_base: Transform | None) -> bool:
        if T_camera_base is None:
            return True
        return self._spots.distance(pose.part, pose.T_camera_part, T_camera_base) > AWAY
