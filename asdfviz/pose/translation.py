"""The paper's translation refinement (section 3.1.1): depth moves a part along its viewing ray.

Surface points of the mesh are brought into the camera, back-projected, and kept where they lie in
the predicted box; of those the ones nearest to the camera plane are kept, since only they can be
seen. The depth image is read there; the difference to each point is its shift d_i along the viewing
ray, and the part moves by the mean of the shifts, weighted by W(d_i), which favours small ones.

Readings of what the paper leaves open:

- Weight: W(d) = exp(-d^2 / (2 sigma^2)). It lets go of what lies in front (a hand) and behind (the
  table past a silhouette that is off by some pixels) entirely, which 1 / (1 + d^2) does not. The
  other functions of `Weighting` are there to compare with (`asdfviz ablate weighting`).
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
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.boxes import box_middle
from asdfviz.geometry.median import median
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points, Scores, Transform, Vector
from asdfviz.geometry.transforms import apply, transform_from
from asdfviz.pose.depth_kernels import ray_shifts

Shifts: TypeAlias = Float64[np.ndarray, "readings"]
"""The d_i of the points that have a reading, metres."""
Weighting: TypeAlias = Literal["gaussian", "huber", "cauchy", "nearest", "uniform"]
"""W(d) by d over its scale s. gaussian: exp(-(d/s)^2 / 2). huber: 1 up to s, then s/d. cauchy:
1 / (1 + (d/s)^2). nearest: 1 for the smallest `NEAREST_SHARE` of the shifts, 0 for the others.
uniform: 1, a plain mean."""
NEAREST_SHARE = 0.5
"""Share of the shifts that the weighting "nearest" keeps."""


@dataclass(frozen=True)
class TranslationConfig:
    """How depth moves a part; the paper gives none of the numbers."""

    enabled: bool = True
    """Section 3.1.1 on or off."""
    surface_points: int = 1500
    """Points sampled on each part's surface."""
    weights: Weighting = "gaussian"
    """W(d), which favours small shifts. Paper: not given."""
    sigma: float = 0.005
    """Scale of W(d) in the last step, metres."""
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
    """Smallest share of readings within 2 sigma of the moved surface; below, nothing is moved. 0 asks
    for no readings there."""


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
    middle = points_camera.mean(axis=0)
    total = np.zeros(3)

    def shifts_in(box_xyxy: Box) -> Shifts:
        """The d_i: how far along its ray the measured surface lies behind each visible point."""
        return ray_shifts(points_camera, total, K, depth, box_xyxy, config.cells, config.edge)

    if config.coarse:
        shifts = shifts_in(_shrunk(box_xyxy, config.coarse_area))
        if len(shifts) >= config.min_points:
            total = total + _along_ray(middle + total, _common_shift(shifts, config))
    for step in reversed(range(config.steps)):
        shifts = shifts_in(box_xyxy)
        weights = weights_of(shifts, config.sigma * 2**step, kind=config.weights)
        if len(shifts) < config.min_points or weights.sum() < 1e-6:
            return None
        mean_shift = float((weights * shifts).sum() / weights.sum())
        total = total + _along_ray(middle + total, mean_shift)
    if float(np.linalg.norm(total)) > config.max_shift:
        return None
    if config.min_agreement > 0 and not _agrees(shifts_in(box_xyxy), config):
        return None
    return transform_from(T_camera_part[:3, :3], T_camera_part[:3, 3] + total)


def _agrees(shifts: Shifts, config: TranslationConfig) -> bool:
    """Whether enough readings are left on the moved surface."""
    if len(shifts) < config.min_points:
        return False
    return float((np.abs(shifts) < 2 * config.sigma).mean()) >= config.min_agreement


def weights_of(shifts: Shifts, scale: float, *, kind: Weighting) -> Scores:
    """W(d_i) of every shift, at least 0.

    Args:
        shifts: along the rays, metres.
        scale: the shift from which it counts clearly less, metres.
        kind: the function.
    """
    off = np.abs(shifts) / scale
    if kind == "gaussian":
        return np.exp(-0.5 * off**2)
    if kind == "huber":
        return 1 / np.maximum(off, 1.0)
    if kind == "cauchy":
        return 1 / (1 + off**2)
    if kind == "nearest":
        count = max(1, round(NEAREST_SHARE * len(shifts)))
        return (off <= np.sort(off)[count - 1 : count]).astype(np.float64)
    return np.ones(len(shifts))


def _along_ray(middle: Vector, shift: float) -> Vector:
    """The shift along the ray through the part's middle, which keeps its place in the image."""
    return shift * middle / np.linalg.norm(middle)


def _shrunk(box_xyxy: Box, share: float) -> Box:
    center, half = box_middle(box_xyxy), (box_xyxy[2:] - box_xyxy[:2]) / 2 * share
    return np.concatenate([center - half, center + half])


def _common_shift(shifts: Shifts, config: TranslationConfig) -> float:
    """The shift on which most readings agree; small ones are preferred among equals."""
    bandwidth = 4 * config.sigma
    ordered = np.sort(shifts)
    support = np.searchsorted(ordered, ordered + bandwidth, side="right") - np.searchsorted(
        ordered, ordered - bandwidth, side="left"
    )
    preference = 1 / (1 + (ordered / config.coarse_scale) ** 2)
    best = ordered[int((support * preference).argmax())]
    return median(ordered[np.abs(ordered - best) <= bandwidth])
