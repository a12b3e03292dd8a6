"""Measures how far depth lies beside colour: the classic sign of a wrong registration or lens.

Depth edges are moved by a scale about the principal point and a shift until they lie on colour
edges of their own direction (chamfer matching: Barrow et al., 1977; with directions: Shotton et
al., 2008). The scale takes up what a lens or a wrong focal length does.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from collections.abc import Sequence as Rows
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int64

from asdfviz.datatypes import Frame
from asdfviz.evaluate.health_edges import (
    Edges,
    color_edges,
    depth_edges,
    sampled,
    thinned,
)
from asdfviz.geometry.shapes import Pixels, Scores, Vector

MOST_SHIFT_FRAMES = 6
"""So many frames, spread over a sequence, tell its shift."""
SCALES = 7
"""So many are tried."""


@dataclass(frozen=True, slots=True)
class ShiftConfig:
    """How depth and colour edges are compared."""

    directions: int = 6
    """Bins of edge direction over half a turn."""
    truncation_px: float = 5.0
    """Distance beyond which an edge counts as having no partner."""
    search_px: int = 12
    """Largest shift tried in x and in y."""
    search_scale: float = 0.03
    """Largest scale tried, as a share; the Kinect's lens makes 0.02."""
    points_a_frame: int = 1500
    """Depth edge points used."""
    least_points: int = 150
    """Fewer depth edge points than these in all frames say nothing."""
    least_gain: float = 0.06
    """Share of the mean edge distance that moving the depth must save to count as a shift."""
    least_match: float = 0.15
    """Share by which the best place must beat the median of all places tried; else nothing fits."""


@dataclass(frozen=True, slots=True)
class DepthShift:
    """What moves depth edges onto colour edges: u' = centre + scale (u - centre) + shift."""

    typical_px: float
    """Displacement that a quarter of the depth edges exceed."""
    shift_px: tuple[float, float]
    scale: float
    distance_px: float
    """Mean truncated distance of depth edges to colour edges as they are."""
    moved_distance_px: float
    """The same once moved."""


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """One frame: depth edge points about the principal point, and distances to colour edges."""

    offsets: Pixels
    center: Float64[np.ndarray, "2"]
    bins: Int64[np.ndarray, " n"]
    distances: Float32[np.ndarray, "d h w"]


def spread(length: int, most: int) -> list[int]:
    """At most `most` places, even over the sequence, first and last among them."""
    return [int(i) for i in np.unique(np.linspace(0, length - 1, min(length, most)).round())]


def measure_shift(
    frames: Rows[Frame],
    *,
    config: ShiftConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DepthShift | None:
    """Measure one shift over all frames; None where too few depth edges lie on colour edges to tell.

    Args:
        frames: that have depth.
        config: how edges are compared.
        progress: called with steps done and in all: a frame's edges each, then a scale tried each.
    """
    config = config or ShiftConfig()
    steps = itertools.count(1)
    total = len(frames) + SCALES

    def tell() -> None:
        if progress is not None:
            progress(next(steps), total)

    views: list[_View] = []
    for frame in frames:
        view = _view(frame, config)
        views += [] if view is None else [view]
        tell()
    if sum(len(view.bins) for view in views) < config.least_points:
        return None
    at_rest = np.array([1.0, 0.0, 0.0])
    warp, chance = _search(views, config, tell)
    before, after = _cost(at_rest, views), _cost(warp, views)
    if after > (1.0 - config.least_match) * chance:
        return None
    if before - after < config.least_gain * before:
        warp, after = at_rest, before
    offsets = np.concatenate([view.offsets for view in views])
    lengths = np.linalg.norm(offsets * (warp[0] - 1.0) + warp[1:], axis=1)
    return DepthShift(
        typical_px=float(np.percentile(lengths, 75)),
        shift_px=(float(warp[1]), float(warp[2])),
        scale=float(warp[0]),
        distance_px=before,
        moved_distance_px=after,
    )


def _view(frame: Frame, config: ShiftConfig) -> _View | None:
    if frame.depth is None:
        return None
    edges = thinned(depth_edges(frame.depth), config.points_a_frame)
    if len(edges.pixels) == 0:
        return None
    center = frame.camera.K[:2, 2]
    bins = np.minimum(edges.angles / np.pi * config.directions, config.directions - 1)
    return _View(
        offsets=edges.pixels - center,
        center=center,
        bins=bins.astype(np.int64),
        distances=_distances(color_edges(frame.rgb), frame.rgb.shape[:2], config),
    )


def _distances(
    edges: Edges, shape: tuple[int, ...], config: ShiftConfig
) -> Float32[np.ndarray, "d h w"]:
    """Truncated distance to the nearest colour edge of each direction (neighbouring bins overlap)."""
    width = np.pi / config.directions
    rounded = np.rint(edges.pixels).astype(np.int64)
    stack: list[np.ndarray] = []
    for k in range(config.directions):
        turn = np.abs((edges.angles - (k + 0.5) * width + np.pi / 2) % np.pi - np.pi / 2)
        near = rounded[turn < 1.2 * width]
        image = np.ones(shape, dtype=np.uint8)
        image[near[:, 1], near[:, 0]] = 0
        distance = cv2.distanceTransform(image, cv2.DIST_L2, 5)
        stack.append(np.minimum(distance, np.float32(config.truncation_px)))
    return np.stack(stack).astype(np.float32)


def _search(
    views: list[_View], config: ShiftConfig, tell: Callable[[], None]
) -> tuple[Vector, float]:
    """Best (scale, shift in x, shift in y) and the median cost of all that were tried.

    A coarse grid, then ever finer steps from its best places.
    """
    # Steps well inside the truncated distance's basin.
    shifts = np.arange(-config.search_px, config.search_px + 1, 2)
    scales = 1.0 + np.linspace(-1.0, 1.0, SCALES) * config.search_scale
    grid: list[Vector] = []
    costs: list[float] = []
    for scale in scales.tolist():
        grid += [np.array([scale, x, y]) for x, y in itertools.product(shifts, shifts)]
        costs += _rounded_costs(scale, shifts, views).tolist()
        tell()
    starts = [grid[int(i)] for i in np.argsort(costs, kind="stable")[:3]]
    found = [_refined(start, views) for start in starts]
    best = min(found, key=lambda warp: _cost(warp, views))
    return best, float(np.median(costs))


def _refined(start: Vector, views: list[_View]) -> Vector:
    """Pattern search (Hooke and Jeeves, 1961): step along each axis while it helps, then halve."""
    best, cost = start, _cost(start, views)
    steps = np.diag([0.005, 1.0, 1.0])
    while steps[1, 1] > 0.05:
        moves = [best + sign * step for step in steps for sign in (-1.0, 1.0)]
        costs = _costs(moves, views)
        if costs.min() < cost - 1e-6:
            best, cost = moves[int(costs.argmin())], float(costs.min())
        else:
            steps = steps / 2.0
    return best


def _rounded_costs(scale: float, shifts: Int64[np.ndarray, " s"], views: list[_View]) -> Scores:
    """Mean truncated distance at the nearest pixels, for each shift in x and y: quick, for the grid."""
    totals, count = np.zeros((len(shifts), len(shifts))), 0
    for view in views:
        u, v = np.rint(view.offsets * scale + view.center).astype(np.int64).T
        height, width = view.distances.shape[1:]
        us = (u + shifts[:, None]).clip(0, width - 1)
        rows = (v + shifts[:, None]).clip(0, height - 1) + view.bins * height
        places = us[:, None] + rows[None] * width
        totals += view.distances.reshape(-1).take(places).sum(axis=2)
        count += len(view.bins)
    return totals.reshape(-1) / count


def _cost(warp: Vector, views: list[_View]) -> float:
    return float(_costs([warp], views)[0])


def _costs(warps: list[Vector], views: list[_View]) -> Scores:
    """Mean truncated distance between pixels, of each warp: smooth, for the last steps."""
    values: list[Float64[np.ndarray, "w n"]] = []
    for view in views:
        moved = np.stack([view.offsets * warp[0] + view.center + warp[1:] for warp in warps])
        count, height, width = view.distances.shape
        # One picture above the other, so that all directions are read at once.
        moved[..., 1] = moved[..., 1].clip(0, height - 1) + view.bins * height
        stacked = view.distances.reshape(count * height, width)
        values.append(sampled(stacked, moved.reshape(-1, 2)).reshape(len(warps), -1))
    return np.concatenate(values, axis=1).mean(axis=1)
