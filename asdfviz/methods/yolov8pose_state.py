"""YOLOv8-pose with Pose2State: what the fusion alone adds, poses as the baseline has them."""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.first_confidence import FirstConfidenceConfig
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.part_poses import Refinement
from asdfviz.methods.rivals import RivalsConfig
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.yolov8pose import LOOKS_AGAIN
from asdfviz.pose.box_fit import BoxFitConfig
from asdfviz.pose.depth_check import DepthCheckConfig
from asdfviz.pose.pnp import PnpConfig


@dataclass(frozen=True)
class Yolov8PoseStateConfig(AsdfConfig):
    """Options of `asdf` with first poses as the baseline has them, which depth does not refine."""

    pnp: PnpConfig = field(default_factory=PnpConfig)
    """From keypoints to a pose."""
    box_fit: BoxFitConfig = field(default_factory=lambda: BoxFitConfig(enabled=False))
    """Distances that the boxes contradict."""
    second_look: SecondLookConfig = LOOKS_AGAIN
    """Where the detector looks again for parts that it missed."""
    refinement: Refinement = "none"
    """What depth does to first poses."""
    rivals: RivalsConfig = field(
        default_factory=lambda: RivalsConfig(count=0, depth_check=DepthCheckConfig(enabled=False))
    )
    """Further boxes of a part whose best one depth rules out."""
    group: GroupConfig = field(default_factory=lambda: GroupConfig(enabled=False))
    """State helps pose."""
    first_confidence: FirstConfidenceConfig = field(
        default_factory=lambda: FirstConfidenceConfig(enabled=False)
    )
    """How sure a pose is: as the baseline says it."""
    least_score: float = 0.0
    """Poses from crops that score less are withheld: none, the baseline withholds none either."""


SPEC = MethodSpec(
    name="yolov8pose_state",
    summary="YOLOv8-pose and Pose2State: poses are not refined, the state is fused over time",
    config=Yolov8PoseStateConfig,
    factory="asdfviz.methods.asdf:Asdf",
)
