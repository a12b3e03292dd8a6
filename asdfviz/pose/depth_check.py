"""Tells poses that the depth image rules out: parts that one would see through, or not see at all.

A pose that PnP made of the wrong box (a distractor, half a part) lies where nothing was measured.
Not in the paper. After the translation refinement, for poses that it could not settle.
"""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.geometry.camera import depth_gaps
from asdfviz.geometry.shapes import Depth, Intrinsics, Points, Transform
from asdfviz.geometry.transforms import apply


@dataclass(frozen=True)
class DepthCheckConfig:
    """When depth rules a pose out."""

    enabled: bool = True
    """Paper: no such step. Here: on, because a wrong box costs a metre and the state with it."""
    see_through: float = 0.05
    """Readings this much farther than the part mean that it is not there, metres."""
    hidden: float = 0.2
    """Readings this much nearer mean that something else stands in front, metres."""
    share: float = 0.8
    """Share of the readings that must agree on that, 0 to 1."""
    min_points: int = 12
    """Fewer readings than this say nothing."""


def ruled_out(
    T_camera_part: Transform,
    points_part: Points,
    *,
    depth: Depth | None,
    K: Intrinsics,
    config: DepthCheckConfig,
) -> bool:
    """Whether nearly all readings where the part should be lie far behind it, or far in front.

    Args:
        T_camera_part: the pose in question.
        points_part: points on the part's surface, metres.
        depth: planar depth in metres, 0 = none, or None: then nothing is ruled out.
        K: intrinsics of image and depth.
        config: margins.
    """
    if not config.enabled or depth is None:
        return False
    points_camera = apply(T_camera_part, points_part)
    points_camera = points_camera[points_camera[:, 2] > 1e-6]
    gap = depth_gaps(points_camera, depth, K)
    if len(gap) < config.min_points:
        return False
    # The far side of the part is hidden by the near one: only its front must not be seen through.
    behind = float((gap > config.see_through).mean())
    before = float((gap < -config.hidden).mean())
    return max(behind, before) >= config.share
