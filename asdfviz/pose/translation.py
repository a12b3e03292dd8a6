"""The paper's translation refinement (section 3.1.1): depth moves a part along its viewing ray.

Surface points of the mesh are brought into the camera, back-projected, and kept where they lie in
the predicted box; of those the ones nearest to the camera plane are kept, since only they can be
seen. The depth image is read there; the difference to each point is its shift d_i along the viewing
ray, and the part moves by the mean of the shifts, weighted by W(d_i), which favours small ones.

Readings of what the paper leaves open:

- Weight: W(d) = exp(-d^2 / (2 sigma^2)). It lets go of what lies in front (a hand) and behind (the
  table past a silhouette that is off by some pixels) entirely, which 1 / (1 + d^2) does not.
- Nearest: the box is cut into cells and the nearest point of every cell is kept. The nearest points
  of the whole part would be its near end alone; keeping more than one a cell lets hidden points in,
  which pulled a part of 100 mm 5 mm towards the camera.
- Large first errors: Paper: one step. Here: a coarse step first, because most raw errors of a
  lightly trained network exceed any window that still rejects a hand. It takes the shift on which
  most points agree in the middle of the box, with a broad preference for small shifts; then the
  weighted step is repeated with a narrowing sigma.
- Depth: 0 is a hole; pixels beside a depth edge are flying pixels and are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float64, Int64

from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import (
    Box,
    Depth,
    Intrinsics,
    Pixels,
    Points,
    Scores,
    Transform,
    Vector,
)
from asdfviz.geometry.transforms import apply, transform_from

Shifts: TypeAlias = Float64[np.ndarray, "readings"]
"""The d_i of the points that have a reading, metres."""
Places: TypeAlias = Int64[np.ndarray, "cells"]
"""Row numbers of the points that are kept."""
Flags: TypeAlias = Bool[np.ndarray, "n"]
"""One yes or no a point."""


@dataclass(frozen=True)
class TranslationConfig:
    """How depth moves a part; the paper gives none of the numbers."""

    enabled: bool = True
    """Section 3.1.1 on or off."""
    surface_points: int = 1500
    """Points sampled on each part's surface."""
    sigma: float = 0.005
    """Scale of W(d) = exp(-d^2 / 2 sigma^2) in the last step, metres."""
    steps: int = 4
    """Weighted steps; sigma doubles for each step before the last."""
    coarse: bool = True
    """Look for a large common shift first."""
    coarse_scale: float = 0.05
    """Of several common shifts, one this far away counts half, metres."""
    coarse_area: float = 0.7
    """The coarse step reads this central share of the box in each direction."""
    max_shift: float = 0.4
    """No part is moved farther than this, metres."""
    cells: int = 12
    """Cells of the box in each direction; the nearest point of each is kept. So few that every cell
    holds several of the surface points, or hidden ones would have a cell to themselves."""
    edge: float = 0.02
    """A pixel whose neighbours differ by more than this is on a depth edge, metres."""
    min_points: int = 12
    """Fewer readings than this move nothing."""
    min_agreement: float = 0.15
    """Smallest share of readings within 2 sigma of the moved surface; below, nothing is moved."""


def refine_translation(
    T_camera_part: Transform,
    points_part: Points,
    *,
    box_xyxy: Box,
    depth: Depth | None,
    K: Intrinsics,
    config: TranslationConfig,
) -> Transform | None:
    """Move the part along the viewing ray so that its surface meets the measured depth.

    Args:
        T_camera_part: the pose to refine; its rotation stays.
        points_part: points on the part's surface, metres.
        box_xyxy: the predicted box, pixels.
        depth: planar depth in metres, 0 = none, or None where there is no depth image.
        K: intrinsics of image and depth.
        config: scales, counts and gates.

    Returns:
        None where depth is missing, too sparse or does not agree with the part anywhere near.
    """
    if not config.enabled or depth is None:
        return None
    points_camera = apply(T_camera_part, points_part)
    reader = _Reader(depth, K, config)
    total = np.zeros(3)
    if config.coarse:
        shifts = reader.shifts(points_camera + total, _shrunk(box_xyxy, config.coarse_area))
        if len(shifts) >= config.min_points:
            total = total + _along_ray(points_camera + total, _common_shift(shifts, config))
    for step in reversed(range(config.steps)):
        shifts = reader.shifts(points_camera + total, box_xyxy)
        weights = np.exp(-0.5 * (shifts / (config.sigma * 2**step)) ** 2)
        if len(shifts) < config.min_points or weights.sum() < 1e-6:
            return None
        mean_shift = float((weights * shifts).sum() / weights.sum())
        total = total + _along_ray(points_camera + total, mean_shift)
    shifts = reader.shifts(points_camera + total, box_xyxy)
    if len(shifts) < config.min_points or float(np.linalg.norm(total)) > config.max_shift:
        return None
    if float((np.abs(shifts) < 2 * config.sigma).mean()) < config.min_agreement:
        return None
    return transform_from(T_camera_part[:3, :3], T_camera_part[:3, 3] + total)


def _along_ray(points_camera: Points, shift: float) -> Vector:
    """The shift along the ray through the part's middle, which keeps its place in the image."""
    middle = points_camera.mean(axis=0)
    return shift * middle / np.linalg.norm(middle)


def _shrunk(box_xyxy: Box, share: float) -> Box:
    center, half = (box_xyxy[:2] + box_xyxy[2:]) / 2, (box_xyxy[2:] - box_xyxy[:2]) / 2 * share
    return np.concatenate([center - half, center + half])


class _Reader:
    """Reads a depth image for points of a part."""

    def __init__(self, depth: Depth, K: Intrinsics, config: TranslationConfig) -> None:
        self._depth, self._K, self._config = depth, K, config

    def shifts(self, points_camera: Points, box_xyxy: Box) -> Shifts:
        """The d_i: how far along its ray the measured surface lies behind each visible point."""
        front = points_camera[points_camera[:, 2] > 1e-6]
        pixels = project(front, self._K)
        inside = _inside(pixels, box_xyxy, self._depth.shape)
        front, pixels = front[inside], pixels[inside]
        nearest = _nearest_of_cells(pixels, front[:, 2], box_xyxy, self._config.cells)
        visible = front[nearest]
        measured, valid = _readings(self._depth, pixels[nearest], self._config.edge)
        z = visible[:, 2]
        return ((measured - z) * np.linalg.norm(visible, axis=1) / z)[valid]


def _inside(pixels: Pixels, box_xyxy: Box, shape: tuple[int, ...]) -> Flags:
    height, width = shape
    low = np.maximum(box_xyxy[:2], 0)
    high = np.minimum(box_xyxy[2:], [width - 1, height - 1])
    return np.all((pixels >= low) & (pixels <= high), axis=1)


def _nearest_of_cells(pixels: Pixels, z: Scores, box_xyxy: Box, cells: int) -> Places:
    """Places of the nearest point of every cell of the box that has any."""
    extent = np.maximum(box_xyxy[2:] - box_xyxy[:2], 1e-6)
    cell = np.clip((pixels - box_xyxy[:2]) / extent * cells, 0, cells - 1).astype(np.int64)
    from_near = np.argsort(z, kind="stable")
    flat = (cell[:, 1] * cells + cell[:, 0])[from_near]
    return from_near[np.unique(flat, return_index=True)[1]]


def _readings(depth: Depth, pixels: Pixels, edge: float) -> tuple[Scores, Flags]:
    """Depth at the nearest pixel, and whether it is a reading away from holes and edges."""
    height, width = depth.shape
    u, v = np.rint(pixels).astype(np.intp).T
    offsets = np.arange(-1, 2)
    rows = np.clip(v[:, None, None] + offsets[None, :, None], 0, height - 1)
    columns = np.clip(u[:, None, None] + offsets[None, None, :], 0, width - 1)
    patch = depth[rows, columns].reshape(-1, 9).astype(np.float64)
    center = patch[:, 4]
    low = np.where(patch > 0, patch, center[:, None]).min(axis=1)
    return center, (center > 0) & (patch.max(axis=1) - low <= edge)


def _common_shift(shifts: Shifts, config: TranslationConfig) -> float:
    """The shift on which most readings agree; small ones are preferred among equals."""
    bandwidth = 4 * config.sigma
    ordered = np.sort(shifts)
    support = np.searchsorted(ordered, ordered + bandwidth, side="right") - np.searchsorted(
        ordered, ordered - bandwidth, side="left"
    )
    preference = 1 / (1 + (ordered / config.coarse_scale) ** 2)
    best = ordered[int((support * preference).argmax())]
    return float(np.median(ordered[np.abs(ordered - best) <= bandwidth]))
