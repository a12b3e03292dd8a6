"""The pinhole camera in OpenCV's axes: x right, y down, z forward; an integer pixel is a centre."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64

from asdfviz.geometry.shapes import Depth, Intrinsics, Pixels, Points

SAME_PX = 0.1
"""Intrinsics that differ by less show the same, as far as anybody measures."""


def is_same_lens(K: Intrinsics, other: Intrinsics) -> bool:
    """Whether two pictures have the same intrinsics, to a tenth of a pixel."""
    return bool(np.abs(K - other).max() < SAME_PX)


def project(points_camera: Points, K: Intrinsics) -> Pixels:
    """Project points in front of the camera; points at or behind it become NaN."""
    z = points_camera[:, 2]
    safe = np.where(z > 1e-9, z, np.nan)
    u = K[0, 0] * points_camera[:, 0] / safe + K[0, 1] * points_camera[:, 1] / safe + K[0, 2]
    v = K[1, 1] * points_camera[:, 1] / safe + K[1, 2]
    return np.stack([u, v], axis=1)


def back_project(pixels: Pixels, depths: np.ndarray, K: Intrinsics) -> Points:
    """Return the points (metres) that lie at planar depth `depths` (n,) behind `pixels`."""
    y = (pixels[:, 1] - K[1, 2]) / K[1, 1]
    x = (pixels[:, 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
    return np.stack([x, y, np.ones_like(x)], axis=1) * np.asarray(depths, float)[:, None]


def points_from_depth(depth: Depth, K: Intrinsics, *, stride: int = 1) -> tuple[Points, Pixels]:
    """Return the measured points (metres, camera frame) and their pixels; holes are left out."""
    v, u = np.nonzero(depth[::stride, ::stride] > 0)
    pixels = np.stack([u, v], axis=1).astype(np.float64) * stride
    z = depth[v * stride, u * stride].astype(np.float64)
    return back_project(pixels, z, K), pixels


def nearest_pixels(
    points_camera: Points, K: Intrinsics, shape: tuple[int, ...]
) -> tuple[Bool[np.ndarray, "n"], Int64[np.ndarray, "inside"], Int64[np.ndarray, "inside"]]:
    """Which points are seen within an image of this shape (h, w), and rows and columns of those."""
    pixels = np.rint(project(points_camera, K))
    inside = np.all((pixels >= 0) & (pixels <= [shape[1] - 1, shape[0] - 1]), axis=1)
    columns, rows = pixels[inside].astype(np.int64).T
    return inside, rows, columns


def depth_gaps(
    points_camera: Points, depth: Depth, K: Intrinsics
) -> Float64[np.ndarray, "readings"]:
    """How far the readings at projected points lie behind these, metres; only where there is one.

    Args:
        points_camera: in front of the camera, metres.
        depth: planar depth in metres, 0 = none.
        K: intrinsics of the depth image.
    """
    inside, v, u = nearest_pixels(points_camera, K, depth.shape)
    measured = depth[v, u].astype(np.float64)
    return (measured - points_camera[inside, 2])[measured > 0]


def scaled_intrinsics(K: Intrinsics, scale_x: float, scale_y: float) -> Intrinsics:
    """Intrinsics of the same view resized by (scale_x, scale_y), pixel centres kept exact."""
    S = np.array([[scale_x, 0, (scale_x - 1) / 2], [0, scale_y, (scale_y - 1) / 2], [0, 0, 1.0]])
    return S @ K
