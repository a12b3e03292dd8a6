"""YOLOv8-pose with segmentation: the paper's Table 2 row "+Seg"; the state as the baseline has it.

The masks are those of a branch beside the pose head (`asdfviz train-masks`): one pass of the network
gives boxes, keypoints and masks. The paper ran a segmentation network besides.
"""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.methods.part_poses import AnyRefinement
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.yolov8pose import Yolov8PoseConfig


@dataclass(frozen=True)
class AsdfSegConfig(Yolov8PoseConfig):
    """Options of the baseline, refined by the depth inside each part's mask."""

    refinement: AnyRefinement = "segmentation"
    """What depth does to first poses."""


SPEC = MethodSpec(
    name="asdf_seg",
    summary="YOLOv8-pose, then translation by the depth inside masks (the paper's +Seg row)",
    config=AsdfSegConfig,
    factory="asdfviz.methods.yolov8pose:Yolov8Pose",
)
