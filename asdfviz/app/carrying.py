"""Carries a part's pose from an annotated frame to others with the tracker. Nothing here knows viser.

What a person set stays as it is and is what the tracker starts from; what the tracker finds is kept
as one step of undo, marked as tracked, and replaces what it found earlier.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from asdfviz.annotate.records import TRACKED, by_hand_of
from asdfviz.annotate.steps import group_of
from asdfviz.app.background_job import BackgroundJob
from asdfviz.app.desk import carried
from asdfviz.app.history import NAMED, range_in_words
from asdfviz.app.items import JobStatus, Message
from asdfviz.app.job_actions import Direction
from asdfviz.app.timeline import stretches
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Frame
from asdfviz.errors import AnnotationError, Stopped, counted, some
from asdfviz.evaluate.health_shift import spread
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.tracking import load_bodies
from asdfviz.track.keyframes import CarriedPose, CarryConfig, carry_parts, frames_to_track
from asdfviz.track.presets import FINE, RBOT_REGION

LOOKED_AT = 8
"""Frames that are looked at for depth, without which the tracker goes by colour alone."""
TOLD_EVERY = 0.1
"""Seconds between two words on how far it is."""


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """What is tracked, from where, and how far."""

    part: str
    """The one that was selected; joined ones may come along."""
    keyframes: Mapping[str, Mapping[int, Transform]]
    """T_camera_part by part and place."""
    first: int
    last: int
    base: str | None
    """Whose poses are shown where nothing was corrected."""
    page: str = ""
    """The browser tab that asked for it."""

    @property
    def label(self) -> str:
        """In words."""
        others = len(self.keyframes) - 1
        return f"{self.part} and {others} joined with it" if others else self.part

    @property
    def total(self) -> int:
        """Frames to track."""
        return len(frames_to_track(self.keyframes, self.first, self.last))


def plan(workspace: Workspace, view: View, direction: Direction) -> Carry:
    """What tracking from the shown frame means: to the ends of the marked range, or of the sequence.

    Every pose that a person set in between is a keyframe as well.

    Raises:
        AnnotationError: no part is selected, it has no pose here, or there is no frame to track to.
    """
    part, place = view.selected, view.place
    if part is None:
        raise AnnotationError("no part is selected: click one in the picture or in the list")
    here = workspace.poses(place, view.base)
    if part not in here:
        frame = workspace.indices[place]
        raise AnnotationError(f"{part} has no pose in frame {frame} to track from: place it first")
    first, last = 0, len(workspace.indices) - 1
    if view.range_here is not None:
        first, last = view.range_here
    first = place if direction == "forward" else first
    last = place if direction == "back" else last
    if first == last:
        raise AnnotationError("there is no frame that way to track to")
    moving = carried(workspace, view, part=part, T_camera_part=here[part].T_camera_part)
    by_hand = _set_by_hand(workspace)
    keyframes: dict[str, dict[int, Transform]] = {name: {} for name in moving}
    for (index, name), T_camera_part in by_hand.items():
        at = workspace.place_of.get(index)
        if (
            name in keyframes
            and T_camera_part is not None
            and at is not None
            and first <= at <= last
        ):
            keyframes[name][at] = T_camera_part
    for name in moving:
        keyframes[name][place] = here[name].T_camera_part
    return Carry(part, keyframes, first, last, view.base, view.page)


def _set_by_hand(workspace: Workspace) -> dict[tuple[int, str], Transform | None]:
    """What a person said, by frame number and part; None where they took the pose away."""
    by_hand = by_hand_of(workspace.store.said())
    poses = workspace.store.poses()
    return {key: pose.T_camera_part for key, pose in poses.items() if key in by_hand}


class CarryJob(BackgroundJob):
    """Tracks in a thread of its own; its poses are written when it is through, none if stopped."""

    def __init__(self, workspace: Workspace, carry: Carry) -> None:
        super().__init__(workspace, "carrying", thread="carry")
        self._carry = carry
        self._told = 0.0
        self._begun = JobStatus(
            carry.label, "running", total=carry.total, told=f"Tracking {carry.label}"
        )
        self._set(self._begun)

    def _work(self) -> None:
        carry = self._carry
        try:
            found = self._tracked()
            if self._stopped.is_set():
                raise Stopped("cancelled")
            count = self._keep(found)
            lost = self._lost_in(found)
        except Stopped:
            self._set(replace(self._begun, state="stopped"))
        else:
            told = f"{carry.label} tracked to {counted(count, 'frame')}"
            end = replace(self._begun, state="done", done=count, lost=lost, told=told)
            end = replace(end, part=carry.part, message=self._told_lost(lost))
            self._set(replace(end, version=self._workspace.store.version()))

    def _fail(self, message: str) -> None:
        said = Message(f"{self._carry.label} could not be tracked", message, is_problem=True)
        self._workspace.say(said)
        self._set(replace(self._begun, state="failed", message=message))

    def _tracked(self) -> dict[str, dict[int, CarriedPose]]:
        workspace, carry = self._workspace, self._carry
        source = workspace.frames.source
        bodies = load_bodies(
            workspace.assembly,
            progress=lambda done, total: self._tell(done, total, preparing=True),
            stop=self._stopped.is_set,
        )

        some = [carry.first + k for k in spread(carry.last - carry.first + 1, LOOKED_AT)]
        has_depth = any(source[place].depth is not None for place in some)

        def frame_at(place: int) -> Frame:
            frame = source[place]
            if has_depth and frame.depth is None:  # to the tracker, depth that measured nothing
                return replace(frame, depth=np.zeros(frame.rgb.shape[:2], np.float32))
            return frame

        return carry_parts(
            frame_at,
            carry.keyframes,
            bodies={name: bodies[name] for name in carry.keyframes},
            camera=frame_at(carry.first).camera,
            first=carry.first,
            last=carry.last,
            config=CarryConfig(tracker=FINE if has_depth else RBOT_REGION),
            progress=lambda done, total: self._tell(done, total, preparing=False),
            stop=self._stopped.is_set,
        )

    def _keep(self, found: Mapping[str, Mapping[int, CarriedPose]]) -> int:
        """Write the poses as one step; returns in how many frames the selected part was found.

        Raises:
            AnnotationError: there is nothing to write, or it cannot be written.
        """
        workspace, carry = self._workspace, self._carry
        # Asked again, because people go on correcting while the tracker works.
        by_hand = by_hand_of(workspace.store.said())
        Ts_by_frame: dict[int, dict[str, Transform]] = {}
        for name, places in found.items():
            for place, pose in places.items():
                frame = workspace.indices[place]
                if (frame, name) not in by_hand:
                    Ts_by_frame.setdefault(frame, {})[name] = pose.T_camera_part
        if not Ts_by_frame:
            raise AnnotationError(
                f"{carry.part} was lost at once: look whether its pose here is right"
            )
        group = group_of(carry.page, f"track@{time.monotonic():.6f}")
        ordered = {frame: Ts_by_frame[frame] for frame in sorted(Ts_by_frame)}
        with workspace.store.transaction():
            if workspace.store.seed().kind == "none" and carry.base is not None:
                workspace.store.set_seed(workspace.seed_of(carry.base), group=group)
            for frame, name in self._superseded(ordered):
                workspace.store.drop_pose(frame, name, group=group)
            workspace.store.set_frames(ordered, provenance=TRACKED, group=group)
        return sum(carry.part in poses for poses in ordered.values())

    def _superseded(self, found: Mapping[int, Mapping[str, Transform]]) -> list[tuple[int, str]]:
        """Poses that were tracked earlier, in frames in which the part was lost this time."""
        carry, indices = self._carry, self._workspace.indices
        tracked = {
            key for key, said in self._workspace.store.said().items() if said == ("pose", TRACKED)
        }
        tried = {
            (indices[place], name)
            for place in range(carry.first, carry.last + 1)
            for name, kept in carry.keyframes.items()
            if place not in kept
        }
        return sorted(k for k in tracked & tried if k[1] not in found.get(k[0], {}))

    def _lost_in(self, found: Mapping[str, Mapping[int, CarriedPose]]) -> tuple[int, ...]:
        """The places at which the selected part was not found."""
        carry, indices = self._carry, self._workspace.indices
        by_hand = by_hand_of(self._workspace.store.said())
        begun = carry.keyframes[carry.part]
        return tuple(
            place
            for place in range(carry.first, carry.last + 1)
            if not (place in begun or place in found.get(carry.part, {}))
            and (indices[place], carry.part) not in by_hand
        )

    def _told_lost(self, places: tuple[int, ...]) -> str:
        """The same in words; empty if there is no such place."""
        carry, indices = self._carry, self._workspace.indices
        is_lost = [place in places for place in range(carry.first, carry.last + 1)]
        told = [
            range_in_words(indices[carry.first + start], indices[carry.first + end])
            for start, end, lost in stretches(is_lost)
            if lost
        ]
        tried = len(is_lost) - len(carry.keyframes[carry.part])
        count = f"{len(places)} of {tried} frames"
        return f"lost in {count}: {some(told, most=NAMED)}" if told else ""

    def _tell(self, done: int, total: int, *, preparing: bool) -> None:
        now = time.monotonic()
        if now - self._told < TOLD_EVERY and done < total:
            return
        self._told = now
        status = replace(self._begun, state=self._state, done=done, total=total)
        self._set(replace(status, preparing=preparing))
