"""What a pure tracker needs where parts move fast or are hidden, which its papers leave out.

A part is looked for where it was and where it was heading, and where the camera has moved, as most
parts tell, where it lies if it lies still. One that clearly does not fit the picture learns no colours
and, where it is hidden or stays lost, goes back to where it was last seen: what a hand covers mostly
stays where it is, and a tracker that is let go settles on something else.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point, inverse, point_distance, rotation_about
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.refinding import distinct, heading, moved_to, turned
from asdfviz.track.bodies import Body
from asdfviz.track.confidence import Evidence
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker


@dataclass(frozen=True)
class FollowConfig:
    """When a part is believed to be lost, and what becomes of it."""

    rounds: int = 3
    """Correspondence searches by which being at rest and moving on are compared."""
    learn_above: float = 0.03
    """Confidence from which a pose is followed and its colours are learnt. It is low, because a
    shadow makes a pose that is right look poor until its colours are known."""
    hidden_below: float = 0.5
    """Visible share below which a part that does not fit is taken to be where it was."""
    patience: int = 2
    """Frames for which one that can be seen is let go on though it does not fit."""
    kept: float = 0.9
    """What is left of the confidence in a hidden part's pose after each frame, down to"""
    unseen: float = 0.15
    """this: most of what is hidden for long has not been moved."""
    doubted_below: float = 0.7
    """Confidence below which a part that can be seen is also tried turned and shifted."""
    turn_deg: float = 20.0
    """By so much about each of its axes, both ways, degrees."""
    off_depth: float = 0.01
    """Measured surface so far before or behind that of such a part, metres, is tried as its own: too
    deep by a little more than the tracker tells from a hand before it, a part looks hidden."""
    margin: float = 0.15
    """A try must fit better by this (`Trial.score`)."""
    at_rest: AtRestConfig = field(default_factory=partial(AtRestConfig, enough=1))
    """What lies still though the camera moves; the first frame is the truth's, so one is enough."""
    astray: float = 0.005
    """A part found this far from where it lies still is also tried there, metres."""


@dataclass(slots=True, eq=False)
class _Path:
    """Where one part was seen, T_camera_part."""

    T_now: Transform
    T_before: Transform | None = None
    """A frame earlier; None where it was not surely seen in both."""
    unsure: int = 0
    """Frames since it was seen."""
    sure: float = 1.0
    """Confidence in its pose."""


class Follower:
    """Moves a tracker from frame to frame."""

    def __init__(
        self,
        tracker: Tracker,
        bodies: Mapping[str, Body],
        assembly: Assembly,
        config: FollowConfig,
    ) -> None:
        """Take a tracker that was started, its bodies, and the assembly whose parts they are."""
        self._tracker = tracker
        self._bodies = bodies
        self._config = config
        self._rest = AtRest(assembly, config=config.at_rest)
        self._paths: dict[str, _Path] = {}
        self.place(tracker.names)

    def place(self, names: Collection[str]) -> None:
        """Forget the paths of parts that were taken in or put elsewhere."""
        poses = self._tracker.poses
        self._paths |= {name: _Path(poses[name]) for name in names}

    def update(
        self, frame: Frame, *, held: Collection[str] = (), base: str = ""
    ) -> dict[str, float]:
        """Move all parts to the frame; how probably each pose is right, 0 to 1.

        `held` parts hang on `base`: they are where it has them, seen or not.
        """
        tracker = self._tracker
        for name in tracker.names:
            if name not in held:
                self._head_on(name, frame)
        tracker.move(frame)
        evidence = self._left_lying(frame, tracker.evidence(frame), held)
        better = {
            name: T_better
            for name in tracker.names
            if name not in held
            and (T_better := self._better(name, frame, evidence[name])) is not None
        }
        if better:
            tracker.replace(frame, better)
            evidence = tracker.evidence(frame)
        sure = {name: tracker.judged(seen) for name, seen in evidence.items()}
        poses = tracker.poses
        lost = {
            name: self._noted(self._paths[name], poses[name], sure[name], evidence[name])
            for name in tracker.names
        }
        self._move_with_the_camera(sure, held)
        seen = [name for name in tracker.names if sure[name] >= self._config.learn_above]
        tracker.learn(frame, seen)
        back = {n: self._paths[n].T_now for n, gone in lost.items() if gone and n not in held}
        tracker.replace(frame, back)
        least = tracker.config.confidence.least_visible
        for name in tracker.names:
            if name in held:
                hidden = 1 - min(1.0, evidence[name].visible / least)
                sure[name] = min(1.0, sure[name] + hidden * sure.get(base, 0.0))
            else:
                sure[name] = max(sure[name], self._paths[name].sure)
        return sure

    def _head_on(self, name: str, frame: Frame) -> None:
        """Begin where the part was heading, if the picture fits better from there."""
        path = self._paths[name]
        if path.T_before is None:
            return
        ahead = heading(path.T_before, path.T_now)
        starts = distinct([path.T_now, ahead], centre=self._bodies[name].model.centre)
        if len(starts) < 2:
            return
        rest, moved = self._tracker.trials(frame, name, starts, rounds=self._config.rounds)
        if moved.score > rest.score:
            self._tracker.replace(frame, {name: ahead})

    def _left_lying(
        self, frame: Frame, evidence: dict[str, Evidence], held: Collection[str]
    ) -> dict[str, Evidence]:
        """Put parts that were left behind as the camera moved where they lie, if the picture says so;
        the evidence for all of them then."""
        tracker, poses = self._tracker, self._tracker.poses
        sure = {name: tracker.judged(seen) for name, seen in evidence.items()}
        lying, least = dict[str, Transform](), tracker.config.confidence.lost_below
        for name, T_lies in self._rest.expected(_estimates(poses, sure)).items():
            if name in held or name not in poses:
                continue
            centre = self._bodies[name].model.centre
            if point_distance(poses[name], T_lies, centre) < self._config.astray:
                continue
            found = Trial(poses[name], evidence[name], 0.0)
            (there,) = tracker.trials(frame, name, [T_lies])
            if there.score > found.score and there.confidence >= least:
                lying[name] = there.T_camera_part
        if not lying:
            return evidence
        tracker.replace(frame, lying)
        return tracker.evidence(frame)

    def _move_with_the_camera(self, sure: Mapping[str, float], held: Collection[str]) -> None:
        """Take in where all parts are; where one was last seen is told as the camera sees it now."""
        T_before = self._rest.T_camera_stage
        self._rest.see(_estimates(self._tracker.poses, sure), joined=held)
        T_now_before = self._rest.T_camera_stage @ inverse(T_before)
        for path in self._paths.values():
            if path.unsure:
                path.T_now = T_now_before @ path.T_now

    def _better(self, name: str, frame: Frame, seen: Evidence) -> Transform | None:
        """Where a pose is in doubt, a better one near it if there is one."""
        config, tracker = self._config, self._tracker
        if tracker.judged(seen) >= config.doubted_below:
            return None
        T_found = tracker.poses[name]
        starts = self._at_depth(name, T_found, seen.gap)
        if seen.visible >= tracker.config.confidence.least_visible:
            starts += self._turned_and_shifted(name, T_found)
        if not starts:
            return None
        best = max(tracker.trials(frame, name, starts), key=attrgetter("score"))
        is_better = best.score > Trial(T_found, seen, 0.0).score + config.margin
        return best.T_camera_part if is_better else None

    def _at_depth(self, name: str, T_found: Transform, gap: float | None) -> list[Transform]:
        """The pose moved along its ray to where a surface was measured, if that is another place."""
        if gap is None or abs(gap) < self._config.off_depth:
            return []
        centre = self._bodies[name].balance
        place = apply_to_point(T_found, centre)
        return [moved_to(T_found, place * (1 + gap / place[2]), centre=centre)]

    def _turned_and_shifted(self, name: str, T_found: Transform) -> list[Transform]:
        """The pose turned to all sides, the last one at its place, and the last one."""
        centre, T_last = self._bodies[name].balance, self._paths[name].T_now
        angle = np.deg2rad(self._config.turn_deg)
        turns = [rotation_about(axis, sign * angle) for axis in np.eye(3) for sign in (1.0, -1.0)]
        return [
            *(turned(T_found, R, centre=centre) for R in turns),
            moved_to(T_last, apply_to_point(T_found, centre), centre=centre),
            T_last,
        ]

    def _noted(self, path: _Path, T_found: Transform, sure: float, seen: Evidence) -> bool:
        """Remember where a part was found; whether it is to go back to where it was."""
        config = self._config
        if sure >= config.learn_above:
            is_sure = sure >= self._tracker.config.confidence.lost_below
            path.T_before = path.T_now if is_sure and not path.unsure else None
            path.T_now, path.sure, path.unsure = T_found, sure, 0
            return False
        path.T_before, path.unsure = None, path.unsure + 1
        hidden = seen.visible < config.hidden_below
        path.sure = config.unseen + config.kept * (path.sure - config.unseen) if hidden else 0.0
        return hidden or path.unsure > config.patience


def _estimates(
    poses: Mapping[str, Transform], sure: Mapping[str, float]
) -> dict[str, PoseEstimate]:
    return {name: PoseEstimate(name, T, sure[name], "tracked") for name, T in poses.items()}
