"""Lost parts looked for where the coming steps have them, and joined ones where the next step moves them.

Not in the paper. What a hand took out of sight was mostly joined by it, so the assembly itself says
where a tracker without a detector may look again. What is joined is held where it is, so that nothing
but such a look tells that it was moved.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from operator import attrgetter

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse
from asdfviz.state.half_done import is_same_place
from asdfviz.state.joint_places import JointPlaces
from asdfviz.state.joints import Deviation, off_place
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

SAME = 1e-3
"""Less off than this share of what counts as in place, a place is one that a joint reaches."""
TURN = np.pi / 6
"""Turns by this are tried of a base that may be turned freely, radians."""


@dataclass(frozen=True)
class StepPlacesConfig:
    """When a lost part is believed to have been joined."""

    enabled: bool = True
    """On or off."""
    frames: int = 3
    """It must fit there for so many frames one after the other."""
    margin: float = 0.3
    """And better than where it was left by this (`Trial.score`, up to 2)."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.frames < 1:
            raise MethodError(f"places.frames is {self.frames}, give 1 or more")


class StepPlaces:
    """Looks for lost parts in the places of an assembly's steps; one for each sequence."""

    def __init__(
        self, assembly: Assembly, within: tuple[float, float], *, config: StepPlacesConfig
    ) -> None:
        """`within` (metres, degrees) of its place a part counts as joined."""
        self._assembly = assembly
        self._within = within
        self._config = config
        self._joints = JointPlaces(assembly)
        self._fitted: dict[str, int] = {}
        """Frames for which each part has fitted, up to the last one."""

    def step(
        self,
        frame: Frame,
        tracker: Tracker,
        poses: Mapping[str, PoseEstimate],
        lost: Collection[str],
        done: int,
    ) -> dict[str, Trial]:
        """The parts that have been seen in their places for long enough, and how they fit there.

        They are lost ones, in the places of the coming steps, and joined ones that the next step moves.

        Args:
            frame: the picture.
            tracker: holds all parts; nothing is moved.
            poses: of this frame, the base's among them unless it is not found.
            lost: parts whose poses are too unsure.
            done: the step that is reached.
        """
        base = self._assembly.base
        fitted_before, self._fitted = self._fitted, {}
        if not self._config.enabled or base not in poses or base in lost:
            return {}
        T_camera_base = poses[base].T_camera_part
        attached = self._assembly.steps[done].attached
        held = {name: poses[name] for name in attached if name in poses and name not in lost}
        self._joints.see(T_camera_base, held)
        found: dict[str, Trial] = {}
        for name in (n for n in self._assembly.parts if n in lost and n not in attached):
            seen = self._seen(frame, tracker, name, T_camera_base, done)
            if seen is not None:
                found[name] = seen
        for name in moved_parts(*self._assembly.steps[done : done + 2]) & set(tracker.names):
            seen = self._seen_moved(frame, tracker, name, T_camera_base, done)
            if seen is not None:
                found[name] = seen
        self._fitted = {name: fitted_before.get(name, 0) + 1 for name in found}
        return {n: seen for n, seen in found.items() if self._fitted[n] >= self._config.frames}

    def _seen(
        self, frame: Frame, tracker: Tracker, name: str, T_camera_base: Transform, done: int
    ) -> Trial | None:
        """How a part fits in the place of a coming step, if it does."""
        alike = self._alike(T_camera_base, done)
        for state, T_equal in product(self._coming(name, done), alike):
            places = [Ts[0] for Ts in self._joints.possible([name], state)]
            starts = [T_equal @ T for T in places]
            now, *tries = tracker.trials(frame, name, [tracker.poses[name], *starts])
            best = max(tries, key=attrgetter("score"))
            is_sure = best.confidence >= tracker.config.confidence.lost_below
            is_better = best.score > now.score + self._config.margin
            T_base_part = inverse(T_equal) @ best.T_camera_part
            if is_sure and is_better and self.is_in_place(name, T_base_part, state):
                return best
        return None

    def _seen_moved(
        self, frame: Frame, tracker: Tracker, name: str, T_camera_base: Transform, done: int
    ) -> Trial | None:
        """How a joined part fits where the next step moves it, if it does, and better than elsewhere."""
        state = self._assembly.steps[done + 1]
        starts = [T_camera_base @ Ts[0] for Ts in self._joints.possible([name], state)]
        there: list[Trial] = []
        elsewhere = 0.0
        for trial in tracker.trials(frame, name, [tracker.poses[name], *starts]):
            if self.is_moved(name, inverse(T_camera_base) @ trial.T_camera_part, done + 1):
                there.append(trial)
            else:
                elsewhere = max(elsewhere, trial.score + self._config.margin)
        best = max(there, key=attrgetter("score"), default=None)
        if best is None or best.score <= elsewhere:
            return None
        return best if best.confidence >= tracker.config.confidence.lost_below else None

    def _alike(self, T_camera_base: Transform, done: int) -> list[Transform]:
        """Where the base may be by its looks: until something is joined, in any pose that looks the same."""
        symmetries = self._assembly.parts[self._assembly.base].symmetries
        if not symmetries.is_symmetric or len(self._assembly.steps[done].attached) > 1:
            return [T_camera_base]
        return [T_camera_base @ S for S in symmetries.transforms(step=TURN)]

    def _coming(self, name: str, done: int) -> Iterator[State]:
        """The steps after this one that have a part in a place that no earlier one has."""
        known: set[bytes] = set()
        for state in self._assembly.steps[done + 1 :]:
            place = state.T_base_part.get(name)
            if place is not None and name in state.attached and place.tobytes() not in known:
                known.add(place.tobytes())
                yield state

    def is_in_place(self, name: str, T_base_part: Transform, state: State) -> bool:
        """Whether a part is where a state has it."""
        off = off_place(T_base_part, self._assembly.parts[name], state)
        return off.within(*self._within)

    def is_moved(self, name: str, T_base_part: Transform, step: int) -> bool:
        """Whether a part is where a step has it, and not where the one before had it."""
        part, (before, state) = (
            self._assembly.parts[name],
            self._assembly.steps[step - 1 : step + 1],
        )
        if not self.is_in_place(name, T_base_part, state):
            return False
        reached = off_place(state.T_base_part[name], part, before)
        if self._share(reached) < SAME:  # its joint let it go there before
            before = replace(before, joints={})
        now, then = (off_place(T_base_part, part, one) for one in (state, before))
        return self._share(now) < self._share(then)

    def _share(self, off: Deviation) -> float:
        """How far off, in units of what counts as in place."""
        near, angle_deg = self._within
        return off.distance / near + math.degrees(off.angle) / angle_deg


def moved_parts(before: State, state: State | None = None) -> set[str]:
    """Parts that are joined before a state and have another place in it; none without a state."""
    places: Mapping[str, Transform] = {} if state is None else state.T_base_part
    return {
        name
        for name, T in before.T_base_part.items()
        if name in places and not is_same_place(T, places[name])
    }
