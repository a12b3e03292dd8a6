"""The pose stages that methods share: PnP for every part found, then depth for every pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.errors import WeightsError
from asdfviz.geometry.sampling import surface_points as sample_surface
from asdfviz.pose.box_fit import BoxFitConfig, fit_to_box, hull_corners
from asdfviz.pose.pnp import PnpConfig, solve_pnp
from asdfviz.pose.translation import TranslationConfig, refine_translation


@dataclass(frozen=True, slots=True, eq=False)
class PartShape:
    """Points that stand for a part's mesh, metres, in the part's frame."""

    surface: Float64[np.ndarray, "surface 3"]
    """Spread evenly over the surface."""
    corners: Float64[np.ndarray, "corners 3"]
    """Spanning the outline from every side."""


def part_shapes(assembly: Assembly, *, surface_points: int) -> dict[str, PartShape]:
    """Every part's shape, with so many points on its surface."""
    return {
        name: PartShape(
            sample_surface(part.mesh.vertices, part.mesh.faces, surface_points),
            hull_corners(part.mesh.vertices),
        )
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

    Raises:
        WeightsError: the network was trained with another number of keypoints.
    """
    poses: dict[str, PoseEstimate] = {}
    for name, detection in found.items():
        keypoints = assembly.parts[name].keypoints
        if len(detection.keypoints_px) != len(keypoints):
            raise WeightsError(
                f"the network gives {len(detection.keypoints_px)} keypoints, "
                f"part '{name}' of {assembly.name} has {len(keypoints)}"
            )
        solution = solve_pnp(
            keypoints,
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
    shapes: Mapping[str, PartShape],
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
                shapes[name].corners,
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
    shapes: Mapping[str, PartShape],
    frame: Frame,
    *,
    config: TranslationConfig,
) -> dict[str, PoseEstimate]:
    """Translation refinement of every pose; one that depth says nothing of keeps its stage."""
    refined = dict(poses)
    for name, pose in poses.items():
        T_camera_part = refine_translation(
            pose.T_camera_part,
            shapes[name].surface,
            box_xyxy=found[name].box_xyxy,
            depth=frame.depth,
            K=frame.camera.K,
            config=config,
        )
        if T_camera_part is not None:
            refined[name] = PoseEstimate(name, T_camera_part, pose.score, "refined")
    return refined
