"""What of a picture is probably a part that was put somewhere by hand: no detector, no mask.

Its colours are those of the middle rather than those around its reach; nor is it where the table is.
For `asdfviz.methods.turned_fits`; not in the paper.
"""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int64

from asdfviz.datatypes import Frame
from asdfviz.geometry.shapes import Depth, Intrinsics, Rotation, Scores
from asdfviz.pose.part_view import Cells
from asdfviz.pose.table import TableConfig, largest_plane

Marks: TypeAlias = Bool[np.ndarray, "s s"]
Colors: TypeAlias = Int64[np.ndarray, "s s"]
"""A number a cell's colour, 16 shades a channel; -1 beside the picture."""
ON_TABLE = 0.003
"""Readings this near to the table are hardly the part's, metres:"""
TABLE_WEIGHT = 0.3
"""so much of what their colours say is left."""


def outline_at(
    frame: Frame,
    measured: Cells,
    R_camera_view: Rotation,
    *,
    focal: float,
    rim: float,
    core: float,
    between: tuple[float, float],
) -> Cells:
    """How probably each cell of a view along the ray through a part's middle shows the part.

    Args:
        frame: with depth.
        measured: depth along the view's axis, metres, 0 = none.
        R_camera_view: the view's camera in the frame's.
        focal: of the view, cells.
        rim: the part reaches so far from the middle, cells.
        core: so far the middle shows the part, cells.
        between: the part's depth, from and to, metres.
    """
    side, K = len(measured), np.asarray(frame.camera.K, np.float64)
    rays = _rays(R_camera_view, focal, side)
    colors, on_table = _cell_colors(frame, K, rays), _table_cells(frame.depth, K, rays, measured)
    v, u = np.mgrid[:side, :side] - (side - 1) / 2
    off, inside = np.hypot(u, v), colors >= 0
    never = (off > rim) | ~inside
    never |= (measured > 0) & ((measured < between[0]) | (measured > between[1]))
    of_part = _histogram(colors[(off <= core) & ~never])
    around = _histogram(colors[(never | on_table) & inside])
    probable = (of_part + 1e-5) / (of_part + around + 2e-5)
    shown = cv2.GaussianBlur(probable[np.maximum(colors, 0)], (0, 0), 0.8)
    shown[on_table] *= TABLE_WEIGHT
    return np.where(never, 0.0, shown)


def _rays(R_camera_view: Rotation, focal: float, side: int) -> Float64[np.ndarray, "s s 3"]:
    """Through every cell, camera axes."""
    v, u = (np.mgrid[:side, :side] - (side - 1) / 2) / focal
    return np.stack([u, v, np.ones_like(u)], axis=-1) @ R_camera_view.T


def _cell_colors(frame: Frame, K: Intrinsics, rays: Float64[np.ndarray, "s s 3"]) -> Colors:
    seen = rays @ K.T
    ahead = np.maximum(seen[..., 2], 1e-3)
    u, v = (np.rint(seen[..., k] / ahead).astype(np.int64) for k in (0, 1))
    height, width = frame.rgb.shape[:2]
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (seen[..., 2] > 1e-3)
    rgb = frame.rgb[np.where(inside, v, 0), np.where(inside, u, 0)].astype(np.int64) >> 4
    return np.where(inside, (rgb[..., 0] * 16 + rgb[..., 1]) * 16 + rgb[..., 2], -1)


def _table_cells(
    depth: Depth | None, K: Intrinsics, rays: Float64[np.ndarray, "s s 3"], measured: Cells
) -> Marks:
    """Cells in which the table is measured."""
    table = None if depth is None else largest_plane(depth, K, config=TableConfig())
    if table is None:
        return np.zeros(measured.shape, bool)
    heights = (rays * measured[..., None]) @ table.normal + table.offset
    return (measured > 0) & (np.abs(heights) < ON_TABLE)


def _histogram(colors: Int64[np.ndarray, "k"]) -> Scores:
    """How often each colour is there; neighbours share, as few cells show all shades."""
    counts = np.bincount(colors, minlength=16**3).astype(np.float64).reshape(16, 16, 16)
    for axis in range(3):
        counts = (np.roll(counts, 1, axis) + 2 * counts + np.roll(counts, -1, axis)) / 4
    return counts.ravel() / max(float(counts.sum()), 1.0)
