"""YOLOv8-pose with PnP: the paper's baseline. Poses from keypoints, the state from its box alone.

With crop weights, first poses come from crops instead, in which depth has a say where there is some, and
the crop network names what the detector finds, or misses at first. `--first-pose keypoints` has
the paper's kind, and `--published` is the paper to the letter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.methods.first_pose import (
    CropPoseConfig,
    CropPoses,
    FirstPose,
    LooksAtParts,
    crop_poses,
)
from asdfviz.methods.network import Detects, NetworkConfig, load_detector, masks_path
from asdfviz.methods.part_finder import PartFinder
from asdfviz.methods.part_poses import (
    PAPER_ICP,
    AnyRefinement,
    PartShape,
    part_shapes,
    poses_from_keypoints,
    poses_refined_by_depth,
)
from asdfviz.methods.published import STEPS, publish
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.state_looks import StateLooks, StateLooksFrom
from asdfviz.methods.strangers import StrangersConfig
from asdfviz.methods.thing_names import NamesConfig
from asdfviz.methods.timing import StageTimer
from asdfviz.pose.icp import IcpConfig
from asdfviz.pose.pnp import PnpConfig
from asdfviz.pose.table import SunkConfig
from asdfviz.pose.translation import TranslationConfig
from asdfviz.state.appearance import AppearanceConfig

_BY_SCORE = NamesConfig(enabled=False, strangers=StrangersConfig(enabled=False))
LOOKS_AGAIN = SecondLookConfig(enabled=True, keypoints=False)
"""For the baselines: the paper's own look once."""


@dataclass(frozen=True)
class Yolov8PoseConfig:
    """Options of the baseline; PnP as the authors have it."""

    detector: NetworkConfig = field(default_factory=NetworkConfig)
    """The network."""
    pnp: PnpConfig = field(default_factory=PnpConfig)
    """From keypoints to a pose."""
    first_pose: FirstPose | None = None
    """What first poses come from: keypoints (the paper) or hypotheses (crops around the boxes).
    Default: hypotheses if crop weights lie beside the assembly (crops.safetensors) or are named,
    else keypoints."""
    crops: CropPoseConfig = field(default_factory=CropPoseConfig)
    """First poses from crops,"""
    first_depth: bool = True
    """in which measured depth has a say, or colour alone;"""
    names: NamesConfig = field(default_factory=NamesConfig)
    """what their network makes of boxes, where it was taught names;"""
    second_look: SecondLookConfig = LOOKS_AGAIN
    """and where the detector looks again for parts that it missed."""
    refinement: AnyRefinement = "none"
    """What depth does to first poses: none (the baseline), translation, icp or segmentation (rows
    of Table 2)."""
    translation: TranslationConfig = field(default_factory=TranslationConfig)
    """Refinement "translation", section 3.1.1; "segmentation" is the same inside masks."""
    masks: Path | None = None
    """Refinement "segmentation": trained mask branch of the detector. Default: masks.safetensors
    beside the detector's weights."""
    icp: IcpConfig = PAPER_ICP
    """Refinement "icp"."""
    state_looks: StateLooksFrom | None = None
    """What tells the state by its looks: boxes (the paper: states as classes of the detector),
    crops (the crop network, looking about the base part) or places (the state network, looking where
    the base part's pose puts each joined part). Default, where first poses come from crops: places if
    there is such a network, else crops unless the detector is the assembly's own."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """From state boxes to probabilities."""
    published: bool = False
    """The paper's steps to the letter and none of ours; what it leaves open stays as configured."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is not as published."""
        if self.published:
            publish(self, STEPS)


class Yolov8Pose:
    """Detect, PnP, depth where it is asked for, and the state of the highest-scoring state box."""

    def __init__(
        self,
        config: Yolov8PoseConfig,
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
        self._crop_poses: CropPoses | None = None
        self._looks: StateLooks | None = None
        self._finder: PartFinder | None = None
        self._assembly: Assembly | None = None
        self._shapes: dict[str, PartShape] = {}

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the networks for this assembly.

        Raises:
            WeightsError: there are no weights for it.
        """
        config = self._config
        masks: Path | None = None
        if config.refinement == "segmentation":
            masks = masks_path(config.masks, config.detector, assembly)
        detector = self._given_detector or load_detector(config.detector, assembly, masks=masks)
        first = crop_poses(
            config.first_pose,
            config.crops,
            assembly,
            looker=self._given_looker,
            sunk=SunkConfig() if config.first_depth else None,
        )
        self._crop_poses = first
        self._shapes = part_shapes(assembly, surface_points=config.translation.surface_points)
        self._finder = PartFinder(
            assembly,
            detector,
            self._shapes,
            looker=first and first.looker,
            names=_BY_SCORE if first is None else config.names,
            second_look=config.second_look.chosen(crops=first is not None),
            by_size=first is not None,
            by_class=config.published,
        )
        self._looks = StateLooks.of(
            assembly,
            config=config.appearance,
            chosen=config.state_looks,
            detector=config.detector,
            crops=config.crops,
            crop_poses=self._crop_poses,
        )
        self._assembly = assembly

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of one frame; those before matter only for which box is which part."""
        if self._finder is None or self._assembly is None or self._looks is None:
            raise MethodError("yolov8pose: reset() must come before step()")
        config, assembly, timed = self._config, self._assembly, StageTimer()
        with timed("detect"):
            detections, found = self._finder.find(frame)
            self._finder.keep(found, frame)
        with timed("pnp" if self._crop_poses is None else "crops"):
            if self._crop_poses is None:
                poses = poses_from_keypoints(found, frame, assembly, config=config.pnp)
            else:
                poses = self._crop_poses.poses(found, frame, use_depth=config.first_depth)
        if config.refinement != "none":
            with timed("refine"):
                poses = poses_refined_by_depth(
                    poses,
                    found,
                    self._shapes,
                    frame,
                    refinement=config.refinement,
                    translation=config.translation,
                    icp=config.icp,
                )
        with timed("state"):
            looks = self._looks.probabilities(detections, poses, frame)
            state = None if looks is None else StateEstimate(looks, {"appearance": looks})
        return FramePrediction(frame.index, poses, state, detections, timed.seconds)


SPEC = MethodSpec(
    name="yolov8pose",
    summary="YOLOv8-pose, first poses by RANSAC PnP, state by its box (the paper's baseline)",
    config=Yolov8PoseConfig,
    factory="asdfviz.methods.yolov8pose:Yolov8Pose",
)
