"""The three pose errors of the BOP challenge, as bop_toolkit's pose_error.py defines them.

VSD compares what can be seen of both poses, MSSD their largest distance in space, MSPD in the picture;
each takes the part's symmetries into account. Hodan et al., "BOP Challenge 2020 on 6D Object
Localization" (ECCVW 2020). Metres and pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Part
from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import farthest_points
from asdfviz.geometry.shapes import Depth, Intrinsics, Points, Scores, Transform
from asdfviz.geometry.transforms import apply

VISIBILITY_TOLERANCE = 0.015
"""Delta of VSD, metres: how far behind the measured surface a model's point still counts as seen."""
_OUTPOSTS = 48
"""Far points of the model that bound each symmetric pose's error before all points are asked."""


@dataclass(frozen=True, slots=True, eq=False)
class BopModel:
    """A part made ready for BOP's errors."""

    part: Part
    outposts: Points
    symmetries: Float64[np.ndarray, "s 4 4"]
    """All of them, identity first, continuous ones cut into BOP's 315 steps."""


def bop_model(part: Part) -> BopModel:
    """Prepare a part; its mesh's vertices are BOP's model points."""
    outposts = farthest_points(part.mesh.vertices, _OUTPOSTS)
    return BopModel(part, outposts, part.symmetries.transforms())


def mssd(T_camera_estimate: Transform, T_camera_truth: Transform, model: BopModel) -> float:
    """Maximum symmetry-aware surface distance, metres: min over S of max over x."""

    def distances(T_camera_other: Transform, points: Points) -> Scores:
        gaps = apply(T_camera_estimate, points) - apply(T_camera_other, points)
        return np.linalg.norm(gaps, axis=1)

    return _least_largest(distances, T_camera_truth, model)


def mspd(
    T_camera_estimate: Transform, T_camera_truth: Transform, model: BopModel, *, K: Intrinsics
) -> float:
    """Maximum symmetry-aware projection distance, pixels; infinite behind the camera."""

    def distances(T_camera_other: Transform, points: Points) -> Scores:
        gaps = project(apply(T_camera_estimate, points), K) - project(
            apply(T_camera_other, points), K
        )
        return np.nan_to_num(np.linalg.norm(gaps, axis=1), nan=np.inf)

    return _least_largest(distances, T_camera_truth, model)


def _least_largest(
    distances: Callable[[Transform, Points], Scores], T_camera_truth: Transform, model: BopModel
) -> float:
    """Smallest over all symmetric poses of the largest distance; exact, though few are asked fully.

    The largest distance of a few points is never above that of all, so poses whose few points are
    farther off than the best pose found cannot win.
    """
    Ts_camera_other = T_camera_truth @ model.symmetries
    bounds = np.array([distances(T, model.outposts).max() for T in Ts_camera_other])
    best = np.inf
    for place in np.argsort(bounds, kind="stable"):
        if bounds[place] >= best:
            break
        largest = distances(Ts_camera_other[place], model.part.mesh.vertices).max()
        best = min(best, float(largest))
    return best


def vsd(
    depth_estimate: Depth,
    depth_truth: Depth,
    depth_seen: Depth,
    K: Intrinsics,
    *,
    diameter: float,
    taus: Scores,
    delta: float = VISIBILITY_TOLERANCE,
) -> Scores:
    """Visible surface discrepancy for every tau (a share of the diameter), step cost, 0 to 1.

    Args:
        depth_estimate: the part alone, rendered in the estimated pose; planar metres, 0 = nothing.
        depth_truth: the same in the true pose.
        depth_seen: the scene as measured; where it has a hole, everything counts as seen.
        K: intrinsics of all three.
        diameter: of the part, metres.
        taus: misalignment tolerances in diameters.
        delta: see `VISIBILITY_TOLERANCE`.
    """
    rows, columns = _covering((depth_estimate > 0) | (depth_truth > 0))
    rays = _ray_lengths(K, rows, columns)
    estimate, truth, seen = (
        depth[rows, columns].astype(np.float64) * rays
        for depth in (depth_estimate, depth_truth, depth_seen)
    )
    truth_shows = (truth > 0) & ((truth - seen <= delta) | (seen == 0))
    estimate_shows = (estimate > 0) & ((estimate - seen <= delta) | (seen == 0) | truth_shows)
    either = int((truth_shows | estimate_shows).sum())
    if either == 0:
        return np.ones(len(taus))
    both = truth_shows & estimate_shows
    gaps = np.abs(truth[both] - estimate[both]) / diameter
    wrong = np.array([int((gaps >= tau).sum()) for tau in taus])
    return (wrong + either - int(both.sum())) / either


def _covering(mask: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns that hold all of a mask: nothing outside them can count."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return slice(0, 0), slice(0, 0)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _ray_lengths(K: Intrinsics, rows: slice, columns: slice) -> Float64[np.ndarray, "h w"]:
    """Distance from the camera of a point at planar depth 1, by pixel."""
    v, u = (np.arange(part.start, part.stop, dtype=np.float64) for part in (rows, columns))
    y, x = (v - K[1, 2]) / K[1, 1], (u - K[0, 2]) / K[0, 0]
    return np.sqrt(x[None, :] ** 2 + y[:, None] ** 2 + 1.0)
