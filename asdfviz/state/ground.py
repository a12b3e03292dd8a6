"""The plane around a group of parts, and its look: what is seen where a state has no part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.median import median
from asdfviz.geometry.shapes import Depth, Mask
from asdfviz.state.colors import Look, look_of

InverseDepth: TypeAlias = Float32[np.ndarray, "h w"]
"""1 / planar depth (1 / m), 0 where nothing is."""
Features: TypeAlias = Float32[np.ndarray, "h w 3"]

LEAST_READINGS = 60
"""Fewer give no plane."""
RELIEF = 0.05
"""Readings farther than this from the middle one are left out from the start, metres."""
_ALMOST_ZERO = 1e-9 * np.eye(3)
"""Cells in one row give a plane, too."""
ROUNDS = 5
"""Of fitting, each without what lies off the plane of the one before."""


@dataclass(frozen=True)
class GroundConfig:
    """What belongs to the ground; the paper has no such step."""

    margin: float = 0.006
    """Readings this near to a plane lie on it, metres."""
    least_share: float = 0.5
    """Share of the readings around the group that must, or nothing is known of the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What lies around the group."""

    inverse_depth: InverseDepth
    look: Look | None


def ground_around(
    depth: Depth, features: Features, around: Mask, *, config: GroundConfig
) -> Ground | None:
    """The plane around the group and its look; None where there is no such plane.

    Args:
        depth: measured, metres, 0 = none.
        features: of the colours in the same cells.
        around: the cells to take it from.
        config: what belongs to a plane.
    """
    rows, columns = np.nonzero(around & (depth > 0))
    if len(rows) < LEAST_READINGS:
        return None
    w = 1.0 / depth[rows, columns].astype(np.float64)  # linear over the image for a plane
    design = np.stack([columns, rows, np.ones(len(rows))], axis=1).astype(np.float64)
    on = np.abs(1 / w - median(1 / w)) < RELIEF
    slope, off = np.zeros(3), np.full(len(w), np.inf)
    for _ in range(ROUNDS):
        if np.count_nonzero(on) < LEAST_READINGS // 2:
            return None
        fitted, kept = design[on], on
        slope = np.linalg.solve(fitted.T @ fitted + _ALMOST_ZERO, fitted.T @ w[on])
        off = np.abs(1 / w - 1 / np.maximum(design @ slope, 1e-3))
        on = off < max(config.margin, 2 * median(off))
        if np.array_equal(on, kept):
            break
    on = off < config.margin
    if np.mean(on) < config.least_share:
        return None
    height, width = depth.shape
    down, right = np.mgrid[:height, :width]
    plane = np.maximum(slope[0] * right + slope[1] * down + slope[2], 0).astype(np.float32)
    return Ground(plane, look_of(features[rows[on], columns[on]]))
