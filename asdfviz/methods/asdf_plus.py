"""ASDF, and what pays beyond the paper, frame by frame: same detector, same frames, no tracker.

First poses of `asdf` and their runners-up are kept side by side over time and judged by depth, box and
what the crop network thinks of each rotation; those from keypoints are registered with the depth image
in six degrees of freedom. Contours, depth and the table settle every pose and turn what was taken end
for end. The detector looks again, nearer, at what depth shows and no box explains. Twins go by the
place where they lie. Parts that the state joins are placed by the group, and settled as one. The state
comes from a hidden Markov model. A score is the probability that a pose is right; rather wrong ones
are withheld.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial

from asdfviz.datatypes import Assembly, Camera, Detection, Frame, FramePrediction, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_plus_scene import PlusScene, plus_scene
from asdfviz.methods.contour_fits import ContourFit
from asdfviz.methods.doubts import contested
from asdfviz.methods.first_pose import LooksAtParts
from asdfviz.methods.in_table import in_table
from asdfviz.methods.kept_poses import Decision, pose_confidence
from asdfviz.methods.network import Detects
from asdfviz.methods.part_poses import sure_enough
from asdfviz.methods.second_thoughts import settled_by_contours
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.pose.confidence import confidence_held
from asdfviz.state.twins import renamed, renamed_poses

SURE = 0.8
"""Score from which a part is surely where its pose has it;"""
JOINED = 0.6
"""Probability from which a part moves with the base;"""
UNMEASURED = 0.5
"""and most that a pose scores where depth is blind."""


class AsdfPlus:
    """ASDF's poses, kept over time, grouped, and a state that is followed."""

    def __init__(
        self,
        config: AsdfPlusConfig,
        *,
        detector: Detects | None = None,
        looker: LooksAtParts | None = None,
    ) -> None:
        """Keep the config.

        Args:
            config: the options.
            detector: used instead of the configured network.
            looker: used instead of the configured crop network.
        """
        self._config = config
        self._asdf = Asdf(config, detector=detector, looker=looker)
        self._scene: PlusScene | None = None

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the networks and forget the sequence before.

        Raises:
            WeightsError: there are no weights for this assembly.
        """
        self._asdf.reset(assembly, camera, None)
        self._scene = plus_scene(
            assembly, camera, self._asdf.shapes, self._asdf.looker, config=self._config
        )

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        if self._scene is None:
            raise MethodError("asdf_plus: reset() must come before step()")
        config, scene, timed = self._config, self._scene, StageTimer()
        assembly, asdf, votes = scene.assembly, self._asdf, self._asdf.votes
        proposed = asdf.propose(
            frame,
            rests=lambda name, box, now: scene.hypotheses[name].rests(box, now),
            belief=scene.followed.said,
            mended=lambda own: scene.known.mended(own, scene.T_camera_base, frame),
        )
        proposed = self._without_others(proposed, frame, scene)
        with timed("register"):
            decided = self._decided(proposed, frame, scene)
        with timed("contours"):
            decided, fits = settled_by_contours(
                scene.contours,
                scene.hypotheses,
                decided,
                frame,
                held=scene.group.held,
                looked_at=scene.looks.step(asdf.looked_at, asdf.assigned),
            )
        with timed("follow"):
            followed = self._followed(proposed, decided, fits, frame, scene)
            told = proposed.poses.get(assembly.base)
            told = scene.known.told(told, scene.T_camera_base, frame, votes)
            followed = votes.preferred(followed, told, least=config.least_score)
            poses = self._named_by_place(scene.followed.turned(followed), scene)
            self._see_what_rests(poses, frame, scene)
            looks, rest = asdf.looks, scene.told.rest
            state = scene.followed.step(looks, poses, frame, first=told, rest=rest)
        unfolded, hidden = scene.followed.unfolded, votes.hidden
        if config.joined.enabled:
            with timed("group"):
                base = hidden or scene.mistaken.doubted_base(frame, scene.followed.base)
                may_be, pooled = votes.may_be, asdf.pooled(frame)
                poses = scene.group.step(
                    poses, unfolded, frame, base=base, may_be=may_be, pooled=pooled
                )
                if hidden is None:
                    poses = self._settled_together(poses, frame, scene)
                else:  # what shows of the group may leave it free along its joints
                    scene.followed.settle(hidden.T_camera_part)
                # A loose twin of what is joined there.
                poses = scene.one_place.alone(poses, joined=scene.group.held)
        scene.mistaken.see(frame, poses, _scores(asdf.assigned))
        sure = {n: p for n, p in poses.items() if p.score >= SURE and p.stage != "group"}
        scene.unlike.see(frame, {n: p.T_camera_part for n, p in sure.items()})
        votes.keep(poses.get(assembly.base) if hidden is None else None)
        with timed("lay"):
            poses = scene.told.step(poses, frame, scene.followed.joins)
        if hidden is not None:
            poses = self._sure_as_held(poses, scene.group.held)
        runtime = {**proposed.runtime, **timed.seconds}
        poses = sure_enough(poses, 0.0 if frame.depth is None else config.least_score)
        if scene.contours is not None:
            poses = contested(poses, scene.contours.contested(), config=config.contours.turns)
        return FramePrediction(frame.index, poses, state, proposed.detections, runtime)

    def _see_what_rests(
        self, poses: Mapping[str, PoseEstimate], frame: Frame, scene: PlusScene
    ) -> None:
        """What is probably joined moves with the base; without depth poses are too rough."""
        told = scene.followed.unfolded
        odds = {} if told is None else scene.odds.of(told)
        joined = {n for n, p in odds.items() if p >= JOINED and n != scene.assembly.base}
        scene.told.rest.see({} if frame.depth is None else poses, joined=joined)

    def _without_others(
        self, proposed: FramePrediction, frame: Frame, scene: PlusScene
    ) -> FramePrediction:
        """The first poses but those of things that stood there while the part was elsewhere."""
        others = _others(proposed.poses, proposed, self._asdf.assigned, frame, scene)
        self._asdf.disown(others)
        kept = {name: pose for name, pose in proposed.poses.items() if name not in others}
        return replace(proposed, poses=kept)

    def _named_by_place(
        self, poses: Mapping[str, PoseEstimate], scene: PlusScene
    ) -> dict[str, PoseEstimate]:
        """Give twins the names that belong to their places, now and from now on."""
        names = scene.twins.changes({n: p.T_camera_part for n, p in poses.items()})
        scene.hypotheses.update(renamed(scene.hypotheses, names))
        scene.told.rename(names)
        scene.mistaken.rename(names)
        scene.unlike.rename(names)
        self._asdf.rename(names)
        scene.looks.rename(names)
        if scene.contours is not None:
            scene.contours.rename(names)
        return renamed_poses(poses, names)

    def _decided(
        self, proposed: FramePrediction, frame: Frame, scene: PlusScene
    ) -> dict[str, Decision]:
        """The most trusted pose of every part, this frame's first poses among them.

        One that was kept, and turns out to be another thing's, is dropped.
        """
        found, contours, decided = self._asdf.assigned, scene.contours, dict[str, Decision]()
        for name, hypotheses in scene.hypotheses.items():
            look = self._asdf.looked_at.get(name)
            decision = hypotheses.step(
                self._asdf.proposals(proposed.poses.get(name), frame),
                frame,
                box_xyxy=found[name].box_xyxy if name in found else None,
                likely=None if look is None else look.likely,
                allows=contours and partial(contours.allows, frame, name),
            )
            if decision is not None:
                decided[name] = decision
        best = {
            n: PoseEstimate(n, d.best.T_camera_part, d.best.trust, "refined")
            for n, d in decided.items()
        }
        for name in _others(best, proposed, found, frame, scene):
            scene.hypotheses[name].disown()
            del decided[name]
        return decided

    def _settled_together(
        self, poses: dict[str, PoseEstimate], frame: Frame, scene: PlusScene
    ) -> dict[str, PoseEstimate]:
        """The poses, those of the parts that the state holds together settled as one."""
        held, state = scene.group.held, scene.followed.joins
        if scene.together is None or state is None or len(held) < 2:
            return poses
        settled = scene.together.step(
            frame, {name: poses[name].T_camera_part for name in held}, state
        )
        if not settled:
            return poses
        fits, config = scene.together.fits, self._config.confidence
        sure = {n: confidence_held(poses[n].score, fits.get(n), config=config) for n in settled}
        fitted = {n: PoseEstimate(n, T, sure[n], "group") for n, T in settled.items()}
        scene.group.see(settled[scene.assembly.base], fitted)
        scene.followed.settle(settled[scene.assembly.base])
        return {**poses, **fitted}

    def _sure_as_held(
        self, poses: Mapping[str, PoseEstimate], held: Collection[str]
    ) -> dict[str, PoseEstimate]:
        """The poses, held ones as sure as that makes them.

        They are not settled as one while the base is hidden, so that they are no surer to what looks for
        them in the next frame.
        """
        config, told = self._config.confidence, dict(poses)
        for name in told.keys() & held:
            sure = confidence_held(told[name].score, None, config=config)
            told[name] = replace(told[name], score=sure)
        return told

    def _followed(
        self,
        proposed: FramePrediction,
        decided: Mapping[str, Decision],
        fits: Mapping[str, ContourFit],
        frame: Frame,
        scene: PlusScene,
    ) -> dict[str, PoseEstimate]:
        """The decided poses and how sure they are; of two parts in one place, the surer one."""
        found, poses = self._asdf.assigned, dict[str, PoseEstimate]()
        for name, decision in decided.items():
            own, fit = proposed.poses.get(name), fits.get(name)
            sure = pose_confidence(
                decision,
                found[name].score if name in found else None,
                None if fit is None else fit.sure,
                loose=name not in scene.group.held,
                config=self._config.confidence,
            )
            stage = "refined"
            if not decision.is_measured and own is not None:
                stage = own.stage
                if frame.depth is not None:  # the pose by colour alone is right but roughly
                    sure = min(own.score, UNMEASURED)
            T = decision.best.T_camera_part if fit is None else fit.T_camera_part
            poses[name] = PoseEstimate(name, T, sure, stage)
        config, base = self._config.in_table, scene.assembly.base
        sunk = in_table(poses, self._asdf.shapes, frame, base=base, config=config)
        held = {n for n in scene.group.held if n in poses and poses[n].score >= SURE}
        within = sunk | scene.space.intruders(poses, held=held).difference(scene.group.held)
        poses = {name: pose for name, pose in poses.items() if name not in within}
        return scene.one_place.alone(scene.mistaken.doubted(frame, poses))


def _scores(found: Mapping[str, Detection]) -> dict[str, float]:
    return {name: box.score for name, box in found.items()}


def _others(
    poses: Mapping[str, PoseEstimate],
    proposed: FramePrediction,
    boxes: Mapping[str, Detection],
    frame: Frame,
    scene: PlusScene,
) -> frozenset[str]:
    """The parts whose poses are those of things that stood there while the part was elsewhere, or that do
    not look as its twins do; what the state holds stays."""
    base = scene.followed.base or proposed.poses.get(scene.assembly.base)
    T_camera_base = None if base is None else base.T_camera_part
    found = scene.mistaken.found(frame, poses, T_camera_base, scores=_scores(boxes))
    free = {n: p.T_camera_part for n, p in poses.items() if n not in scene.group.held}
    strangers = scene.unlike.strangers(frame, free)
    scene.unlike.forget(strangers)
    return found | strangers


SPEC = MethodSpec(
    name="asdf_plus",
    summary="ASDF with poses kept over time, settled by contours and as a group, and a followed state",
    config=AsdfPlusConfig,
    factory="asdfviz.methods.asdf_plus:AsdfPlus",
    viewpoints=True,
)
