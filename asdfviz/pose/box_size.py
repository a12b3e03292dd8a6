"""Which parts a box is too large for, at the distance that depth measures there.

To the network, which sees colour alone, a near pin and a far rod are alike. Not in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.boxes import box_middle, diagonal
from asdfviz.geometry.median import median, nearest_quantile
from asdfviz.geometry.rotation_grid import even_rotations, rotations_of
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points

TURNS = 300
"""Rotations in which a part's largest box is looked for."""
MARGIN = 1.25
"""Boxes may be larger than the part by this factor,"""
MARGIN_PX = 3.0
"""and this: those of small parts are drawn loosely, pixels of the diagonal."""
CORE = 1 / 6
"""Share of its width and height to either side of a box's middle in which depth is read."""
WHOLE = 1 / 2
"""The same with the whole box:"""
READ = 400
"""of about so many of its readings"""
NEARER = 0.25
"""this share may be nearer than what the box is about."""
AROUND = 0.75
"""The same with what is around the box."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxSizes:
    """The largest boxes of some parts."""

    largest: Mapping[str, float]
    """Diagonal of the box around a part in the rotation where it is largest, metres."""

    @classmethod
    def of(cls, corners: Mapping[str, Points]) -> BoxSizes:
        """Measure parts, given by points that span their outlines (`hull_corners`), metres."""
        turns = rotations_of(even_rotations(TURNS))
        return cls({name: _largest(points, turns) for name, points in corners.items()})

    def fitting(self, box_xyxy: Box, *, depth: Depth | None, K: Intrinsics) -> frozenset[str]:
        """The parts that a box is small enough for.

        Args:
            box_xyxy: in pixels.
            depth: planar depth in metres, 0 = none, or None: then every box is small enough.
            K: intrinsics of image and depth.
        """
        distance = None if depth is None else _nearest(box_xyxy, depth)
        if distance is None:
            return frozenset(self.largest)
        seen_px = diagonal(box_xyxy) - MARGIN_PX
        pixels = MARGIN / distance * float(K[0, 0])
        return frozenset(n for n, size in self.largest.items() if seen_px <= size * pixels)


def _largest(points: Points, turns: np.ndarray) -> float:
    flat = (points @ turns.transpose(0, 2, 1))[..., :2]
    return float(np.linalg.norm(np.ptp(flat, axis=1), axis=1).max())


def box_distance(box_xyxy: Box, depth: Depth) -> float | None:
    """Median of what was measured about the middle of a box, metres; None where nothing was."""
    window = window_about(box_xyxy, depth, CORE)
    measured = window[window > 0]
    return median(measured) if len(measured) else None


def _nearest(box_xyxy: Box, depth: Depth) -> float | None:
    """How near what is in a box may be, metres; None where nothing was measured.

    About the middle of a ring or a bow shows what lies behind it.
    """
    middle = box_distance(box_xyxy, depth)
    if middle is None:
        return None
    window = window_about(box_xyxy, depth, WHOLE)
    thin = max(int(np.sqrt(window.size / READ)), 1)
    readings = window[::thin, ::thin]
    readings = readings[readings > 0]
    if not len(readings):
        return middle
    return min(middle, nearest_quantile(readings, NEARER))


def measured_share(box_xyxy: Box, depth: Depth) -> float:
    """How much of a box and of what is around it depth measured, 0 to 1; 0 out of the picture.

    The table around a part that throws no light back is measured.
    """
    window = window_about(box_xyxy, depth, AROUND)
    return float(np.count_nonzero(window)) / max(window.size, 1)


def window_about(
    box_xyxy: Box, depth: Float32[np.ndarray, "h w"], share: float
) -> Float32[np.ndarray, "rows columns"]:
    """The depth, or what else is known of every pixel, about a box's middle, so much of its width and height
    to either side; empty out of the picture."""
    middle = box_middle(box_xyxy)
    reach = np.maximum((box_xyxy[2:] - box_xyxy[:2]) * share, 1.0)
    low = np.maximum(np.floor(middle - reach).astype(int), 0)
    high = np.ceil(middle + reach).astype(int) + 1
    return depth[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
