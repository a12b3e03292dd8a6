"""ASDF: poses from keypoints refined by depth, states from looks and poses fused over time.

Schieber et al., "ASDF: Assembly State Detection Utilizing Late Fusion by Integrating 6D Pose
Estimation", ISMAR 2024. `Asdf.step` reads like the paper's figure. With crop weights, first poses
come from crops, as do the state's looks; `--first-pose keypoints` takes the paper's, in steps that
are still ours, and `--published` is the paper to the letter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Camera, Detection, Frame, FramePrediction, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.contests import Contests
from asdfviz.methods.first_pose import CropPoses, LooksAtParts, best_settled, crop_poses
from asdfviz.methods.group_poses import GroupPoses
from asdfviz.methods.looked_at import Before, LookedAt
from asdfviz.methods.network import Detects, load_detector
from asdfviz.methods.on_table import none_below, on_table
from asdfviz.methods.part_finder import PartFinder
from asdfviz.methods.part_poses import (
    PartShape,
    Rests,
    part_shapes,
    poses_at_rest,
    poses_fitted_to_boxes,
    poses_from_keypoints,
    poses_refined_by_depth,
    sure_enough,
)
from asdfviz.methods.place_looks import PlaceLooks, agreed
from asdfviz.methods.rivals import settled_poses
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.state_looks import StateLooks
from asdfviz.methods.timing import StageTimer
from asdfviz.state.base_turns import BaseTurns
from asdfviz.state.fusion import Pose2State
from asdfviz.state.lately_loose import LatelyLoose
from asdfviz.state.part_names import PartNames
from asdfviz.state.relative_pose import relative_pose_probabilities
from asdfviz.state.twins import renamed, renamed_poses


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """What stays the same through a sequence."""

    assembly: Assembly
    finder: PartFinder
    shapes: dict[str, PartShape]
    pose2state: Pose2State
    crop_poses: CropPoses | None
    """None: first poses come from keypoints."""
    looks: StateLooks
    place_looks: PlaceLooks
    group: GroupPoses
    twins: PartNames
    turns: BaseTurns
    votes: BaseVotes
    lately: LatelyLoose


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
        self._scene: _Scene | None = None
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
        config, self._before = self._config, {}
        shapes = part_shapes(assembly, surface_points=config.translation.surface_points)
        sunk, given = config.on_table.counted, self._given_looker
        first = crop_poses(config.first_pose, config.crops, assembly, looker=given, sunk=sunk)
        detector = self._given_detector or load_detector(config.detector, assembly)
        contests = None
        if first is not None:

            def look(boxes: Mapping[str, Detection], frame: Frame) -> dict[str, LookedAt]:
                return first.looked_at(boxes, frame, use_depth=True, previous=self._before)

            contests = Contests(assembly, look, config.contests)
        looks = StateLooks.of(
            assembly,
            config=config.appearance,
            chosen=config.state_looks,
            detector=config.detector,
            crops=config.crops,
            crop_poses=first,
        )
        group = GroupPoses(assembly, shapes, config=config.group)
        self._scene = _Scene(
            assembly=assembly,
            finder=PartFinder(
                assembly,
                detector,
                shapes,
                looker=None if first is None else first.looker,
                names=config.names,
                second_look=config.second_look.chosen(crops=first is not None),
                by_size=not config.published,
                by_class=config.published,
                contests=contests,
            ),
            shapes=shapes,
            pose2state=Pose2State(assembly, config=config.fusion.chosen(places=looks.by_places)),
            crop_poses=first,
            looks=looks,
            place_looks=PlaceLooks(
                assembly, shapes, first and first.looker, config=config.place_looks
            ),
            group=group,
            twins=PartNames(assembly, config=config.relative_pose),
            turns=BaseTurns(assembly, config=config.relative_pose),
            votes=BaseVotes(group, places=config.relative_pose, config=config.base_votes),
            lately=LatelyLoose(assembly, config=config.lately_loose),
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

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        config, scene, timed = self._config, self._started(), StageTimer()
        proposed = self._propose(frame, timed, scene.pose2state.belief)
        with timed("state"):
            poses = proposed.poses if config.published else self._called(proposed.poses)
            places = relative_pose_probabilities(poses, scene.assembly, config=config.relative_pose)
            base, belief = poses.get(scene.assembly.base), scene.pose2state.belief
            stands = scene.place_looks.step(base, poses, belief, frame)
            loose = scene.lately.step(poses, belief)
            state = scene.pose2state.step(agreed(self.looks, stands), places, loose)
        if config.group.enabled:
            with timed("group"):
                poses = scene.group.step(poses, state, frame, may_be=scene.votes.may_be)
        scene.votes.keep(poses.get(scene.assembly.base))
        if scene.crop_poses is not None:
            poses = sure_enough(poses, config.least_score)
        return FramePrediction(frame.index, poses, state, proposed.detections, timed.seconds)

    def _called(self, poses: Mapping[str, PoseEstimate]) -> Mapping[str, PoseEstimate]:
        """The poses, the base's turned and twins named as the parts' places tell."""
        scene = self._started()
        poses = scene.turns.told(poses)
        names = scene.twins.changes({n: p.T_camera_part for n, p in poses.items()})
        self.rename(names)
        return renamed_poses(poses, names)

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._started().finder.rename(names)
        self._started().votes.rename(names)
        self._before = renamed(self._before, names)

    def disown(self, names: Collection[str]) -> None:
        """What was taken for these parts in the last frame is something else."""
        self.assigned = {n: box for n, box in self.assigned.items() if n not in names}
        self.looked_at = {n: look for n, look in self.looked_at.items() if n not in names}
        self._before = {n: before for n, before in self._before.items() if n not in names}

    def propose(
        self, frame: Frame, *, rests: Rests | None = None, belief: Scores | None = None
    ) -> FramePrediction:
        """Poses of the next frame and `looks`, no state: for methods that find that otherwise.

        Args:
            frame: to look at.
            rests: asked of every detected part; those that rest are not looked at by the crop network.
            belief: in the states before this frame, by which the parts tell where the base is.
        """
        proposed = self._propose(frame, StageTimer(), belief, rests)
        self.votes.keep(None)
        if self.votes.overruled:
            self.disown({self._started().assembly.base})
        return proposed

    def _propose(
        self, frame: Frame, timed: StageTimer, belief: Scores | None, rests: Rests | None = None
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
            scene.finder.keep(found)
            self._before = {name: self._remembered(pose) for name, pose in poses.items()}
            told = scene.votes.told(poses, belief, frame)
            at = poses if config.own_looks else told
        with timed("state"):
            self.looks = scene.looks.probabilities(detections, at, frame)
        return FramePrediction(frame.index, told, None, detections, timed.seconds)

    def _first_poses(self, found: Mapping[str, Detection], frame: Frame) -> dict[str, PoseEstimate]:
        config, scene = self._config, self._started()
        if scene.crop_poses is not None:
            looks = scene.crop_poses.looked_at(found, frame, use_depth=True, previous=self._before)
            self.looked_at |= looks
            return best_settled(looks, found)
        poses = poses_from_keypoints(found, frame, scene.assembly, config=config.pnp)
        return poses_fitted_to_boxes(poses, found, scene.shapes, frame, config=config.box_fit)

    def _remembered(self, pose: PoseEstimate) -> Before:
        """A pose, with what the network thought of its rotation so far."""
        before, look = self._before.get(pose.part), self.looked_at.get(pose.part)
        T, alike = pose.T_camera_part, self._started().assembly.parts[pose.part].symmetries
        if before is None:
            return Before(T)
        if look is None:
            return before.followed_by(T, before.liked, alike, memory=0.0)
        return before.followed_by(T, look.likely(T), alike, memory=self._config.doubts)

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

    def _started(self) -> _Scene:
        if self._scene is None:
            raise MethodError("asdf: reset() must come before step()")
        return self._scene


SPEC = MethodSpec(
    name="asdf",
    summary="The paper's pipeline: first poses, depth refinement, Pose2State",
    config=AsdfConfig,
    factory="asdfviz.methods.asdf:Asdf",
)
