"""What stands out of the table in the depth image: boxes around it, whatever it is.

Not in the paper. Where a detector misses a part that lies about, depth still shows that something is
there.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points, Vector

TRIALS = 64
"""Planes that are tried."""
SAMPLES = 1500
"""Readings that judge them."""


@dataclass(frozen=True)
class BlobConfig:
    """What counts as standing out."""

    plane_margin: float = 0.006
    """Readings this near to a plane lie on it, metres."""
    plane_share: float = 0.25
    """Share of all readings that the table has at least, 0 to 1."""
    rise: float = 0.004
    """What is less above the table belongs to it, metres."""
    most: float = 0.2
    """What is more above it is no part that lies about, metres."""
    min_px: int = 40
    """Smaller ones are noise, pixels."""


def standing_out(depth: Depth, K: Intrinsics, *, config: BlobConfig) -> list[Box]:
    """Boxes (x0, y0, x1, y1 in pixels) around what stands out of the largest plane.

    Args:
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
        config: what counts.

    Returns:
        The largest first; none where no plane is large enough.
    """
    plane = _largest_plane(depth, K, config)
    if plane is None:
        return []
    # Above the plane by: (n . p + d) with p = depth * ray, n towards the camera.
    height, width = depth.shape
    v, u = np.mgrid[:height, :width]
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    slope: Float64[np.ndarray, "h w"] = plane[0] * x + plane[1] * y + plane[2]
    above = np.where(depth > 0, depth * slope + plane[3], 0.0).astype(np.float32)
    return _boxes(cv2.medianBlur(above, 3), config)


def _boxes(above: Float32[np.ndarray, "h w"], config: BlobConfig) -> list[Box]:
    out = ((above > config.rise) & (above < config.most)).astype(np.uint8)
    out = cv2.morphologyEx(out, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, _, found, _ = cv2.connectedComponentsWithStats(out, connectivity=8)
    height, width = above.shape
    rows = [
        row
        for row in found[1:]
        if row[cv2.CC_STAT_AREA] >= config.min_px
        and row[cv2.CC_STAT_WIDTH] < width / 2
        and row[cv2.CC_STAT_HEIGHT] < height / 2
    ]
    rows.sort(key=lambda row: -int(row[cv2.CC_STAT_AREA]))
    return [
        np.array([x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5], np.float64) for x, y, w, h, _ in rows
    ]


def _largest_plane(
    depth: Depth, K: Intrinsics, config: BlobConfig
) -> Float64[np.ndarray, "4"] | None:
    """Unit normal towards the camera and offset, so that n . p + d is the height above the plane."""
    rows, columns = np.nonzero(depth > 0)
    if len(rows) < 3 * SAMPLES:
        return None
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(rows), SAMPLES, replace=False)
    z = depth[rows[chosen], columns[chosen]].astype(np.float64)
    points = np.stack(
        [
            (columns[chosen] - K[0, 2]) / K[0, 0] * z,
            (rows[chosen] - K[1, 2]) / K[1, 1] * z,
            z,
        ],
        axis=1,
    )
    corners = points[rng.integers(0, SAMPLES, (TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(lengths, 1e-12)
    heights = normals @ points.T - (normals * corners[:, 0]).sum(axis=1, keepdims=True)
    on = np.abs(heights) < config.plane_margin
    best = int((on.sum(axis=1) * (lengths[:, 0] > 1e-9)).argmax())
    near = on[best]
    if near.mean() < config.plane_share:
        return None
    return _fitted(points, near, config)


def _fitted(points: Points, near: np.ndarray, config: BlobConfig) -> Float64[np.ndarray, "4"]:
    """Least squares through the readings on the plane, twice."""
    normal: Vector = np.zeros(3)
    middle: Vector = np.zeros(3)
    for _ in range(2):
        middle = points[near].mean(axis=0)
        normal = np.linalg.svd(points[near] - middle, full_matrices=False)[2][2]
        near = np.abs((points - middle) @ normal) < config.plane_margin
    normal = -normal if normal[2] > 0 else normal
    return np.append(normal, -normal @ middle)
