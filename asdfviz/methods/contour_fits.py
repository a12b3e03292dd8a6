"""The last millimetres: poses moved until their contours lie where the colours change.

Not in the paper. Depth alone lets a flat part slide, and leaves its turn about the line of sight to the
detector. The optimiser of the trackers settles every pose in its own frame, by contours and depth; no
pose is carried on here, only the parts' colours are, so a frame's poses still stand by themselves.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Camera, Frame, Part
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.threads import side_by_side
from asdfviz.geometry.transforms import point_distance
from asdfviz.methods.drawn_looks import DrawnConfig
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.state.twins import renamed
from asdfviz.track.bodies import Body
from asdfviz.track.presets import FINE, TrackerConfig
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

BY_POINTS = TurnConfig(slack=0.03, drawn=DrawnConfig(enabled=False))
"""Turns are compared by depth at single points, which takes less time than to draw them."""
TWO_A_FRAME = TurnConfig(a_frame=2, lead_seen=0.2, near=0.1, was=0.2, contested=1.0)
"""There is no tracker that holds a turn: most of what is turned end for end was found anew so, and was right
before."""


@dataclass(frozen=True)
class ContourConfig:
    """When a settled pose is taken."""

    enabled: bool = True
    """On or off."""
    together: bool = True
    """Whether joined parts are settled as one besides."""
    tracker: TrackerConfig = FINE
    """How poses are settled."""
    sure: float = 0.5
    """Confidence from which the contours and depth of a pose are believed, 0 to 1."""
    visible: float = 0.4
    """Share of the part that must be seen, 0 to 1."""
    farthest: float = 0.012
    """A pose that is moved by more was another one, metres of the part's middle."""
    turns: TurnConfig = TWO_A_FRAME
    """Whether a part is turned otherwise."""
    times: int = 3
    """A pose that stays as it is, is settled in so many frames one after another,"""
    every: int = 6
    """then in one of so many."""
    unsure: float = 0.3
    """A pose of less confidence by contours and depth, 0 to 1, is left for a runner-up that is `sure`."""

    def rests(self, times: int, frames: int) -> bool:
        """Whether what stayed and was settled so many times, so many frames ago, is left as it is."""
        return times >= self.times and frames < self.every


@dataclass(frozen=True, slots=True, eq=False)
class ContourFit:
    """A pose, settled if that was possible."""

    T_camera_part: Transform
    sure: float
    """Confidence by contours and depth, 0 to 1."""
    moved: bool
    """Whether it was settled in this frame."""


@dataclass(slots=True, eq=False)
class _Settled:
    """A pose that was settled, and how often."""

    T_camera_part: Transform
    times: int = 0
    frames: int = 0
    """Since then."""


class ContourFits:
    """Settles poses in one sequence."""

    def __init__(
        self,
        parts: Mapping[str, Part],
        bodies: Mapping[str, Body],
        camera: Camera,
        *,
        config: ContourConfig,
        smear: SeenSmear | None = None,
    ) -> None:
        self._config, self._bodies = config, bodies
        self._tracker = Tracker(bodies, camera, config.tracker)
        self._checks = TurnChecks(parts, bodies, config=config.turns, smear=smear)
        self._known: dict[str, _Settled] = {}

    def allows(self, frame: Frame, name: str, T_now: Transform, T_other: Transform) -> bool:
        """Whether a pose of a part is no turn of another one that was ruled out."""
        return self._checks.allows(frame, name, T_now, T_other)

    def step(
        self,
        frame: Frame,
        poses: Mapping[str, Transform],
        *,
        held: Collection[str] = (),
        looked_at: Mapping[str, LookedAt] | None = None,
    ) -> dict[str, ContourFit]:
        """Settle poses T_camera_part; nothing is said without depth.

        Args:
            frame: that shows the parts.
            poses: of them, T_camera_part.
            held: parts that the state holds, which are not checked for being turned otherwise.
            looked_at: what crops tell of the parts, if anything.
        """
        if frame.depth is None:
            return {}
        tracker, moved = self._tracker, dict[str, Transform]()
        loose = {name: T for name, T in poses.items() if not self._rests(name, T)}
        settled = self._all_settled({n: T for n, T in loose.items() if n in tracker.names}, frame)
        # The colours of the others were learnt where they were not, or are not known.
        again = {name: T for name, T in loose.items() if name not in settled}
        tracker.drop(again)
        tracker.add(frame, again)
        settled |= self._all_settled(again, frame)
        for name in loose:
            if name in settled:
                moved[name] = settled[name]
                self._note(name, loose[name], settled[name])
        now = {**poses, **moved}
        tracker.replace(frame, now)
        sure = tracker.confidence(frame)
        tracker.learn(frame, tuple(moved))
        free = {name: T for name, T in now.items() if name not in held}
        self._checks.looks.around = now
        turned = self._checks.step(frame, tracker, free, looked_at)
        tracker.replace(frame, turned)
        moved |= turned
        now |= turned
        return {name: ContourFit(T, sure[name], name in moved) for name, T in now.items()}

    def rather(
        self, frame: Frame, name: str, fit: ContourFit, T_other: Transform
    ) -> ContourFit | None:
        """Another pose of a part, settled, where contours speak for it and not for the fit it has."""
        if fit.sure >= self._config.unsure:
            return None
        trial = self._settled(name, T_other, frame)
        if trial is None:
            return None
        self._tracker.replace(frame, {name: trial.T_camera_part})
        return ContourFit(trial.T_camera_part, trial.confidence, moved=True)

    def contested(self) -> dict[str, float]:
        """By how much another turn of a part is ahead by what was seen, of those that are checked."""
        return self._checks.contested()

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._checks.rename(names)
        self._known = renamed(self._known, names)

    def _rests(self, name: str, T: Transform) -> bool:
        """Whether the pose was settled often enough and stayed there."""
        known = self._known.get(name)
        if known is None or not np.array_equal(known.T_camera_part, T):
            return False
        known.frames += 1
        return self._config.rests(known.times, known.frames)

    def _note(self, name: str, T: Transform, T_settled: Transform) -> None:
        known = self._known.get(name)
        stayed = known is not None and np.array_equal(known.T_camera_part, T)
        self._known[name] = _Settled(T_settled, known.times + 1 if known and stayed else 1)

    def _all_settled(self, poses: Mapping[str, Transform], frame: Frame) -> dict[str, Transform]:
        """Those that can be."""
        settled = side_by_side(lambda name: self._settled(name, poses[name], frame), poses)
        found = zip(poses, settled, strict=True)
        return {name: trial.T_camera_part for name, trial in found if trial is not None}

    def _settled(self, name: str, T: Transform, frame: Frame) -> Trial | None:
        (trial,) = self._tracker.trials(frame, name, [T])
        return trial if self._is_believed(name, T, trial) else None

    def _is_believed(self, name: str, T: Transform, trial: Trial) -> bool:
        middle = self._bodies[name].model.centre
        return (
            trial.confidence >= self._config.sure
            and trial.evidence.visible >= self._config.visible
            and point_distance(trial.T_camera_part, T, middle) <= self._config.farthest
        )
