"""The pose stages that methods share: PnP for every part found, then depth for every pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.errors import WeightsError
from asdfviz.geometry.sampling import hull_corners, oriented_surface_points
from asdfviz.geometry.shapes import Box, Transform
from asdfviz.geometry.threads import side_by_side
from asdfviz.pose.box_fit import BoxFitConfig, fit_to_box
from asdfviz.pose.depth_fit import DepthFit, depth_fit
from asdfviz.pose.icp import IcpConfig, ModelCloud, register
from asdfviz.pose.pnp import PnpConfig, solve_pnp
from asdfviz.pose.segmentation import refine_in_mask
from asdfviz.pose.translation import TranslationConfig, refine_translation

Refinement: TypeAlias = Literal["none", "translation", "icp"]
"""What depth does to a first pose: nothing, section 3.1.1 of the paper, or the ICP of its Table 2."""
AnyRefinement: TypeAlias = Literal["none", "translation", "icp", "segmentation"]
"""The same, and translation by the depth inside masks ("+Seg" of Table 2), which needs a detector
that gives them."""
Rests: TypeAlias = Callable[[str, Box, Frame], Transform | None]
"""Of a part that was detected in a box, T_camera_part where it still lies as it lay; else None."""
PAPER_ICP = IcpConfig(reach=0.05, largest_move=0.2)
"""The paper's ICP row; wide, because nothing has corrected the distances before it."""


@dataclass(frozen=True, slots=True, eq=False)
class PartShape:
    """Points that stand for a part's mesh, metres, in the part's frame."""

    surface: Float64[np.ndarray, "surface 3"]
    """Spread evenly over the surface."""
    normals: Float64[np.ndarray, "surface 3"]
    """Outward unit normals there."""
    cloud: ModelCloud
    """The same points, for registration."""
    corners: Float64[np.ndarray, "corners 3"]
    """Spanning the outline from every side."""


def part_shapes(assembly: Assembly, *, surface_points: int) -> dict[str, PartShape]:
    """Every part's shape, with so many points on its surface."""
    shapes: dict[str, PartShape] = {}
    for name, part in assembly.parts.items():
        mesh = part.mesh
        points, normals = oriented_surface_points(mesh.vertices, mesh.faces, surface_points)
        corners = hull_corners(mesh.vertices)
        shapes[name] = PartShape(points, normals, ModelCloud(points), corners)
    return shapes


def shape_fit(
    T_camera_part: Transform, shape: PartShape, frame: Frame, *, margin: float
) -> DepthFit | None:
    """How a pose of a part agrees with a frame's depth, as `depth_fit` says it.

    Args:
        T_camera_part: the pose.
        shape: of the part; every third of its points is read.
        frame: with or without depth.
        margin: readings this near to the surface agree with it, metres.
    """
    return depth_fit(
        T_camera_part,
        shape.surface[::3],
        shape.normals[::3],
        depth=frame.depth,
        K=frame.camera.K,
        margin=margin,
    )


def poses_at_rest(
    found: Mapping[str, Detection], frame: Frame, rests: Rests
) -> dict[str, PoseEstimate]:
    """The poses of parts that lie where they lay, as sure as their boxes."""
    asked = {name: rests(name, d.box_xyxy, frame) for name, d in found.items()}
    return {
        name: PoseEstimate(name, T, found[name].score, "refined")
        for name, T in asked.items()
        if T is not None
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

    def solved(name: str) -> PoseEstimate | None:
        keypoints, detection = assembly.parts[name].keypoints, found[name]
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
        if solution is None:
            return None
        score = detection.score * solution.inliers / len(detection.keypoints_px)
        return PoseEstimate(name, solution.T_camera_part, score, "pnp")

    return {pose.part: pose for pose in side_by_side(solved, found) if pose is not None}


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
    refinement: AnyRefinement,
    translation: TranslationConfig,
    icp: IcpConfig,
) -> dict[str, PoseEstimate]:
    """Refine every pose by depth; one that depth says nothing of keeps its stage.

    Args:
        poses: first poses.
        found: the boxes that they come from.
        shapes: of the parts.
        frame: with depth, or nothing is refined.
        refinement: which of the three, or none.
        translation: options of section 3.1.1, in boxes and in masks.
        icp: options of the registration.
    """
    refined = dict(poses)
    if refinement == "none" or frame.depth is None:
        return refined
    for name, pose in poses.items():
        box, T_camera_part = found[name].box_xyxy, None
        if refinement == "icp":
            fitted = register(
                pose.T_camera_part,
                shapes[name].cloud,
                box_xyxy=box,
                depth=frame.depth,
                K=frame.camera.K,
                config=icp,
            )
            T_camera_part = None if fitted is None else fitted.T_camera_part
        elif refinement == "segmentation":
            T_camera_part = refine_in_mask(
                pose.T_camera_part,
                shapes[name].surface,
                mask=found[name].mask,
                box_xyxy=box,
                depth=frame.depth,
                K=frame.camera.K,
                config=translation,
            )
        else:
            T_camera_part = refine_translation(
                pose.T_camera_part,
                shapes[name].surface,
                box_xyxy=box,
                depth=frame.depth,
                K=frame.camera.K,
                config=translation,
            )
        if T_camera_part is not None:
            refined[name] = PoseEstimate(name, T_camera_part, pose.score, "refined")
    return refined


def sure_enough(poses: Mapping[str, PoseEstimate], least: float) -> dict[str, PoseEstimate]:
    """The poses that score this or more, and those that a state places, which is sure itself.

    Others are as good as not found.
    """
    return {n: pose for n, pose in poses.items() if pose.score >= least or pose.stage == "group"}
