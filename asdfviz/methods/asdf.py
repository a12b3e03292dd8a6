"""ASDF: poses from keypoints refined by depth, states from looks and poses fused over time.

Schieber et al., "ASDF: Assembly State Detection Utilizing Late Fusion by Integrating 6D Pose
Estimation", ISMAR 2024. `Asdf.step` reads like the figure of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Box
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.network import Detects, NetworkConfig, load_detector
from asdfviz.methods.part_poses import (
    PartShape,
    part_shapes,
    poses_fitted_to_boxes,
    poses_from_keypoints,
    poses_refined_by_depth,
)
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.pose.box_fit import BoxFitConfig
from asdfviz.pose.pnp import ROBUST_PNP, PnpConfig
from asdfviz.pose.translation import TranslationConfig
from asdfviz.state.appearance import AppearanceConfig, appearance_probabilities
from asdfviz.state.fusion import FusionConfig, Pose2State
from asdfviz.state.relative_pose import RelativePoseConfig, relative_pose_probabilities


@dataclass(frozen=True)
class AsdfConfig:
    """Options of the whole pipeline, stage by stage."""

    detector: NetworkConfig = field(default_factory=NetworkConfig)
    """The network."""
    pnp: PnpConfig = ROBUST_PNP
    """From keypoints to a pose."""
    box_fit: BoxFitConfig = field(default_factory=BoxFitConfig)
    """Distances that the boxes contradict."""
    translation: TranslationConfig = field(default_factory=TranslationConfig)
    """Depth refinement, section 3.1.1."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """S_DL: from state boxes to probabilities."""
    relative_pose: RelativePoseConfig = field(default_factory=RelativePoseConfig)
    """S_P: from part poses to probabilities."""
    fusion: FusionConfig = field(default_factory=FusionConfig)
    """Pose2State, equations 3 to 5."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """What stays the same through a sequence."""

    assembly: Assembly
    detector: Detects
    shapes: dict[str, PartShape]
    pose2state: Pose2State


class Asdf:
    """Detect, assign, PnP, refine by depth, state by looks, state by poses, fuse."""

    def __init__(self, config: AsdfConfig, *, detector: Detects | None = None) -> None:
        """Keep the config.

        Args:
            config: the options.
            detector: used instead of the configured network.
        """
        self._config = config
        self._given_detector = detector
        self._scene: _Scene | None = None
        self._boxes: dict[str, Box] = {}

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the network, sample the parts' surfaces and forget the sequence before.

        Raises:
            WeightsError: there are no weights for this assembly.
        """
        self._boxes = {}
        self._scene = _Scene(
            assembly=assembly,
            detector=self._given_detector or load_detector(self._config.detector, assembly),
            shapes=part_shapes(assembly, surface_points=self._config.translation.surface_points),
            pose2state=Pose2State(assembly, config=self._config.fusion),
        )

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        if self._scene is None:
            raise MethodError("asdf: reset() must come before step()")
        config, scene, timed = self._config, self._scene, StageTimer()
        assembly, shapes = scene.assembly, scene.shapes
        with timed("detect"):
            detections = scene.detector.detect(frame.rgb)
        with timed("pnp"):
            found = assign_detections(detections, assembly, previous=self._boxes)
            self._boxes |= {name: detection.box_xyxy for name, detection in found.items()}
            poses = poses_from_keypoints(found, frame, assembly, config=config.pnp)
            poses = poses_fitted_to_boxes(poses, found, shapes, frame, config=config.box_fit)
        with timed("refine"):
            poses = poses_refined_by_depth(poses, found, shapes, frame, config=config.translation)
        with timed("state"):
            looks = appearance_probabilities(detections, assembly, config=config.appearance)
            places = relative_pose_probabilities(poses, assembly, config=config.relative_pose)
            state = scene.pose2state.step(looks, places)
        return FramePrediction(frame.index, poses, state, detections, timed.seconds)


SPEC = MethodSpec(
    name="asdf",
    summary="The paper's pipeline: keypoints, PnP, depth refinement, Pose2State",
    config=AsdfConfig,
    factory="asdfviz.methods.asdf:Asdf",
)
