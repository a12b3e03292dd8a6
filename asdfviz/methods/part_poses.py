"""The pose stages that methods share: PnP for every part found, then depth for every pose."""

from __future__ import annotations

from collections.abc import Mapping

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Points
from asdfviz.pose.box_fit import BoxFitConfig, fit_to_box
from asdfviz.pose.pnp import PnpConfig, solve_pnp
from asdfviz.pose.translation import TranslationConfig, refine_translation


def part_surfaces(assembly: Assembly, *, count: int) -> dict[str, Points]:
    """Points spread evenly over every part's surface, metres, in its frame."""
    return {
        name: surface_points(part.mesh.vertices, part.mesh.faces, count)
        for name, part in assembly.parts.items()
    }


def poses_from_keypoints(
    found: Mapping[str, Detection],
    frame: Frame,
    assembly: Assembly,
    *,
    config: PnpConfig,
) -> dict[str, PoseEstimate]:
    """PnP for every detected part; one whose keypoints allow no pose is absent.

    A pose's score is that of its box times the share of keypoints that agree with it.
    """
    poses: dict[str, PoseEstimate] = {}
    for name, detection in found.items():
        solution = solve_pnp(
            assembly.parts[name].keypoints,
            detection.keypoints_px,
            frame.camera.K,
            config=config,
            scores=detection.keypoint_scores,
            box_xyxy=detection.box_xyxy,
            image_width=frame.camera.width,
        )
        if solution is not None:
            score = detection.score * solution.inliers / len(detection.keypoints_px)
            poses[name] = PoseEstimate(name, solution.T_camera_part, score, "pnp")
    return poses


def poses_fitted_to_boxes(
    poses: Mapping[str, PoseEstimate],
    found: Mapping[str, Detection],
    surfaces: Mapping[str, Points],
    frame: Frame,
    *,
    config: BoxFitConfig,
) -> dict[str, PoseEstimate]:
    """Correct distances that the detected boxes contradict; the stage stays "pnp"."""
    return {
        name: PoseEstimate(
            name,
            fit_to_box(
                pose.T_camera_part,
                surfaces[name],
                box_xyxy=found[name].box_xyxy,
                K=frame.camera.K,
                size_wh=(frame.camera.width, frame.camera.height),
                config=config,
            ),
            pose.score,
            pose.stage,
        )
        for name, pose in poses.items()
    }


def poses_refined_by_depth(
    poses: Mapping[str, PoseEstimate],
    found: Mapping[str, Detection],
    surfaces: Mapping[str, Points],
    frame: Frame,
    *,
    config: TranslationConfig,
) -> dict[str, PoseEstimate]:
    """Translation refinement of every pose; one that depth says nothing of keeps its stage."""
    refined = dict(poses)
    for name, pose in poses.items():
        T_camera_part = refine_translation(
            pose.T_camera_part,
            surfaces[name],
            box_xyxy=found[name].box_xyxy,
            depth=frame.depth,
            K=frame.camera.K,
            config=config,
        )
        if T_camera_part is not None:
            refined[name] = PoseEstimate(name, T_camera_part, pose.score, "refined")
    return refined
