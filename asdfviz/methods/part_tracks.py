"""What a tracking method remembers of every part, and how it looks for each one in a new frame.

The tracker moves poses; here is decided from where it starts and whom it is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from operator import attrgetter
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Camera, Frame, PoseEstimate, State, StateEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance
from asdfviz.methods.disowned import is_disowned
from asdfviz.methods.held_colors import learn_held
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.one_place import OnePlace
from asdfviz.methods.own_colors import OwnColors
from asdfviz.methods.place_support import PlaceSupport
from asdfviz.methods.refinding import (
    RefindConfig,
    carried_on,
    distinct,
    found_elsewhere,
    is_mistaken,
    jumps,
    places_in,
    preferred,
)
from asdfviz.methods.rival_poses import believed, decided
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.track_memory import Track
from asdfviz.methods.tracked_base import TrackedBase
from asdfviz.methods.tracking import load_bodies
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.state.twins import renamed
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

LEAST_VISIBLE = 0.3
"""A part of which less is visible is not asked which turn of it looks more like what is seen."""

Value: TypeAlias = Callable[[Trial], float]


class PartTracks:
    """All parts of an assembly that were seen so far."""

    def __init__(
        self,
        assembly: Assembly,
        camera: Camera,
        *,
        tracker: TrackerConfig,
        refind: RefindConfig,
        turns: TurnConfig,
        own: OwnColors | None = None,
        smear: SeenSmear | None = None,
        base: TrackedBase | None = None,
    ) -> None:
        """Load the parts' viewpoint models; `own`, `smear` and `base` are told by others what they know."""
        self.bodies = load_bodies(assembly)
        self.tracker = Tracker(self.bodies, camera, tracker)
        self.tracks: dict[str, Track] = {}
        self._assembly = assembly
        self._config = refind
        self._one_place = OnePlace(assembly)
        self._own = own
        self._base = base or TrackedBase(assembly.base, None)
        self.checks = TurnChecks(assembly.parts, self.bodies, config=turns, smear=smear)
        self._frames = 0

    def refind(
        self,
        frame: Frame,
        proposed: Mapping[str, PoseEstimate],
        looked_at: Mapping[str, LookedAt],
        state: StateEstimate | None,
    ) -> None:
        """Put every part where it fits best, the base part first; take in those seen first.

        Args:
            frame: the new frame.
            proposed: the detector's poses.
            looked_at: what they came from; none where keypoints gave them.
            state: what was said of the frame before.
        """
        self._frames += 1
        self.begin(frame, {n: p.T_camera_part for n, p in proposed.items() if n not in self.tracks})
        base = self._assembly.base
        for name in sorted(self.tracks, key=lambda name: name != base):
            self.tracks[name].support.fade(self._config.support)
            if name in proposed:
                self._believe_the_detector(name, frame, proposed[name], looked_at.get(name))
            self.checks.looks.around = self._surely_there()
            self._look_for(name, frame, proposed.get(name), looked_at.get(name), state)
        poses, self.checks.looks.around = self.tracker.poses, self._surely_there()
        free = {name: poses[name] for name, track in self.tracks.items() if track.explore}
        turned = self.checks.step(frame, self.tracker, free, looked_at)
        self.tracker.replace(frame, turned)
        for name in turned:
            self.tracks[name].rival = None

    @property
    def last(self) -> dict[str, Transform]:
        """Where parts last surely were, T_camera_part."""
        return {name: track.T_now for name, track in self.tracks.items() if track.age}

    @property
    def joined(self) -> frozenset[str]:
        """Parts that the base held in the last frame."""
        return frozenset(name for name, track in self.tracks.items() if track.joined)

    def out_of_sight(self, frame: Frame, names: frozenset[str]) -> frozenset[str]:
        """Those of some parts that were lost, or are hidden where they are tracked."""
        seen, least = self.tracker.evidence(frame), self._config.hidden_below
        return frozenset(n for n in names if self.tracks[n].unsure or seen[n].visible < least)

    def begin(self, frame: Frame, poses: Mapping[str, Transform]) -> None:
        """Take in parts that were not tracked, at poses T_camera_part; all others are let go."""
        if poses:
            self.tracker.add(frame, poses)
            self.tracks |= {name: Track(T) for name, T in poses.items()}

    def let_go(self, names: frozenset[str]) -> None:
        """Track these parts no longer."""
        self.tracks = {name: track for name, track in self.tracks.items() if name not in names}
        self.tracker.drop(names)

    def settle(self, frame: Frame, joined: frozenset[str]) -> dict[str, PoseEstimate]:
        """Keep the tracker's poses that fit, put the others back, and return what is to be said.

        Args:
            frame: the frame that the tracker moved to.
            joined: parts that the base holds, also where they are not seen, until it is lost.
        """
        evidence = self.tracker.evidence(frame)
        sure = {name: self.tracker.judged(seen) for name, seen in evidence.items()}
        least = self.tracker.config.confidence.lost_below
        poses, base = self.tracker.poses, self._assembly.base
        self._base.call_back(self.tracks, poses, sure)
        shown = {name for name in sure if sure[name] >= least}
        self._base.as_held(sure, joined & shown)
        said: dict[str, PoseEstimate] = {}
        back: dict[str, Transform] = {}
        intruders = self._one_place.intruders(poses, sure, joined=joined)
        for name, T_found in poses.items():
            if name in intruders:
                continue
            track = self.tracks[name]
            visible = evidence[name].visible
            track.joined = name in joined
            track.explore = not track.joined and visible >= self._config.seen
            if sure[name] >= least:
                track.take(T_found)
            else:
                track.T_before, track.unsure = None, track.unsure + 1
                lost = visible >= self._config.hidden_below
                track.missing = track.missing + 1 if lost else 0
                if name in joined:
                    track.T_now = T_found
                else:
                    back[name] = track.T_now
                    if lost or track.is_new or track.unsure > self._config.patience:
                        continue
            stage = "group" if name in joined else "tracked"
            said[name] = PoseEstimate(name, track.T_now, sure[name], stage)
        if base in poses and self.tracks[base].unsure > self._config.patience:  # it holds nothing
            said = {n: p for n, p in said.items() if self.tracks[n].unsure <= self._config.patience}
        if base in said and base in shown and evidence[base].visible >= self._config.hidden_below:
            self._base.keep(said[base])
        self.tracker.learn(frame, [name for name in said if name in shown])
        held = {name: evidence[name] for name in joined & evidence.keys()}
        learn_held(frame, self.tracker, self.tracks, held, config=self._config.held)
        self.let_go(intruders)  # and all that were held move freely
        self.tracker.replace(frame, back)
        return said

    def rename(self, frame: Frame, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self.checks.rename(names)
        poses = renamed({n: T for n, T in self.tracker.poses.items() if n in names}, names)
        if not poses:
            return
        self.tracks = renamed(self.tracks, names)
        self.tracker.drop([name for name in names if name in self.tracker.names])
        self.tracker.add(frame, poses)

    def _believe_the_detector(
        self, name: str, frame: Frame, proposal: PoseEstimate, look: LookedAt | None
    ) -> None:
        """Begin anew where the detector has a part that does not fit, or keeps finding it elsewhere."""
        track = self.tracks[name]
        settle = partial(self.tracker.trials, frame, name)
        anew = not track.joined and is_disowned(
            track, proposal, look, settle, config=self._config.disowned
        )
        if not anew and not track.explore and not track.unsure:  # the state holds it
            return
        anew = anew or found_elsewhere(
            track,
            proposal,
            proposal.score if look is None else look.detection.score,
            centre=self.bodies[name].model.centre,
            diameter=self._assembly.parts[name].diameter,
            config=self._config.support,
        )
        if anew or is_mistaken(track, proposal, settle, config=self._config):
            self.tracks[name] = Track(proposal.T_camera_part)
            self.tracker.drop([name])
            self.tracker.add(frame, {name: proposal.T_camera_part})

    def _look_for(
        self,
        name: str,
        frame: Frame,
        proposal: PoseEstimate | None,
        look: LookedAt | None,
        state: StateEstimate | None,
    ) -> None:
        """Try all starts of one part and put it where it fits best."""
        config, track, tracker = self._config, self.tracks[name], self.tracker
        if track.joined and not track.unsure:  # what the detector finds elsewhere is another thing
            proposal = None
        centre, balance = self.bodies[name].model.centre, self.bodies[name].balance
        on = tracker.trials(frame, name, carried_on(track, proposal, centre=balance))
        best = carried = max(on, key=attrgetter("score"))
        starts = self._joined_places(name, track, state)
        starts += jumps(track, proposal, look, centre=balance, frames=self._frames, config=config)
        allows = partial(self.checks.allows, frame, name, best.T_camera_part)
        starts = [T for T in starts if allows(T) and self._base.may_be(name, T)]
        starts = distinct(starts, centre=centre, known=[best.T_camera_part])
        rough = tracker.trials(frame, name, starts, rounds=config.rough_rounds)
        value = partial(preferred, look=look, K=frame.camera.K, centre=centre, config=config)
        ahead = partial(self._ahead, frame, name, value)
        rough = sorted(rough, key=value, reverse=True)[: config.kept]
        promising = [t.T_camera_part for t in rough if value(t) > value(best) - config.doubt]
        seen = () if proposal is None else (proposal.T_camera_part,)
        promising += [T for T in seen if self.checks.is_turn(name, best.T_camera_part, T)]
        settled = [t for t in tracker.trials(frame, name, promising) if allows(t.T_camera_part)]
        if self._own is not None:
            other = partial(self._own.is_other, frame, name, T_last=track.T_now)
            settled = [trial for trial in settled if not other(trial.T_camera_part)]
        best = decided(track, best, settled, ahead)
        if track.rival is not None and track.explore:
            start = best.T_camera_part @ track.rival.T_track_rival
            if self.checks.allows(frame, name, best.T_camera_part, start):
                trial = tracker.trials(frame, name, [start])[0]
                best = believed(track, track.rival, best, trial, ahead, config=config)
        tracker.replace(frame, {name: best.T_camera_part})
        moved = point_distance(best.T_camera_part, track.T_now, centre)
        if moved > self._assembly.parts[name].diameter:
            is_hidden = carried.evidence.visible < config.hidden_below
            if not (track.is_established and is_hidden):
                tracker.forget_colors(name)  # those of another thing speak against the part
            track.support = PlaceSupport()  # the detector's word was for another place
        if track.age == 0:  # its colours were learnt at a pose that may have been poor
            tracker.drop([name])
            tracker.add(frame, {name: best.T_camera_part})

    def _surely_there(self) -> dict[str, Transform]:
        return {n: T for n, T in self.tracker.poses.items() if not self.tracks[n].unsure}

    def _ahead(
        self, frame: Frame, name: str, value: Value, now: Trial, other: Trial
    ) -> tuple[float, bool]:
        """By how much another pose of a part fits better, and whether a single frame tells so.

        The tracker's own colours and depth do not where the part would only be turned otherwise: it learnt
        them in the turn that it has. Parts that the state joins are not drawn: what is beside them is not
        the table. Nor are hidden ones: the little that shows looks like many a turn.
        """
        looks: float | None = None
        visible = min(now.evidence.visible, other.evidence.visible)
        if not self.tracks[name].joined and visible >= LEAST_VISIBLE:
            T_now, T_other = now.T_camera_part, other.T_camera_part
            looks = self.checks.in_favour(frame, name, T_now, T_other)
        if looks is not None and looks > self._config.plainly:
            return looks, True
        is_clear = other.score - now.score > self._config.margin
        ahead = value(other) - value(now) + (looks or 0.0)
        return ahead, is_clear and (looks is None or looks > self._config.looks)

    def _joined_places(
        self, name: str, track: Track, state: StateEstimate | None
    ) -> list[Transform]:
        """Where the two most probable states join the part to the base."""
        base = self.tracks.get(self._assembly.base)
        if base is None or not base.age or state is None:
            return []
        assembly, centre = self._assembly, self.bodies[name].model.centre
        two: list[State] = [assembly.states[i] for i in np.argsort(-state.probabilities)[:2]]
        return places_in(two, name, base.T_now, track.T_now, assembly=assembly, centre=centre)
