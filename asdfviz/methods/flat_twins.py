"""The other pose from which a flat part's keypoints look nearly the same, as a runner-up.

Not in the paper. PnP has two minima where a part is flat, and keypoints choose between them by
fractions of a pixel. Both are kept over time, and depth decides.
"""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Detection, Frame, Part, PoseEstimate
from asdfviz.geometry.boxes import diagonal
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply, apply_to_point, transform_from
from asdfviz.methods.kept_poses import Proposal
from asdfviz.pose.pnp import PnpConfig, flattest_plane, mirrored_twin, robust_scale
from asdfviz.pose.reprojection import minimize_reprojection

LEAST_LIKELY = 0.3
"""A twin of which keypoints are farther off than this allows is no second minimum."""


def flat_twin(
    own: PoseEstimate, part: Part, detection: Detection, frame: Frame, *, config: PnpConfig
) -> Proposal | None:
    """The mirrored twin of a pose from keypoints; None where they rule it out.

    It is as likely as keypoints are nearer to the pose than to its twin, 0 to 1.

    Args:
        own: the pose, its distance corrected already.
        part: whose.
        detection: whose keypoints gave it.
        frame: it was found in.
        config: how keypoints become a pose.
    """
    points, K = part.keypoints, frame.camera.K
    center, normal = flattest_plane(points)
    start = mirrored_twin(own.T_camera_part, center, normal)
    seen = np.isfinite(detection.keypoints_px).all(axis=1)
    twin = minimize_reprojection(
        [start],
        points[seen],
        detection.keypoints_px[seen],
        K,
        scale_px=robust_scale(config, diagonal(detection.box_xyxy)),
        scores=detection.keypoint_scores[seen],
    )
    if twin is None:
        return None
    # Depth has told how far the part is already.
    nearer = float(apply_to_point(own.T_camera_part, center)[2] / apply_to_point(twin, center)[2])
    T_twin = transform_from(twin[:3, :3], twin[:3, 3] * nearer)
    off, twin_off = (_off(T, part, detection, frame) for T in (own.T_camera_part, T_twin))
    likely = 1.0 if twin_off <= off else off / twin_off
    return Proposal(T_twin, likely) if likely >= LEAST_LIKELY else None


def _off(T_camera_part: Transform, part: Part, detection: Detection, frame: Frame) -> float:
    """How far keypoints are from where a pose has them, median, pixels."""
    px = project(apply(T_camera_part, part.keypoints), frame.camera.K)
    return float(np.nanmedian(np.linalg.norm(px - detection.keypoints_px, axis=1)))
