"""Where things are put in front of a training crop's camera."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Rotation, Transform, Vector
from asdfviz.geometry.transforms import transform_from


def direction(rng: np.random.Generator) -> Vector:
    """A unit vector across the optical axis."""
    angle = rng.random() * 2 * np.pi
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def unit(rng: np.random.Generator) -> Vector:
    """A unit vector in any direction."""
    return (v := rng.normal(size=3)) / np.linalg.norm(v)


def centred(
    corners: Float64[np.ndarray, "_ 3"], R: Rotation, distance: float
) -> tuple[Transform, float]:
    """The pose whose box lies about the optical axis, and the box's longer side at its depth, metres."""
    turned = corners @ R.T
    t = np.array([0.0, 0.0, distance]) - (turned.min(axis=0) + turned.max(axis=0)) / 2
    extent = 0.0
    for _ in range(3):
        seen = turned + t
        flat = seen[:, :2] / seen[:, 2:]
        low, high = flat.min(axis=0), flat.max(axis=0)
        t[:2] -= (low + high) / 2 * t[2]
        extent = float((high - low).max()) * t[2]
    return transform_from(R, t), extent
