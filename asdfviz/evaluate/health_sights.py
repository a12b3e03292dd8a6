"""Parts at their true poses as the depth camera should see them, and what it measured there."""

from __future__ import annotations

from collections.abc import Sequence as Rows
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Camera, Frame, FrameTruth
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Depth, Pixels, Points, Scores
from asdfviz.geometry.transforms import apply

_LEAST_VISIBLE = 0.3
"""Share of a part's outline."""


@dataclass(frozen=True, slots=True)
class Posed:
    """A part at its true pose in a frame that was looked at."""

    part: str
    frame: Frame
    truth: FrameTruth


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Surface points that the camera should see, and the image that they are compared with."""

    pixels: Pixels
    z: Scores
    depth: Depth
    camera: Camera


def posed_parts(frames: Rows[tuple[Frame, FrameTruth | None]]) -> tuple[Posed, ...]:
    """Every part that is visible enough (30 %, where that is known) in every frame with truth."""
    return tuple(
        Posed(part=name, frame=frame, truth=truth)
        for frame, truth in frames
        if truth is not None
        for name in truth.T_camera_part
        if truth.visible.get(name, 1.0) >= _LEAST_VISIBLE
    )


def sight_of(posed: Posed, surface: Points) -> Sight | None:
    """Project the part's surface and keep what is in front; None where nothing is in the image."""
    frame = posed.frame
    if frame.depth is None:
        return None
    points = apply(posed.truth.T_camera_part[posed.part], surface)
    points = points[points[:, 2] > 0.01]
    pixels = project(points, frame.camera.K)
    inside = ((pixels >= 0) & (pixels < [frame.camera.width, frame.camera.height])).all(axis=1)
    if inside.sum() < 20:
        return None
    pixels, z = pixels[inside], points[inside, 2]
    front = _in_front(pixels, z)
    return Sight(pixels=pixels[front], z=z[front], depth=frame.depth, camera=frame.camera)


def _in_front(pixels: Pixels, z: Scores) -> np.ndarray:
    """Which points are nearest within their cell of a grid over the part: a coarse depth buffer."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    cells = max(int(np.sqrt(len(z) / 6)), 1)
    place = ((pixels - low) / np.maximum(high - low, 1e-9) * cells).astype(np.int64)
    place = np.minimum(place, cells - 1)
    cell = place[:, 0] * cells + place[:, 1]
    nearest = np.full(cells * cells, np.inf)
    np.minimum.at(nearest, cell, z)
    return z <= nearest[cell] + 0.005


def measured_behind(sight: Sight, *, scale: float = 1.0, shift: np.ndarray | None = None) -> Scores:
    """Depth behind the points when their pixels are moved about the principal point; 0 outside."""
    center = sight.camera.K[:2, 2]
    moved = (sight.pixels - center) * scale + center + (0.0 if shift is None else shift)
    uv = np.rint(moved).astype(np.int64)
    height, width = sight.depth.shape
    inside = ((uv >= 0) & (uv < [width, height])).all(axis=1)
    uv = uv.clip(0, [width - 1, height - 1])
    return np.where(inside, sight.depth[uv[:, 1], uv[:, 0]], 0.0).astype(np.float64)


def fitting_share(sights: Rows[Sight], *, scale: float, shift: np.ndarray) -> float:
    """Share of the points whose measured depth is the true one; points outside do not fit."""
    fitting, count = 0, 0
    for sight in sights:
        measured = measured_behind(sight, scale=scale, shift=shift)
        fitting += int(fits(measured, sight.z).sum())
        count += len(sight.z)
    return fitting / max(count, 1)


def seen_through(sights: Rows[Sight]) -> tuple[int, int]:
    """How many points fit, and behind how many the camera measured more depth; hidden ones are neither."""
    fitting, beyond = 0, 0
    for sight in sights:
        measured = measured_behind(sight)
        on_depth = fits(measured, sight.z)
        fitting += int(on_depth.sum())
        beyond += int(((measured > sight.z) & ~on_depth).sum())
    return fitting, beyond


def fits(measured: Scores, z: Scores) -> np.ndarray:
    """Which points lie on the measured depth."""
    # Wide enough for a sensor's bias on plastic, narrow enough to tell a part from its table.
    return np.abs(measured - z) < np.maximum(0.008, 0.008 * z)


def thinned(sights: Rows[Sight], most: int = 2500) -> list[Sight]:
    """The sights with no more than so many points in all, or few more."""
    every = max(1, -(-sum(len(sight.z) for sight in sights) // most))
    return [Sight(s.pixels[::every], s.z[::every], s.depth, s.camera) for s in sights]
