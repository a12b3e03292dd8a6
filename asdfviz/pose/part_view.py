"""What is seen of one part, and its surface: what `hypotheses` compares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points, Rotation, Vector
from asdfviz.pose.depth_kernels import readings_along
from asdfviz.pose.table import Table

Cells: TypeAlias = Float64[np.ndarray, "s s"]


@dataclass(frozen=True, slots=True, eq=False)
class PartView:
    """What is seen of one part along the ray through its box."""

    focal: float
    """Of the view, in cells; its principal point is the middle."""
    R_camera_view: Rotation
    """From the view's frame to the camera's; both have the same centre."""
    outline: Cells
    """Probability that a cell shows the part."""
    measured: Cells
    """Depth along the view's axis in each cell, metres, 0 = none."""
    box_xyxy: Box
    """Detected box in the view, cells."""
    table: Table | None = None
    """In the view's frame, where there is one."""

    @property
    def K(self) -> Intrinsics:
        """Its intrinsics, cells."""
        center = (self.outline.shape[0] - 1) / 2
        return np.array([[self.focal, 0, center], [0, self.focal, center], [0, 0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Points of a part's surface, metres, in its frame."""

    points: Points
    normals: Points
    corners: Float64[np.ndarray, "k 3"]
    """Spanning the outline from every side."""
    middle: Vector
    """Of the part: its origin may lie anywhere."""


def sampled_depth(
    depth: Depth, K: Intrinsics, R_camera_view: Rotation, *, focal: float, side: int
) -> Cells:
    """Measured depth along the axis of a view, at the centres of its cells; 0 = none.

    Args:
        depth: planar depth of the frame, metres, 0 = none.
        K: the frame's intrinsics.
        R_camera_view: the view's camera in the frame's.
        focal: of the view, cells.
        side: of the view, cells.
    """
    return readings_along(depth, np.asarray(K, np.float64), R_camera_view, focal, side)
