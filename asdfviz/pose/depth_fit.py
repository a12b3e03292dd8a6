"""How well a pose agrees with the depth image: read at the points of the part that face the camera.

Not in the paper. Used to choose between several poses of a part, and for how far one is trusted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asdfviz.geometry.shapes import Depth, Intrinsics, Points, Transform
from asdfviz.pose.depth_kernels import front_readings

HIDDEN_WEIGHT = 0.3
"""A point behind something nearer counts this much: a hand may hide it, or the pose may be wrong."""
LEAST_READINGS = 12
"""Fewer say nothing."""
LEAST_SHOWN = 0.05
"""Less of a surface says nothing."""
UNKNOWN = 0.5
"""Agreement with depth where that says nothing."""


class DepthFit(NamedTuple):
    """What depth says of a pose."""

    share: float
    """Of the readings, those on the surface; hidden points count less. 0 to 1."""
    visible: float
    """Share of the readings that nothing nearer hides, 0 to 1."""
    agreeing: float
    """Of those that nothing nearer hides, the share on the surface; the others see through it."""


def depth_fit(
    T_camera_part: Transform,
    points_part: Points,
    normals_part: Points,
    *,
    depth: Depth | None,
    K: Intrinsics,
    margin: float,
) -> DepthFit | None:
    """Compare the part's front with the readings there; None where there are too few.

    Args:
        T_camera_part: the pose in question.
        points_part: points on the part's surface, metres.
        normals_part: outward unit normals at these points.
        depth: planar depth in metres, 0 = none; None: no depth image.
        K: intrinsics of image and depth.
        margin: readings this near to the surface agree with it, metres.
    """
    if depth is None:
        return None
    count, on, hidden = front_readings(
        points_part, normals_part, np.ascontiguousarray(T_camera_part), K, depth, margin
    )
    if count < LEAST_READINGS:
        return None
    counted = count - hidden + HIDDEN_WEIGHT * hidden
    clear = count - hidden
    return DepthFit(on / counted, clear / count, on / max(clear, 1))


def share_of_all(found: DepthFit | None) -> float:
    """Agreement with depth, 0 to 1; a half where depth says nothing."""
    return UNKNOWN if found is None else found.share


def share_shown(found: DepthFit | None, hidden: float) -> float:
    """Agreement of what nothing hides, at most as if depth said nothing; 0 where more than `hidden` shows."""
    if found is None or found.visible >= hidden:
        return 0.0
    return UNKNOWN if found.visible < LEAST_SHOWN else min(found.agreeing, UNKNOWN)
