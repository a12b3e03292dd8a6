"""The region modality: where the contour lies, by the colours of a part and its surroundings.

One object a part and tracker. It remembers the colour histograms from frame to frame; everything
else lives within one frame. Poses are of the part's centre (see `ViewpointModel`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float64

from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Rgb, Scores, Transform
from asdfviz.track import color_histograms, region_kernels
from asdfviz.track.color_histograms import ColorHistograms
from asdfviz.track.confidence import HIDDEN_BY, INSIDE_PX, contour_evidence
from asdfviz.track.gathered_points import GatheredPoints
from asdfviz.track.viewpoint_model import ViewpointModel, Views
from asdfviz.track.visibility import NO_DEPTH, NO_SILHOUETTES, MaybeDepth, Silhouettes

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class RegionConfig:
    """Defaults are ICG's for the YCB data set (Stoiber et al., CVPR 2022)."""

    lines: int = 200
    """Most correspondence lines a part."""
    adaptive_coverage: bool = False
    """Use fewer lines where the contour is shorter than the part's longest (M3T's GBOT setting)."""
    scales: tuple[int, ...] = (7, 4, 2)
    """Pixels a segment, by correspondence iteration; the last one repeats."""
    sigmas_px: tuple[float, ...] = (25.0, 15.0, 10.0)
    """Standard deviation of the contour, by correspondence iteration."""
    function_length: int = 8
    """Segments of the smoothed step functions."""
    distribution_length: int = 12
    """Values of the contour's distribution."""
    amplitude: float = 0.43
    """Of the step functions, below 0.5."""
    slope: float = 0.5
    """Of the step functions, segments; 0 = sharp."""
    learning_rate: float = 1.3
    """Of the local steps."""
    global_updates: int = 1
    """Updates after each correspondence search that take the global step."""
    least_continuous: float = 3.0
    """Segments of unbroken foreground and background that a line needs."""
    histogram_bins: int = 16
    """Bins a colour channel, a power of two."""
    histogram_rate: float = 0.2
    """Learning rate of both histograms, a frame."""
    unconsidered_px: float = 0.5
    """Nearest pixels left out of the histograms."""
    considered_px: float = 20.0
    """Farthest pixels in the histograms."""
    occlusion_radius: float | None = 0.01
    """Measured occlusion: nearer depth within this (metres) hides a point; None = not asked."""
    occlusion_threshold: float = 0.03
    """By how much it must be nearer, metres."""
    unoccluded_frames: int = 10
    """First frames without that test, whose pose may still be poor."""

    def __post_init__(self) -> None:
        if self.histogram_bins not in (2, 4, 8, 16, 32, 64):
            raise InputError(f"histogram_bins is {self.histogram_bins}: give 8, 16, 32 or 64")
        if not 0.0 < self.amplitude < 0.5:
            raise InputError(f"amplitude is {self.amplitude}: it lies between 0 and 0.5")
        if self.function_length + self.distribution_length > region_kernels.MAX_SEGMENTS:
            raise InputError(f"a line has at most {region_kernels.MAX_SEGMENTS} segments")


def step_function(config: RegionConfig) -> Scores:
    """Smoothed step h_f(x) = 1/2 - a tanh(x / 2s), inside first (SRT3D, eq. 11)."""
    x = np.arange(config.function_length) - (config.function_length - 1) / 2
    if config.slope == 0:
        return 0.5 - config.amplitude * np.sign(x)
    return 0.5 - config.amplitude * np.tanh(x / (2 * config.slope))


def least_variance(config: RegionConfig) -> float:
    """Smallest variance of a contour that the step functions allow, segments squared."""
    return float(max(1 / (2 * np.arctanh(2 * config.amplitude) ** 2), config.slope))


class RegionModality:
    """Contour evidence of one part."""

    def __init__(
        self, model: ViewpointModel, lens: Float64[np.ndarray, 4], config: RegionConfig
    ) -> None:
        """Take the camera's (fu, fv, cu, cv) in pixels."""
        self.model = model
        self.config = config
        self.histograms = ColorHistograms(config.histogram_bins)
        self.count = 0
        """Lines of the last search."""
        self.wanted = 0
        """Contour points that the last search tried."""
        self._lens = lens
        self._step = step_function(config)
        self._shape = np.array([config.least_continuous, least_variance(config)])
        self._lengths = np.array([config.unconsidered_px, config.considered_px])
        self._occlusion = np.array([config.occlusion_radius or 0.0, config.occlusion_threshold])
        self._lines = np.zeros((config.lines, region_kernels.LINE_COLUMNS))
        self._probabilities = np.zeros((config.lines, config.distribution_length))
        self._spread = np.array([self._shape[1], config.sigmas_px[0]])
        self._contour = GatheredPoints(
            model,
            "contour",
            most=config.lines,
            radius=config.occlusion_radius,
            adaptive=config.adaptive_coverage,
        )

    def start(self, rgb: Rgb, T_camera_centre: Transform) -> None:
        """Learn the histograms from scratch at a pose that is known."""
        self.histograms = ColorHistograms(self.config.histogram_bins)
        self.learn(rgb, T_camera_centre, views=self.model.views(T_camera_centre), rate=1.0)

    def learn(
        self,
        rgb: Rgb,
        T_camera_centre: Transform,
        *,
        views: Views,
        rate: float,
        depth: MaybeDepth = NO_DEPTH,
        silhouettes: Silhouettes = NO_SILHOUETTES,
        region: int = 0,
    ) -> None:
        """Blend in the colours on both sides of the contour."""
        count = self._contour.gather(views)
        color_histograms.count_colors(
            rgb,
            self.histograms.bits,
            self._contour.points,
            count,
            T_camera_centre,
            self._lens,
            self._lengths,
            depth,
            self._contour.offsets,
            self._occlusion,
            silhouettes.regions,
            silhouettes.crop,
            region,
            self.histograms.counts,
        )
        self.histograms.learn(rate)

    def calculate_correspondences(
        self,
        rgb: Rgb,
        T_camera_centre: Transform,
        *,
        views: Views,
        iteration: int,
        depth: MaybeDepth = NO_DEPTH,
        silhouettes: Silhouettes = NO_SILHOUETTES,
        region: int = 0,
    ) -> None:
        """Lay lines across the contour of the pose's `views` and read where each sees it.

        A depth image that is not empty asks for the test of measured occlusion; silhouettes, in
        which the part has the number `region`, for the test of hidden and shared contours.
        """
        config = self.config
        self.wanted = self._contour.gather(views)
        self._spread[1] = at_iteration(config.sigmas_px, iteration)
        self.count = region_kernels.find_lines(
            rgb,
            self.histograms.table,
            self.histograms.bits,
            self._contour.points,
            self.wanted,
            T_camera_centre,
            self._lens,
            at_iteration(config.scales, iteration),
            self._shape,
            self._step,
            depth,
            self._contour.offsets,
            self._occlusion,
            silhouettes.regions,
            silhouettes.crop,
            region,
            self._lines,
            self._probabilities,
        )

    def calculate_gradient_and_hessian(
        self,
        T_camera_centre: Transform,
        *,
        update: int,
        gradient: Float64[np.ndarray, 6],
        hessian: Float64[np.ndarray, "6 6"],
    ) -> None:
        """Add to the gradient of the log-likelihood and the lower half of its negative Hessian."""
        local = update >= self.config.global_updates
        region_kernels.add_lines(
            self._lines,
            self._probabilities,
            self.count,
            T_camera_centre,
            self._lens,
            self._spread,
            self.config.learning_rate if local else 0.0,
            gradient,
            hessian,
        )

    def evidence(
        self,
        rgb: Rgb,
        T_camera_centre: Transform,
        *,
        views: Views,
        depth: MaybeDepth = NO_DEPTH,
        silhouettes: Silhouettes = NO_SILHOUETTES,
        number: int = 0,
    ) -> tuple[float, float]:
        """Return the contrast at the contour, as a share of the histograms', and how much is seen."""
        contrast, seen = contour_evidence(
            rgb,
            self.histograms.table,
            self.histograms.bits,
            self._contour.points,
            self._contour.gather(views),
            T_camera_centre,
            self._lens,
            depth,
            np.array(INSIDE_PX),
            HIDDEN_BY,
            silhouettes.ids,
            silhouettes.crop,
            number,
        )
        # Colours that part and surroundings share say little whatever the pose.
        return contrast / max(self.histograms.contrast, 0.1), seen


def at_iteration(values: tuple[Value, ...], iteration: int) -> Value:
    """The value for an iteration; the last one repeats."""
    return values[min(iteration, len(values) - 1)]
