"""YOLOv8-pose with ICP: the paper's Table 2 row, model to scan; the state as the baseline has it."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.methods.part_poses import Refinement
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.yolov8pose import Yolov8PoseConfig


@dataclass(frozen=True)
class Yolov8PoseIcpConfig(Yolov8PoseConfig):
    """Options of the baseline, refined by registration."""

    refinement: Refinement = "icp"
    """What depth does to first poses."""


SPEC = MethodSpec(
    name="yolov8pose_icp",
    summary="YOLOv8-pose, then ICP from model to scan (the paper's ICP row)",
    config=Yolov8PoseIcpConfig,
    factory="asdfviz.methods.yolov8pose:Yolov8Pose",
)
