"""ASDF with a tracker: the detector proposes, the tracker holds, the state says what moves together.

Not in the paper. Every part is tracked by colour and depth from several starts, the detector's pose
among them, so that one that was lost is found again. Between two poses that fit about as well the crop
network decides over time, and a part that the detector keeps finding elsewhere begins anew there; parts
that the state joins are tracked as one, with the freedoms of their joints. The state is followed as
`asdf_plus` does, from the tracked poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from asdfviz.datatypes import (
    Assembly,
    Camera,
    Frame,
    FramePrediction,
    PoseEstimate,
    State,
)
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.asdf_track_scene import TrackScene, track_scene
from asdfviz.methods.doubts import contested, doubted
from asdfviz.methods.found_elsewhere import against_held, names_of_loose
from asdfviz.methods.hidden_parts import sure_as_it_lay, sure_as_the_base
from asdfviz.methods.in_table import in_table
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.network import Detects
from asdfviz.methods.part_poses import sure_enough
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.methods.track_confidence import as_probabilities
from asdfviz.methods.track_memory import surely_placed, with_turned_axes
from asdfviz.state.joints import deviation, spread_of
from asdfviz.state.twins import names_after, renamed, renamed_poses


class AsdfTrack:
    """Propose, look for every part, track joined parts as one, fuse the state."""

    def __init__(self, config: AsdfTrackConfig, *, detector: Detects | None = None) -> None:
        """Keep the config.

        Args:
            config: the options.
            detector: used instead of the configured network.
        """
        self._config = config
        self._asdf = Asdf(config, detector=detector)
        self._scene: TrackScene | None = None

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the network and the parts' viewpoint models; forget the sequence before.

        Raises:
            WeightsError: there are no weights for this assembly.
        """
        self._asdf.reset(assembly, camera, None)
        self._scene = track_scene(assembly, camera, self._asdf, config=self._config)

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        if self._scene is None:
            raise MethodError("asdf_track: reset() must come before step()")
        scene, timed = self._scene, StageTimer()
        assembly, parts = scene.assembly, scene.parts
        proposed, shown = self._proposed(frame, scene), frame
        if frame.depth is None:  # to the tracker, depth that measured nothing
            frame = replace(frame, depth=np.zeros(frame.rgb.shape[:2], np.float32))
        with timed("refind"):
            mine, looks = self._proposals(frame, proposed.poses, scene)
            expected = {**scene.told.rest.expected(mine), **scene.base.place}
            for name, track in parts.tracks.items():
                track.T_expected = expected.get(name)
            parts.refind(frame, mine, looks, scene.state)
            first = proposed.poses.get(assembly.base)
            first = scene.known.told(first, scene.T_camera_base, frame, self._asdf.votes)
            names = scene.twins.changes(parts.tracker.poses, held=parts.joined)
            parts.rename(frame, names)
            for one in (self._asdf, scene.still, scene.unlike, scene.own, scene.told):
                one.rename(names)
        with timed("track"):
            joined = self._join(frame, scene)
            parts.tracker.move(frame)
            self._lift(frame, joined, scene)
            poses = self._without_strangers(frame, parts.settle(frame, joined), scene)
            poses = self._turned(frame, poses, scene)
            scene.told.rest.see({} if shown.depth is None else poses, joined=joined)
            sure = {n: parts.tracks[n].T_now for n in surely_placed(parts.tracks)}
            scene.still.see(frame, sure, held=parts.joined)
            scene.unlike.see(frame, sure)
            scene.own.see(frame, sure)
            if assembly.base in poses:
                seen = {n: pose for n, pose in poses.items() if not parts.tracks[n].unsure}
                scene.places.see(poses[assembly.base].T_camera_part, seen)
        with timed("fuse"):
            # What the state holds together cannot bear witness for the state.
            free = {name: pose for name, pose in poses.items() if pose.stage != "group"}
            if self._config.join.elsewhere:
                free |= against_held(mine, parts.tracks, assembly)
            scene.state = scene.followed.step(
                self._asdf.looks,
                poses,
                shown,
                first=first,
                free=free,
                rest=scene.told.rest,
            )
        with timed("lay"):
            poses = scene.told.step(poses, frame, scene.followed.joins)
        runtime = {**proposed.runtime, **timed.seconds}
        said = self._said(frame, poses, scene)
        return FramePrediction(frame.index, said, scene.state, proposed.detections, runtime)

    def _proposed(self, frame: Frame, scene: TrackScene) -> FramePrediction:
        """The detector's poses, the base's turned as it is known to be."""
        return self._asdf.propose(
            frame,
            belief=scene.followed.said,
            mended=lambda own: scene.known.mended(own, scene.T_camera_base, frame),
        )

    def _said(
        self, frame: Frame, poses: Mapping[str, PoseEstimate], scene: TrackScene
    ) -> dict[str, PoseEstimate]:
        """The poses as sure as they are, also of what is hidden, without those that are too unsure."""
        config, assembly, tracks = self._config, scene.assembly, scene.parts.tracks
        poses = doubted(poses, tracks, scene.own, frame, config=config.doubt)
        least = config.refind.hidden_lain
        poses = sure_as_the_base(
            sure_as_it_lay(poses, tracks, scene.told.rest, least=least),
            tracks,
            frame,
            meshes={name: part.mesh for name, part in assembly.parts.items()},
            base=assembly.base,
            share=config.refind.hidden,
        )
        # Last: what may only be turned otherwise is in its place all the same, and is not withheld.
        told = sure_enough(poses, config.least_score)
        told = contested(told, scene.parts.checks.contested(), config=config.turns)
        return as_probabilities(told, config=config.confidence)

    def _proposals(
        self, frame: Frame, poses: Mapping[str, PoseEstimate], scene: TrackScene
    ) -> tuple[dict[str, PoseEstimate], dict[str, LookedAt]]:
        """The detector's poses, and what they came from, without those of things that lay there while
        the part was elsewhere.

        The detector's twins are called as the tracker calls those that it follows, and it learns that:
        else one that is tracked would be proposed by the other's name for good, which so is never found.
        """
        last, tracks = scene.parts.last, scene.parts.tracks
        patience = self._config.refind.patience
        sure = [n for n, track in tracks.items() if track.joined or track.unsure <= patience]
        found = {name: pose.T_camera_part for name, pose in poses.items()}
        names = scene.twins.follows(found, last, sure=sure)
        if self._config.join.elsewhere:
            now = renamed(found, names)
            names = names_after(names, names_of_loose(now, tracks, scene.assembly))
        self._asdf.rename(names)
        at, mine = renamed(found, names), renamed_poses(poses, names)
        looks = renamed(self._asdf.looked_at, names)
        others = scene.still.others(frame, at, last, scene.parts.out_of_sight)
        others |= scene.unlike.strangers(frame, at) | scene.own.others(frame, at, last)
        return (
            {name: pose for name, pose in mine.items() if name not in others},
            {name: look for name, look in looks.items() if name not in others},
        )

    def _lift(self, frame: Frame, joined: frozenset[str], scene: TrackScene) -> None:
        """Put what the tracker moved into the table back to where it was, unless it fits there."""
        tracker, tracks, sure = scene.parts.tracker, scene.parts.tracks, self._config.in_table.sure
        free = {
            name: PoseEstimate(name, T, 0.0, "tracked")
            for name, T in tracker.poses.items()
            if name not in joined
        }
        sunk = self._sunk(frame, free, scene)
        if sunk:
            seen = tracker.evidence(frame)
            unsure = [name for name in sunk if tracker.judged(seen[name]) <= sure]
            tracker.replace(frame, {name: tracks[name].T_now for name in unsure})

    def _sunk(
        self, frame: Frame, poses: Mapping[str, PoseEstimate], scene: TrackScene
    ) -> frozenset[str]:
        base, shapes = scene.assembly.base, self._asdf.shapes
        return in_table(poses, shapes, frame, base=base, config=self._config.in_table)

    def _without_strangers(
        self, frame: Frame, poses: Mapping[str, PoseEstimate], scene: TrackScene
    ) -> dict[str, PoseEstimate]:
        """The poses without those on things that only have a part's shape, and without those in the table or
        in other parts, which are tracked no longer.

        What the state holds stays.
        """
        free = {n: pose.T_camera_part for n, pose in poses.items() if pose.stage != "group"}
        strangers = scene.unlike.strangers(frame, free)
        if strangers:
            scene.unlike.forget(strangers)
            scene.own.forget(strangers)
            scene.parts.let_go(strangers)
        held = {n for n in scene.parts.joined if n in poses and not scene.parts.tracks[n].unsure}
        within = self._sunk(frame, poses, scene) | scene.space.intruders(poses, held=held)
        scene.parts.let_go(within)
        return {n: pose for n, pose in poses.items() if n not in strangers | within}

    def _turned(
        self, frame: Frame, poses: dict[str, PoseEstimate], scene: TrackScene
    ) -> dict[str, PoseEstimate]:
        """The poses, those of a base that looks the same turned as the others tell it.

        The tracker has it so from now on.
        """
        base, told = scene.assembly.base, scene.followed.turned(poses)
        if base in poses:
            T_base_turned = inverse(poses[base].T_camera_part) @ told[base].T_camera_part
            if not np.allclose(T_base_turned, np.eye(4)):
                parts, tracker = scene.parts, scene.parts.tracker
                parts.tracks[base] = with_turned_axes(parts.tracks[base], T_base_turned)
                tracker.release()  # or what is held would turn with it
                tracker.replace(frame, {base: tracker.poses[base] @ T_base_turned})
        return told

    def _join(self, frame: Frame, scene: TrackScene) -> frozenset[str]:
        """Hold the parts together that the state joins; return their names without the base.

        Those that are not tracked, as nobody found them, begin where a settled state has them. What
        is not seen is in its joint where the parts that move with it tell.
        """
        tracker, base, config = scene.parts.tracker, scene.assembly.base, self._config.join
        told, state = scene.followed.unfolded, scene.followed.joins
        tracker.release()
        if told is None or state is None or base not in tracker.names:
            return frozenset()
        odds = {name: p for name, p in scene.odds.of(told).items() if name != base}
        settled = [name for name, p in odds.items() if p >= config.settled]
        poses, tracks = tracker.poses, scene.parts.tracks
        if settled:
            at = {n: poses[base] @ scene.places.last(n, state) for n in settled}
            scene.parts.begin(frame, {n: T for n, T in at.items() if n not in poses})
            tracker.replace(frame, {n: T for n, T in at.items() if tracks[n].unsure})
            poses = tracker.poses
        likely = [n for n, p in odds.items() if n in poses and p >= config.probability]
        near = [n for n in likely if n in settled or self._joins(n, poses, state, scene)]
        held = {name: T for name, T in state.T_base_part.items() if name == base or name in near}
        joints = {name: joint for name, joint in state.joints.items() if name in near}
        tracker.hold(replace(state, T_base_part=held, joints=joints), base=base)
        return frozenset(near)

    def _joins(
        self, name: str, poses: Mapping[str, Transform], state: State, scene: TrackScene
    ) -> bool:
        """Whether a part is where the state has it, or was not seen for long."""
        config, base = self._config.join, scene.assembly.base
        off = deviation(
            inverse(poses[base]) @ poses[name],
            state.T_base_part[name],
            center_part=scene.parts.bodies[name].model.centre,
            symmetries=scene.assembly.parts[name].symmetries,
            joint=state.joints.get(name),
            spread=spread_of(scene.assembly.parts[name]),
        )
        near = off.within(config.distance, config.angle_deg)
        return near or scene.parts.tracks[name].unsure > config.patience


SPEC = MethodSpec(
    name="asdf_track",
    summary="ASDF with a tracker: parts are held between detections and joined by the state",
    config=AsdfTrackConfig,
    factory="asdfviz.methods.asdf_track:AsdfTrack",
    viewpoints=True,
)
