"""Second thoughts: where depth rules out the pose of a part's best box, its next boxes are tried.

A distractor that looks like a part may well have the best box; the depth image then says that no
part of that size is there. What no box explains stays absent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.methods.assignment import rival_boxes
from asdfviz.methods.part_poses import PartShape
from asdfviz.pose.depth_check import DepthCheckConfig, ruled_out

Solve: TypeAlias = Callable[[Mapping[str, Detection]], dict[str, PoseEstimate]]
"""From boxes to refined poses, as the method does it."""


@dataclass(frozen=True)
class RivalsConfig:
    """How far a method looks beyond the best box of a part."""

    count: int = 3
    """Further boxes of the class that are tried; 0 switches it off."""
    depth_check: DepthCheckConfig = field(default_factory=DepthCheckConfig)
    """When depth rules a pose out."""


def settled_poses(
    poses: Mapping[str, PoseEstimate],
    found: Mapping[str, Detection],
    detections: Sequence[Detection],
    frame: Frame,
    *,
    assembly: Assembly,
    shapes: Mapping[str, PartShape],
    solve: Solve,
    config: RivalsConfig,
) -> tuple[dict[str, PoseEstimate], dict[str, Detection]]:
    """Replace or drop the poses that depth rules out; return them with the boxes that they rest on.

    Parts that share a class keep their boxes: there, the next box belongs to another part.
    """
    shared = Counter(part.detector_class for part in assembly.parts.values())
    kept, boxes = dict(poses), dict(found)
    for name, detection in found.items():

        def is_allowed(pose: PoseEstimate | None, name: str = name) -> bool:
            return pose is not None and (
                pose.stage == "refined"
                or not ruled_out(
                    pose.T_camera_part,
                    shapes[name].surface,
                    depth=frame.depth,
                    K=frame.camera.K,
                    config=config.depth_check,
                )
            )

        if is_allowed(poses.get(name)):
            continue
        kept.pop(name, None)
        count = config.count if shared[detection.label] == 1 else 0
        for rival in rival_boxes(detections, detection, count=count):
            pose = solve({name: rival}).get(name)
            if pose is not None and is_allowed(pose):
                kept[name], boxes[name] = pose, rival
                break
    return kept, boxes
