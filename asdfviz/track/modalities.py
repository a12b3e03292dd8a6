"""One tracked part's modalities side by side, and when each asks for occlusion."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Rgb, Transform
from asdfviz.track.confidence import Evidence
from asdfviz.track.depth_modality import DepthModality
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.region_modality import RegionModality
from asdfviz.track.surface_colors import SurfaceColors
from asdfviz.track.viewpoint_model import ViewpointModel
from asdfviz.track.visibility import NO_DEPTH, NO_SILHOUETTES, MaybeDepth, Silhouettes


class Modalities:
    """Colour and depth evidence of one part, as far as its config wants them."""

    def __init__(
        self, model: ViewpointModel, lens: Float64[np.ndarray, 4], config: TrackerConfig
    ) -> None:
        """Take the camera's (fu, fv, cu, cv) in pixels."""
        self.model = model
        self.region = RegionModality(model, lens, config.region) if config.region else None
        self.depth = DepthModality(model, lens, config.depth) if config.depth else None
        self.colors = SurfaceColors(model, lens, config.colors) if config.region else None
        self.frames = 0
        """Frames since the start."""

    def start(self, rgb: Rgb, depth: MaybeDepth, T_camera_centre: Transform) -> None:
        """Learn the part's colours at a pose that is known."""
        self.frames = 0
        if self.region is not None:
            self.region.start(rgb, T_camera_centre)
        if self.colors is not None:
            self.colors.learn(
                rgb,
                depth,
                T_camera_centre,
                views=self.model.views(T_camera_centre),
                silhouettes=NO_SILHOUETTES,
                number=0,
            )

    def calculate_correspondences(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        iteration: int,
        silhouettes: Silhouettes,
        number: int,
        region: int,
    ) -> None:
        """Let every modality find its correspondences at a pose."""
        views = self.model.views(T_camera_centre)
        if self.region is not None:
            self.region.calculate_correspondences(
                rgb,
                T_camera_centre,
                views=views,
                iteration=iteration,
                depth=self._occluders(depth),
                silhouettes=silhouettes,
                region=region,
            )
        if self.depth is not None:
            config = self.depth.config
            self.depth.calculate_correspondences(
                depth,
                T_camera_centre,
                views=views,
                iteration=iteration,
                hide=config.occlusion_radius is not None
                and self.frames >= config.unoccluded_frames,
                silhouettes=silhouettes,
                number=number,
            )

    def calculate_gradient_and_hessian(
        self,
        T_camera_centre: Transform,
        *,
        update: int,
        gradient: Float64[np.ndarray, 6],
        hessian: Float64[np.ndarray, "6 6"],
    ) -> None:
        """Add every modality's part to the gradient and the lower half of the negative Hessian."""
        if self.region is not None:
            self.region.calculate_gradient_and_hessian(
                T_camera_centre, update=update, gradient=gradient, hessian=hessian
            )
        if self.depth is not None:
            self.depth.calculate_gradient_and_hessian(
                T_camera_centre, gradient=gradient, hessian=hessian
            )

    def evidence(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        tolerance: float,
        silhouettes: Silhouettes,
        number: int,
    ) -> Evidence:
        """Return what the picture says of a pose; a modality that is not used says nothing."""
        views = self.model.views(T_camera_centre)
        contrast, fit, measured, gap = 0.0, 0.0, False, None
        seen: list[float] = []
        if self.region is not None:
            contrast, share = self.region.evidence(
                rgb,
                T_camera_centre,
                views=views,
                depth=depth,
                silhouettes=silhouettes,
                number=number,
            )
            seen.append(share)
        if self.depth is not None:
            fit, share = self.depth.evidence(
                depth,
                T_camera_centre,
                views=views,
                tolerance=tolerance,
                silhouettes=silhouettes,
                number=number,
            )
            measured = share > 0
            gap = self.depth.gap(depth, T_camera_centre, views=views)
            seen.append(share)
        alike = None
        if self.colors is not None and self.frames:  # a pose is like the one it was begun at
            alike = self.colors.alike(
                rgb,
                depth,
                T_camera_centre,
                views=views,
                silhouettes=silhouettes,
                number=number,
            )
        visible = float(np.mean(seen)) if seen else 0.0
        return Evidence(contrast, fit, visible, alike, measured, gap)

    def close_fit(self, depth: MaybeDepth, T_camera_centre: Transform, tolerance: float) -> float:
        """Share of the seen surface points that depth fits within a tolerance, metres; 0 without."""
        if self.depth is None:
            return 0.0
        fit, _ = self.depth.evidence(
            depth,
            T_camera_centre,
            views=self.model.views(T_camera_centre),
            tolerance=tolerance,
            silhouettes=NO_SILHOUETTES,
            number=0,
        )
        return fit

    def learn(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        silhouettes: Silhouettes,
        number: int,
        region: int,
    ) -> None:
        """Take the colours of the pose that a frame ended with."""
        views = self.model.views(T_camera_centre)
        if self.region is not None:
            self.region.learn(
                rgb,
                T_camera_centre,
                views=views,
                rate=self.region.config.histogram_rate,
                depth=self._occluders(depth),
                silhouettes=silhouettes,
                region=region,
            )
        if self.colors is not None:
            self.colors.learn(
                rgb,
                depth,
                T_camera_centre,
                views=views,
                silhouettes=silhouettes,
                number=number,
            )
        self.frames += 1

    def _occluders(self, depth: MaybeDepth) -> MaybeDepth:
        """The depth image if the region modality is to ask it for occluders by now."""
        if self.region is None or self.region.config.occlusion_radius is None:
            return NO_DEPTH
        return depth if self.frames >= self.region.config.unoccluded_frames else NO_DEPTH
