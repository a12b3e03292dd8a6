"""Registration of a part's mesh with the depth inside its box, in six degrees of freedom.

Two directions. The paper's ICP row matches the model to the scan: every model point, hidden ones
too, is drawn to the nearest measured one, which turns the part. The other way round every measured
point is drawn to the model's surface; nothing hidden takes part, and what lies too far off (the
table, a hand) is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
import small_gicp

from asdfviz.geometry.camera import back_project
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points, Transform
from asdfviz.geometry.transforms import apply, inverse, is_rigid

_GICP = cast(Any, small_gicp)


@dataclass(frozen=True)
class IcpConfig:
    """How mesh and scan are matched; the paper gives no figures for its ICP."""

    direction: Literal["model_to_scan", "scan_to_model"] = "model_to_scan"
    """Paper: model to scan. The other direction is more accurate."""
    reach: float = 0.02
    """Points farther apart than this do not belong together, metres."""
    iterations: int = 30
    """At most."""
    points: int = 1500
    """Measured points that take part, at most."""
    least_points: int = 60
    """With fewer measured points near the part nothing is tried."""
    least_share: float = 0.3
    """Share of the points that must find a partner; otherwise the result is not taken."""
    largest_move: float = 0.06
    """The part's middle moves no farther than this, metres; otherwise the result is not taken."""


@dataclass(frozen=True, slots=True, eq=False)
class IcpResult:
    """A registered pose and how well it fits."""

    T_camera_part: Transform
    share: float
    """Of the moved points that have a partner within reach, 0 to 1."""
    residual: float
    """Root mean square distance of these to their partners' planes, metres."""


class ModelCloud:
    """A part's surface, prepared once for registration.

    Args:
        surface_part: points spread evenly over the surface, metres, part frame.
    """

    def __init__(self, surface_part: Points) -> None:
        self.points = surface_part
        self.radius = float(np.linalg.norm(surface_part - surface_part.mean(0), axis=1).max())
        self.cloud: Any = _GICP.PointCloud(surface_part)
        self.tree: Any = _GICP.KdTree(self.cloud)
        _GICP.estimate_normals(self.cloud, self.tree, num_neighbors=12)


def register(
    T_camera_part: Transform,
    model: ModelCloud,
    *,
    box_xyxy: Box,
    depth: Depth,
    K: Intrinsics,
    config: IcpConfig,
) -> IcpResult | None:
    """Refine a pose by the depth inside a box.

    Args:
        T_camera_part: start, metres.
        model: of the part.
        box_xyxy: where the part was detected, pixels.
        depth: metres, 0 where nothing was measured.
        K: of the camera.
        config: direction and limits.

    Returns:
        The refined pose; None where too little is measured or the result breaks a limit.
    """
    scan = scan_points(T_camera_part, model, box_xyxy=box_xyxy, depth=depth, K=K, config=config)
    if scan is None:
        return None
    found, T, total = _aligned(T_camera_part, model, scan, config)
    share = float(found.num_inliers) / total
    if not is_rigid(T) or share < config.least_share:
        return None
    middle = model.points.mean(axis=0)[None]
    if np.linalg.norm(apply(T, middle) - apply(T_camera_part, middle)) > config.largest_move:
        return None
    residual = float(np.sqrt(2 * float(found.error) / max(int(found.num_inliers), 1)))
    return IcpResult(T, share, residual)


def _aligned(
    T_camera_part: Transform, model: ModelCloud, scan: Points, config: IcpConfig
) -> tuple[Any, Transform, int]:
    """Return small_gicp's result, the pose that it means, and how many points were moved."""
    settings = {
        "registration_type": "PLANE_ICP",
        "max_correspondence_distance": config.reach,
        # One thread: more of them wait for each other longer than they work.
        "num_threads": 1,
        "max_iterations": config.iterations,
    }
    measured: Any = _GICP.PointCloud(scan)
    if config.direction == "scan_to_model":
        start = inverse(T_camera_part)
        found = _GICP.align(model.cloud, measured, model.tree, start, **settings)
        return found, inverse(np.asarray(found.T_target_source, np.float64)), len(scan)
    tree: Any = _GICP.KdTree(measured)
    _GICP.estimate_normals(measured, tree, num_neighbors=12)
    found = _GICP.align(measured, model.cloud, tree, T_camera_part, **settings)
    return found, np.asarray(found.T_target_source, np.float64), len(model.points)


def scan_points(
    T_camera_part: Transform,
    model: ModelCloud,
    *,
    box_xyxy: Box,
    depth: Depth,
    K: Intrinsics,
    config: IcpConfig,
) -> Points | None:
    """Return the measured points inside the box and near the part, camera frame; None if too few."""
    height, width = depth.shape
    x0, y0 = np.clip(np.floor(box_xyxy[:2]).astype(int), 0, [width, height])
    x1, y1 = np.clip(np.ceil(box_xyxy[2:]).astype(int) + 1, 0, [width, height])
    v, u = np.nonzero(depth[y0:y1, x0:x1] > 0)
    if len(u) < config.least_points:
        return None
    step = max(1, len(u) // (4 * config.points))
    pixels = np.stack([u[::step] + x0, v[::step] + y0], axis=1).astype(np.float64)
    z = depth[pixels[:, 1].astype(int), pixels[:, 0].astype(int)].astype(np.float64)
    points = back_project(pixels, z, K)
    middle = apply(T_camera_part, model.points.mean(axis=0)[None])
    near = points[np.linalg.norm(points - middle, axis=1) < model.radius + config.reach]
    if len(near) < config.least_points:
        return None
    return near[:: max(1, len(near) // config.points)]
