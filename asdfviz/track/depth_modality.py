"""The depth modality: point-to-plane distances from the model's surface to the measured points.

One object a part and tracker; nothing is remembered from frame to frame. Poses are of the part's
centre (see `ViewpointModel`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.errors import InputError
from asdfviz.geometry.median import median
from asdfviz.geometry.shapes import Transform
from asdfviz.track import depth_kernels
from asdfviz.track.confidence import HIDDEN_BY, depth_gaps, surface_evidence
from asdfviz.track.gathered_points import GatheredPoints
from asdfviz.track.region_modality import at_iteration
from asdfviz.track.viewpoint_model import EDGE_COLUMN, ViewpointModel, Views
from asdfviz.track.visibility import NO_SILHOUETTES, MaybeDepth, Silhouettes


@dataclass(frozen=True, slots=True)
class DepthConfig:
    """Defaults are ICG's for the YCB data set (Stoiber et al., CVPR 2022)."""

    points: int = 200
    """Most surface points a part."""
    adaptive_coverage: bool = False
    """Use fewer points where less of the surface shows (M3T's GBOT setting)."""
    considered_distances: tuple[float, ...] = (0.07, 0.05, 0.04)
    """Farthest measured point that may match, metres, by correspondence iteration."""
    sigmas: tuple[float, ...] = (0.05, 0.03, 0.02)
    """Standard deviation of the distance at 1 m, metres; it grows with the depth."""
    stride: float = 0.005
    """Between the measured points that are tried, metres."""
    scale_by_depth: bool = False
    """Multiply the distances and the stride by the depth (M3T's GBOT setting)."""
    occlusion_radius: float | None = 0.01
    """Measured occlusion: nearer depth within this (metres) hides a point; None = not asked."""
    occlusion_threshold: float = 0.03
    """By how much it must be nearer, metres."""
    unoccluded_frames: int = 10
    """First frames without that test, whose pose may still be poor."""
    edge_px: float = 0.0
    """Surface points nearer to the outline than this, pixels, are left out, as sensors draw what lies
    behind over them; what is left weighs as much together."""
    edge_share: float = 0.5
    """But never those farther from it than this share of the part's farthest: of what is thin in the
    picture the middle stays."""

    def __post_init__(self) -> None:
        """Raise an InputError where no points would be left, or nothing would weigh them."""
        for name in ("considered_distances", "sigmas"):
            metres = getattr(self, name)
            if not metres or not all(0 < one < math.inf for one in metres):
                raise InputError(f"{name} are {metres}: give one or more, all above 0 (metres)")
        if not self.edge_px >= 0:
            raise InputError(f"edge_px is {self.edge_px}: 0 or more pixels are left out")
        if not 0 <= self.edge_share < 1:
            raise InputError(f"edge_share is {self.edge_share}: it lies between 0 and 1, below 1")


class DepthModality:
    """Surface evidence of one part."""

    def __init__(
        self, model: ViewpointModel, lens: Float64[np.ndarray, 4], config: DepthConfig
    ) -> None:
        """Take the camera's (fu, fv, cu, cv) in pixels."""
        self.model = model
        self.config = config
        self.count = 0
        """Matches of the last search."""
        self.wanted = 0
        """Surface points that the last search tried."""
        self._lens = lens
        self._occlusion = np.array([config.occlusion_radius or 0.0, config.occlusion_threshold])
        self._search = np.array([config.considered_distances[0], config.stride])
        self._sigma = config.sigmas[0]
        self._surface = GatheredPoints(
            model,
            "surface",
            most=config.points,
            radius=config.occlusion_radius,
            adaptive=config.adaptive_coverage,
        )
        self._matches = np.zeros((config.points, depth_kernels.MATCH_COLUMNS))

    def calculate_correspondences(
        self,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        views: Views,
        iteration: int,
        hide: bool = False,
        silhouettes: Silhouettes = NO_SILHOUETTES,
        number: int = 0,
    ) -> None:
        """Find the measured point that belongs to each surface point of the pose's `views`.

        `hide` asks for the test of measured occlusion; silhouettes, in which the part has id
        `number`, for the test whether the part itself shows there.
        """
        self.wanted = self._surface.gather(views)
        self._search[0] = at_iteration(self.config.considered_distances, iteration)
        least_edge, kept = self._inner(T_camera_centre)
        self._sigma = at_iteration(self.config.sigmas, iteration) * kept**0.5
        self.count = depth_kernels.find_matches(
            depth,
            self._surface.points,
            self.wanted,
            T_camera_centre,
            self._lens,
            self._search,
            self.config.scale_by_depth,
            least_edge,
            hide,
            self._surface.offsets,
            self._occlusion,
            silhouettes.ids,
            silhouettes.crop,
            number,
            self._matches,
        )

    def _inner(self, T_camera_centre: Transform) -> tuple[float, float]:
        """From which distance of the outline on (pixels) points count, and what share of them does."""
        if self.config.edge_px <= 0.0 or self.wanted == 0:
            return 0.0, 1.0
        scale = self._lens[0] / max(T_camera_centre[2, 3], 1e-3)
        px = self._surface.points[: self.wanted, EDGE_COLUMN] * scale
        least = min(self.config.edge_px, self.config.edge_share * float(px.max()))
        return least, float((px >= least).mean())

    def calculate_gradient_and_hessian(
        self,
        T_camera_centre: Transform,
        *,
        gradient: Float64[np.ndarray, 6],
        hessian: Float64[np.ndarray, "6 6"],
    ) -> None:
        """Add to the gradient of the log-likelihood and the lower half of its negative Hessian."""
        depth_kernels.add_matches(
            self._matches, self.count, T_camera_centre, self._sigma, gradient, hessian
        )

    def evidence(
        self,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        views: Views,
        tolerance: float,
        silhouettes: Silhouettes = NO_SILHOUETTES,
        number: int = 0,
    ) -> tuple[float, float]:
        """Return the share of seen surface points that fit within `tolerance` metres, and are seen."""
        return surface_evidence(
            depth,
            self._surface.points,
            self._surface.gather(views),
            T_camera_centre,
            self._lens,
            tolerance,
            HIDDEN_BY,
            silhouettes.ids,
            silhouettes.crop,
            number,
        )

    def gap(self, depth: MaybeDepth, T_camera_centre: Transform, *, views: Views) -> float | None:
        """Median of how far the measured surface is behind the part's, metres.

        None where less than a quarter of the surface points has measured depth.
        """
        count = self._surface.gather(views)
        gaps = depth_gaps(depth, self._surface.points, count, T_camera_centre, self._lens)
        return median(gaps) if 4 * len(gaps) >= max(count, 1) else None
