"""Robust, weighted Levenberg-Marquardt on the reprojection error, from several starts.

OpenCV's refinement knows neither weights nor robust losses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asdfviz.geometry.shapes import Intrinsics, Pixels, Points, Scores, Transform
from asdfviz.geometry.transforms import orthonormalized
from asdfviz.pose.reprojection_kernels import lowered, reprojection_cost

FIRST_STEPS = 3
"""After so many steps only the starts near the best can still win."""
FURTHER_STEPS = 7
HOPEFUL = 1.5
"""Near it is a cost of so many times the best one."""
DAMPING = 1e-3
"""Of the first step, by each diagonal element."""


def minimize_reprojection(
    starts: Sequence[Transform],
    keypoints_part: Points,
    keypoints_px: Pixels,
    K: Intrinsics,
    *,
    scale_px: float,
    scores: Scores | None = None,
) -> Transform | None:
    """Return the refined T_camera_part of lowest cost over all starts; None without a possible one.

    The cost is sum_i score_i * log(1 + (r_i / scale)^2), Cauchy's, with r_i in pixels.
    """
    weights = np.ones(len(keypoints_px)) if scores is None else np.clip(scores, 0.05, 1.0)
    data = tuple(
        np.ascontiguousarray(a, np.float64) for a in (keypoints_part, keypoints_px, K, weights)
    )
    seen = (*data, float(scale_px))
    tried: list[tuple[Transform, float, float]] = []
    for start in starts:
        T = np.ascontiguousarray(start, np.float64)
        cost = reprojection_cost(T, *seen)
        if np.isfinite(cost):
            tried.append(lowered(T, cost, DAMPING, FIRST_STEPS, *seen))
    if not tried:
        return None
    most = HOPEFUL * min(cost for _, cost, _ in tried)
    settled = [
        (T, cost) if damping < 0 else lowered(T, cost, damping, FURTHER_STEPS, *seen)[:2]
        for T, cost, damping in tried
        if cost <= most
    ]
    return orthonormalized(min(settled, key=lambda one: one[1])[0])
