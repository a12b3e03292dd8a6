"""The state that `asdf_plus` and `asdf_track` follow: each frame's terms, and the model that joins them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol, runtime_checkable

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State, StateEstimate
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.group_fits import GroupFits
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.loose_parts import LooseParts
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.place_looks import PlaceLooks, PlaceLooksConfig, agreed
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.state.base_turns import BaseTurns
from asdfviz.state.group_fit import GroupFitConfig
from asdfviz.state.half_done import HalfDone
from asdfviz.state.last_turns import LastTurns, LastTurnsConfig
from asdfviz.state.lately_loose import LatelyLoose, LatelyLooseConfig
from asdfviz.state.relative_pose import RelativePoseConfig, relative_pose_probabilities
from asdfviz.state.smoothing import SmoothingConfig, StateFilter


@runtime_checkable
class FollowsState(Protocol):
    """Options of a method whose state is followed."""

    @property
    def smoothing(self) -> SmoothingConfig:
        """The model."""
        ...

    @property
    def relative_pose(self) -> RelativePoseConfig:
        """The term of that name; with its `half_done` at 0 no half-done step is a state of its own."""
        ...

    @property
    def group_fit(self) -> GroupFitConfig:
        """The term of that name."""
        ...

    @property
    def place_looks(self) -> PlaceLooksConfig:
        """The term of that name."""
        ...

    @property
    def loose(self) -> LooseConfig:
        """What counts to it besides."""
        ...

    @property
    def lately_loose(self) -> LatelyLooseConfig:
        """So does what lay loose."""
        ...

    @property
    def last_turns(self) -> LastTurnsConfig:
        """So does how parts were turned before their places hid them."""
        ...


class FollowedState:
    """One for each sequence. Half-done steps are states of their own within, and none outside."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        looker: object | None,
        config: FollowsState,
        *,
        smear: SeenSmear | None = None,
    ) -> None:
        """Begin a sequence.

        Args:
            assembly: whose states.
            shapes: of the parts.
            looker: the crop network, or None.
            config: the options of the method.
            smear: what others see of the depth camera's.
        """
        relative_pose = config.relative_pose
        self._ways = (
            HalfDone.of(assembly) if relative_pose.half_done > 0 else HalfDone.none(assembly)
        )
        self._unfolded = self._ways.assembly
        self._relative_pose = replace(relative_pose, half_done=0.0)
        self._turns = BaseTurns(self._unfolded, config=self._relative_pose)
        half_done = self._ways.indices
        self._states = StateFilter(self._unfolded, config=config.smoothing, half_done=half_done)
        self._fits = GroupFits(self._unfolded, shapes, config=config.group_fit, smear=smear)
        self._place_looks = PlaceLooks(self._unfolded, shapes, looker, config=config.place_looks)
        self._loose = LooseParts(self._unfolded, shapes, config=config.loose, half_done=half_done)
        self._lately = LatelyLoose(self._unfolded, config=config.lately_loose)
        self._last_turns = LastTurns(self._unfolded, config=config.last_turns)

    @property
    def assembly(self) -> Assembly:
        """With its half-done states, the last ones; by these parts are placed."""
        return self._unfolded

    @property
    def said(self) -> Scores | None:
        """Probabilities of the assembly's own states in the last frame; None before anything was seen."""
        belief = self._states.belief
        return None if belief is None else self._ways.summed(belief)

    @property
    def unfolded(self) -> StateEstimate | None:
        """What the last frame's state is if half-done states count by themselves, and a part that
        arrives is in its place."""
        shown = self._states.shown
        return None if shown is None else StateEstimate(shown, {})

    @property
    def joins(self) -> State | None:
        """The state that `unfolded` names, which places the joined parts."""
        told = self.unfolded
        return None if told is None else self._unfolded.states[told.index]

    @property
    def base(self) -> PoseEstimate | None:
        """Where the base is by all that was seen of the group in the last frame, if anything was."""
        return self._fits.base

    def turned(self, poses: Mapping[str, PoseEstimate]) -> dict[str, PoseEstimate]:
        """The poses of a new frame, those of a base that looks the same turned as the others tell it."""
        return self._turns.told(poses)

    def settle(self, T_camera_base: Transform) -> None:
        """Where the last frame's base was by all parts of its group together, settled."""
        self._fits.settle(T_camera_base)

    def step(
        self,
        looks: Scores | None,
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
        *,
        first: PoseEstimate | None,
        free: Mapping[str, PoseEstimate] | None = None,
        rest: AtRest,
    ) -> StateEstimate | None:
        """Take one frame into the model; None before anything was ever seen.

        Args:
            looks: the term "appearance".
            poses: of the parts, as `turned` gives them.
            frame: that they are of.
            first: the base's pose by this frame alone.
            free: the poses that bear witness for states; None for all.
            rest: what lies still, and how the camera moves; it has seen this frame.
        """
        ways, before = self._ways, self._states.shown
        witnesses = poses if free is None else free
        places = relative_pose_probabilities(witnesses, self._unfolded, config=self._relative_pose)
        if first is not None:
            first = replace(first, T_camera_part=self._turns.like_last(first.T_camera_part))
        fits = self._fits.step(poses, before, frame, first=first)
        if places is not None and fits is not None and rest.is_shaken:
            places = places**self._relative_pose.shaken
            places /= places.sum()
        base = self._fits.base or poses.get(self._unfolded.base)
        near = {} if base is None else self._fits.near.loose(base.T_camera_part, poses)
        stands = self._place_looks.step(base, poses, before, frame, without=near)
        seen = witnesses if base is None else {**witnesses, self._unfolded.base: base}
        lately = self._lately.step(seen, self._states.belief)
        shown_px, step_frames = self._fits.shown_px, self._lately.step_frames
        loose = self._loose.step(
            base,
            witnesses,
            frame,
            rest=rest,
            shown_px=shown_px,
            place=self._fits.place,
            step_frames=step_frames,
        )
        turned = self._last_turns.step(
            base, witnesses, K=frame.camera.K, place=self._fits.place, shown_px=shown_px
        )
        stands = agreed(agreed(agreed(stands, loose), lately), turned)
        belief = self._states.step(ways.unfolded(looks), places, fits, stands)
        if belief is None:
            return None
        terms = {"relative_pose": places, "group_fit": fits, "place_looks": stands}
        unfolded = {name: term for name, term in terms.items() if term is not None}
        said = {} if looks is None else {"appearance": looks}
        for name, term in unfolded.items():
            said[name] = ways.told(term)
        return StateEstimate(ways.summed(belief), said, unfolded if ways.indices else {})
