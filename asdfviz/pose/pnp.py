"""PnP: a part's pose from its 17 keypoints in one picture. First step after the detector.

Two solvers stand side by side. "ransac" is the authors' (RANSAC, 12 px, iterative refit).
"robust" starts from several consensus sets and from their mirrored twins (the second minimum that
flat parts have) and lets a robust, score-weighted Levenberg-Marquardt decide between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Box, Intrinsics, Pixels, Points, Scores, Transform, Vector
from asdfviz.geometry.transforms import apply, apply_to_point, transform_from

REFERENCE_WIDTH_PX = 1280
"""Image width at which the paper's threshold in pixels is meant."""


@dataclass(frozen=True)
class PnpConfig:
    """How keypoints become a pose, and when they do not."""

    solver: Literal["ransac", "robust"] = "ransac"
    """Paper: RANSAC with an iterative refit. "robust" adds restarts and a weighted robust refit."""
    reprojection_px: float = 12.0
    """Inlier threshold of RANSAC, pixels in an image 1280 wide (authors' pnp.py); scales with width."""
    reprojection_share: float = 0.0
    """If above 0, the threshold is this share of the box diagonal instead, because 12 px are a
    fifth of a part that is 60 px long."""
    smallest_px: float = 2.0
    """The threshold never falls below this, pixels."""
    cauchy_share: float = 0.03
    """Scale of the robust refit's Cauchy loss, share of the box diagonal ("robust" only)."""
    iterations: int = 100
    """RANSAC iterations (OpenCV's default, as the authors use)."""
    mirrored: bool = True
    """Whether methods that keep several poses of a part also keep the one that is mirrored at a flat
    part's plane, from which its keypoints look nearly the same."""
    min_inliers: int = 6
    """Fewer keypoints that agree mean: not found."""
    min_spread: float = 0.5
    """Keypoints whose extent is less than this share of the box have collapsed: not found."""
    nearest: float = 0.1
    """Smallest plausible distance along the optical axis, metres."""
    farthest: float = 5.0
    """Largest plausible distance along the optical axis, metres."""


ROBUST_PNP = PnpConfig(solver="robust", reprojection_share=0.1, min_spread=0.3)
"""What `asdf` uses.

Paper: 12 px and nothing else. Here: 10 % of the box, because keypoints of a lightly trained network
err by 2 to 10 % of it and the refit's 3 % scale brings the precision back; a spread of 0.3 is
enough, because the fit to the box repairs the distance of shrunken keypoints.
"""


@dataclass(frozen=True, slots=True, eq=False)
class PnpSolution:
    """A pose that enough keypoints agree on."""

    T_camera_part: Transform
    inliers: int
    """Keypoints within the threshold."""
    reprojection_px: float
    """Root mean square distance of those inliers, pixels."""


def solve_pnp(
    keypoints_part: Points,
    keypoints_px: Pixels,
    K: Intrinsics,
    *,
    config: PnpConfig,
    scores: Scores | None = None,
    box_xyxy: Box | None = None,
    image_width: int = REFERENCE_WIDTH_PX,
) -> PnpSolution | None:
    """Find the pose that brings the part's keypoints onto those seen.

    Args:
        keypoints_part: the part's keypoints, metres, in its frame.
        keypoints_px: where the network saw them.
        K: intrinsics of the undistorted image.
        config: thresholds and solver.
        scores: how much each keypoint counts in the robust refit, 0 to 1.
        box_xyxy: the detection's box; without it the keypoints' own extent stands for it.
        image_width: width of the image in pixels, to scale the paper's threshold.

    Returns:
        None where the keypoints have collapsed, too few agree, or the part would lie behind the
        camera or implausibly near or far.
    """
    seen = np.isfinite(keypoints_px).all(axis=1)
    keypoints_part, keypoints_px = keypoints_part[seen], keypoints_px[seen]
    if len(keypoints_px) < max(config.min_inliers, 4):
        return None
    diagonal = _diagonal(keypoints_px if box_xyxy is None else box_xyxy.reshape(2, 2))
    if diagonal <= 0 or _diagonal(keypoints_px) < config.min_spread * diagonal:
        return None
    threshold = _threshold(config, diagonal, image_width)
    if config.solver == "ransac":
        T_camera_part = _ransac(
            keypoints_part, keypoints_px, K, threshold, config.iterations, cv2.SOLVEPNP_ITERATIVE
        )
    else:
        # Compiled loops, which a machine that only trains does without.
        from asdfviz.pose.reprojection import minimize_reprojection

        starts = list(_starts(keypoints_part, keypoints_px, K, threshold, config))
        T_camera_part = minimize_reprojection(
            starts,
            keypoints_part,
            keypoints_px,
            K,
            scale_px=robust_scale(config, diagonal),
            scores=None if scores is None else scores[seen],
        )
    if T_camera_part is None:
        return None
    return _accepted(T_camera_part, keypoints_part, keypoints_px, K, threshold, config)


def _diagonal(pixels: Pixels) -> float:
    return float(np.linalg.norm(np.ptp(pixels, axis=0)))


def _threshold(config: PnpConfig, diagonal: float, image_width: int) -> float:
    if config.reprojection_share > 0:
        return max(config.reprojection_share * diagonal, config.smallest_px)
    return max(config.reprojection_px * image_width / REFERENCE_WIDTH_PX, config.smallest_px)


def robust_scale(config: PnpConfig, diagonal: float) -> float:
    """Of the refit's loss, pixels, for a box of that diagonal (pixels)."""
    return max(config.cauchy_share * diagonal, config.smallest_px / 2)


def _ransac(
    keypoints_part: Points,
    keypoints_px: Pixels,
    K: Intrinsics,
    threshold: float,
    iterations: int,
    solver: int,
) -> Transform | None:
    try:
        found, rvec, tvec, _ = cv2.solvePnPRansac(
            keypoints_part,
            keypoints_px,
            K,
            None,
            iterationsCount=iterations,
            reprojectionError=threshold,
            flags=solver,
        )
    except cv2.error:  # degenerate point sets make OpenCV's refit throw
        return None
    return _transform(rvec, tvec) if found else None


def _starts(
    keypoints_part: Points,
    keypoints_px: Pixels,
    K: Intrinsics,
    threshold: float,
    config: PnpConfig,
) -> Iterator[Transform]:
    """Consensus poses at two thresholds, the global least-squares pose, and each one's twin."""
    # Three-point samples: a tenth of the time of the iterative ones, and the refit follows anyway.
    candidates = [
        *(
            _ransac(keypoints_part, keypoints_px, K, px, config.iterations, cv2.SOLVEPNP_AP3P)
            for px in (threshold, 0.4 * threshold)
        ),
        _global_least_squares(keypoints_part, keypoints_px, K),
    ]
    center, normal = flattest_plane(keypoints_part)
    for T_camera_part in candidates:
        if T_camera_part is not None:
            yield T_camera_part
            yield mirrored_twin(T_camera_part, center, normal)


def flattest_plane(keypoints_part: Points) -> tuple[Vector, Vector]:
    """The middle of a part's keypoints and the normal of the plane to which they are nearest, part frame."""
    center = keypoints_part.mean(axis=0)
    return center, np.linalg.svd(keypoints_part - center, full_matrices=False)[2][2]


def mirrored_twin(
    T_camera_part: Transform, center_part: np.ndarray, normal_part: np.ndarray
) -> Transform:
    """Return the other pose from which a flat part looks nearly the same.

    Seen from far, a plane tilted towards the camera looks like one tilted away: mirror the part at
    its own plane, then the scene at the plane across the line of sight. Two mirrors are a rotation.
    """
    center = apply_to_point(T_camera_part, center_part)
    sight = center / np.linalg.norm(center)
    scene_mirror = np.eye(3) - 2 * np.outer(sight, sight)
    part_mirror = np.eye(3) - 2 * np.outer(normal_part, normal_part)
    R = scene_mirror @ T_camera_part[:3, :3] @ part_mirror
    return transform_from(R, center - R @ center_part)


def _global_least_squares(
    keypoints_part: Points, keypoints_px: Pixels, K: Intrinsics
) -> Transform | None:
    try:
        found, rvec, tvec = cv2.solvePnP(
            keypoints_part, keypoints_px, K, None, flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:
        return None
    return _transform(rvec, tvec) if found else None


def _transform(rvec: np.ndarray, tvec: np.ndarray) -> Transform | None:
    if not (np.isfinite(rvec).all() and np.isfinite(tvec).all()):
        return None
    R = np.asarray(cv2.Rodrigues(rvec)[0], dtype=np.float64)
    return transform_from(R, np.asarray(tvec, dtype=np.float64).reshape(3))


def _accepted(
    T_camera_part: Transform,
    keypoints_part: Points,
    keypoints_px: Pixels,
    K: Intrinsics,
    threshold: float,
    config: PnpConfig,
) -> PnpSolution | None:
    points_camera = apply(T_camera_part, keypoints_part)
    depth = float(points_camera[:, 2].mean())
    if points_camera[:, 2].min() <= 0 or not config.nearest <= depth <= config.farthest:
        return None
    error = np.linalg.norm(project(points_camera, K) - keypoints_px, axis=1)
    inlier = error <= threshold
    if inlier.sum() < config.min_inliers:
        return None
    return PnpSolution(
        T_camera_part,
        inliers=int(inlier.sum()),
        reprojection_px=float(np.sqrt((error[inlier] ** 2).mean())),
    )
