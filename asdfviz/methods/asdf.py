"""ASDF: poses from keypoints refined by depth, states from looks and poses fused over time.

Schieber et al., "ASDF: Assembly State Detection Utilizing Late Fusion by Integrating 6D Pose
Estimation", ISMAR 2024. `Asdf.step` reads like the paper's figure. With crop weights, first poses
come from crops, as do the state's looks; `--first-pose keypoints` takes the paper's, in steps that
are still ours, and `--published` is the paper to the letter.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import TypeAlias

from asdfviz.datatypes import Assembly, Camera, Detection, Frame, FramePrediction, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_scene import AsdfScene, asdf_scene
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.first_confidence import with_confidence
from asdfviz.methods.first_pose import LooksAtParts, best_settled
from asdfviz.methods.flat_twins import flat_twin
from asdfviz.methods.kept_poses import Proposal, proposals_of
from asdfviz.methods.looked_at import Before, LookedAt, remembered
from asdfviz.methods.network import Detects
from asdfviz.methods.on_table import none_below, on_table
from asdfviz.methods.part_poses import (
    PartShape,
    Rests,
    poses_at_rest,
    poses_fitted_to_boxes,
    poses_from_keypoints,
    poses_refined_by_depth,
    sure_enough,
)
from asdfviz.methods.place_looks import agreed
from asdfviz.methods.pooled_keypoints import PooledBase
from asdfviz.methods.rivals import settled_poses
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.state.relative_pose import relative_pose_probabilities
from asdfviz.state.twins import renamed, renamed_poses

Mends: TypeAlias = Callable[[PoseEstimate], PoseEstimate]
"""A part's pose, by what is known better."""
SURE = 0.8
"""Score from which a part is surely where its pose has it."""


def _as_it_is(pose: PoseEstimate) -> PoseEstimate:
    return pose


class Asdf:
    """Detect, assign, PnP, refine by depth, state by looks, state by poses, fuse, group."""

    def __init__(
        self,
        config: AsdfConfig,
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
        self._given_detector, self._given_looker = detector, looker
        self._scene: AsdfScene | None = None
        self._before: dict[str, Before] = {}
        self.assigned: Mapping[str, Detection] = {}
        """Which box of the last frame is which part."""
        self.looked_at: dict[str, LookedAt] = {}
        """First poses of the last frame with their runners-up; none where keypoints give them."""
        self.looks: Scores | None = None
        """S_DL of the last frame, None where nothing spoke."""

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the networks, sample the parts' surfaces and forget the sequence before.

        Raises:
            WeightsError: there are no weights for this assembly.
        """
        self._before = {}
        self._scene = asdf_scene(
            assembly,
            self._config,
            detector=self._given_detector,
            looker=self._given_looker,
            before=lambda: self._before,
        )

    @property
    def shapes(self) -> Mapping[str, PartShape]:
        """Of the parts, once reset() was called."""
        return self._started().shapes

    @property
    def looker(self) -> LooksAtParts | None:
        """The crop network, if first poses come from it; once reset() was called."""
        first = self._started().crop_poses
        return None if first is None else first.looker

    @property
    def votes(self) -> BaseVotes:
        """Where the base is; once reset() was called."""
        return self._started().votes

    def pooled(self, frame: Frame) -> PooledBase | None:
        """The base by all joined parts' keypoints, in the frame that was looked at last; None where crops
        give first poses."""
        pooled = self._started().pooled
        return None if pooled is None else partial(pooled.base, found=self.assigned, frame=frame)

    def proposals(self, own: PoseEstimate | None, frame: Frame) -> list[Proposal]:
        """A part's pose in the frame that was looked at last and its runners-up; nothing without a pose."""
        if own is None:
            return []
        look, box = self.looked_at.get(own.part), self.assigned.get(own.part)
        if look is not None:
            return proposals_of(own, look)
        scene, first, pnp = self._started(), Proposal(own.T_camera_part, 1.0), self._config.pnp
        if not pnp.mirrored or scene.crop_poses is not None or box is None or own.stage == "group":
            return [first]
        twin = flat_twin(own, scene.assembly.parts[own.part], box, frame, config=pnp)
        return [first] if twin is None else [first, twin]

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        config, scene, timed = self._config, self._started(), StageTimer()
        proposed = self._propose(frame, timed, scene.pose2state.belief)
        with timed("state"):
            first = proposed.poses
            poses = first if config.published else self._called(first, frame)
            places = relative_pose_probabilities(poses, scene.assembly, config=config.relative_pose)
            base, belief = poses.get(scene.assembly.base), scene.pose2state.belief
            stands = scene.place_looks.step(base, poses, belief, frame)
            loose = scene.lately.step(poses, belief)
            state = scene.pose2state.step(agreed(self.looks, stands), places, loose)
        if config.group.enabled:
            with timed("group"):
                may_be, pooled = scene.votes.may_be, self.pooled(frame)
                poses = scene.group.step(poses, state, frame, may_be=may_be, pooled=pooled)
        scene.votes.keep(poses.get(scene.assembly.base))
        if scene.crop_poses is not None:
            sure = config.first_confidence
            steady = scene.steady.step({n: pose.T_camera_part for n, pose in poses.items()})
            poses = with_confidence(
                poses, self.assigned, scene.shapes, frame, steady=steady, config=sure
            )
            poses = sure_enough(poses, config.least_score)
        sure = {n: p for n, p in poses.items() if p.score >= SURE and p.stage != "group"}
        scene.unlike.see(frame, {n: p.T_camera_part for n, p in sure.items()})
        return FramePrediction(frame.index, poses, state, proposed.detections, timed.seconds)

    def _called(
        self, poses: Mapping[str, PoseEstimate], frame: Frame
    ) -> Mapping[str, PoseEstimate]:
        """The poses but those of what does not look as a part's twins do, the base's turned and twins
        named as the parts' places tell."""
        scene = self._started()
        others = scene.unlike.strangers(frame, {n: p.T_camera_part for n, p in poses.items()})
        scene.unlike.forget(others)
        self.disown(others, for_good=True)
        poses = scene.turns.told({n: pose for n, pose in poses.items() if n not in others})
        names = scene.twins.changes({n: p.T_camera_part for n, p in poses.items()})
        self.rename(names)
        return renamed_poses(poses, names)

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._started().finder.rename(names)
        self._started().votes.rename(names)
        self._started().unlike.rename(names)
        self._before = renamed(self._before, names)
        self.assigned = renamed(self.assigned, names)

    def disown(self, names: Collection[str], *, for_good: bool = False) -> None:
        """What was taken for these parts in the last frame is something else, or for good while it lies."""
        if for_good:
            boxes = [self.assigned[name] for name in names if name in self.assigned]
            self._started().finder.disown(boxes)
        self.assigned = {n: box for n, box in self.assigned.items() if n not in names}
        self.looked_at = {n: look for n, look in self.looked_at.items() if n not in names}
        self._before = {n: before for n, before in self._before.items() if n not in names}

    def propose(
        self,
        frame: Frame,
        *,
        rests: Rests | None = None,
        belief: Scores | None = None,
        mended: Mends = _as_it_is,
    ) -> FramePrediction:
        """Poses of the next frame and `looks`, no state: for methods that find that otherwise.

        Args:
            frame: to look at.
            rests: asked of every detected part; those that rest are not looked at by the crop network.
            belief: in the states before this frame, by which the parts tell where the base is.
            mended: the base's own pose by what is known better, before they do.
        """
        proposed = self._propose(frame, StageTimer(), belief, rests, mended)
        self.votes.keep(None)
        if self.votes.overruled:
            self.disown({self._started().assembly.base})
        return proposed

    def _propose(
        self,
        frame: Frame,
        timed: StageTimer,
        belief: Scores | None,
        rests: Rests | None = None,
        mended: Mends = _as_it_is,
    ) -> FramePrediction:
        config, scene, self.looked_at = self._config, self._started(), {}
        with timed("detect"):
            detections, found = scene.finder.find(frame)
            self.assigned = found
        with timed("pnp" if scene.crop_poses is None else "crops"):
            # Where first poses cost little, all are looked at.
            known = poses_at_rest(found, frame, rests) if rests and scene.crop_poses else {}
            fresh = {name: d for name, d in found.items() if name not in known}
            poses = self._first_poses(fresh, frame)
        with timed("refine"):
            poses, found = settled_poses(
                {**self._refined(poses, fresh, frame), **known},
                found,
                detections,
                frame,
                assembly=scene.assembly,
                shapes=scene.shapes,
                solve=lambda boxes: self._refined(self._first_poses(boxes, frame), boxes, frame),
                config=config.rivals,
            )
            scene.finder.keep(found, frame)
            self._before = {
                name: remembered(
                    pose,
                    self._before.get(name),
                    self.looked_at.get(name),
                    scene.assembly.parts[name].symmetries,
                    memory=config.doubts,
                )
                for name, pose in poses.items()
            }
            base = scene.assembly.base
            if base in poses:
                poses = {**poses, base: mended(poses[base])}
            told = scene.votes.told(poses, belief, frame)
            at = poses if config.own_looks else told
        with timed("state"):
            self.looks = scene.looks.step(detections, at, frame)
        return FramePrediction(frame.index, told, None, detections, timed.seconds)

    def _first_poses(self, found: Mapping[str, Detection], frame: Frame) -> dict[str, PoseEstimate]:
        config, scene = self._config, self._started()
        if scene.crop_poses is not None:
            looks = scene.crop_poses.looked_at(found, frame, use_depth=True, previous=self._before)
            self.looked_at |= looks
            return best_settled(looks, found)
        poses = poses_from_keypoints(found, frame, scene.assembly, config=config.pnp)
        return poses_fitted_to_boxes(poses, found, scene.shapes, frame, config=config.box_fit)

    def _refined(
        self, poses: Mapping[str, PoseEstimate], found: Mapping[str, Detection], frame: Frame
    ) -> dict[str, PoseEstimate]:
        config, scene = self._config, self._started()
        refined = poses_refined_by_depth(
            poses,
            found,
            scene.shapes,
            frame,
            refinement=config.refinement,
            translation=config.translation,
            icp=config.icp,
        )
        if scene.crop_poses is None or config.refinement == "none":
            return refined
        refined = none_below(refined, scene.shapes, frame)
        return on_table(refined, scene.assembly, scene.shapes, frame, config=config.on_table)

    def _started(self) -> AsdfScene:
        if self._scene is None:
            raise MethodError("asdf: reset() must come before step()")
        return self._scene


SPEC = MethodSpec(
    name="asdf",
    summary="The paper's pipeline: first poses, depth refinement, Pose2State",
    config=AsdfConfig,
    factory="asdfviz.methods.asdf:Asdf",
)
