"""Whole sets of tracking parameters, as their papers give them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from asdfviz.errors import InputError
from asdfviz.track.confidence import ConfidenceConfig
from asdfviz.track.depth_modality import DepthConfig
from asdfviz.track.optimizer import OptimizerConfig
from asdfviz.track.region_modality import RegionConfig
from asdfviz.track.surface_colors import SurfaceColorsConfig


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """What evidence is used, how often, and how cautiously; defaults are ICG's for YCB-Video."""

    region: RegionConfig | None = field(default_factory=RegionConfig)
    """None = no colour."""
    depth: DepthConfig | None = field(default_factory=DepthConfig)
    """None = no depth."""
    colors: SurfaceColorsConfig = field(default_factory=SurfaceColorsConfig)
    """How the colours of a surface are kept, where there is colour."""
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)
    correspondence_iterations: int = 4
    update_iterations: int = 2
    """After each search for correspondences."""
    silhouettes: bool = False
    """Draw all parts before every search, and leave out what another part hides and contours
    between parts of like colour."""
    silhouettes_loose: bool = True
    """Whether parts that nothing holds are drawn and asked besides."""
    silhouette_px: int = 200
    """Largest side of that drawing."""
    like_colors: float = 40.0
    """Parts whose colours (sRGB, 0 to 255) are nearer than this show no contour between them."""

    def __post_init__(self) -> None:
        """Raise an InputError where the drawing would have no pixels."""
        if self.silhouette_px < 2:
            raise InputError(f"silhouette_px is {self.silhouette_px}: use 2 or more pixels")


RBOT_REGION = TrackerConfig(
    region=RegionConfig(
        scales=(5, 2, 2, 1),
        sigmas_px=(20.0, 7.0, 3.0, 1.5),
        amplitude=0.36,
        slope=0.0,
        histogram_bins=32,
        occlusion_radius=None,
    ),
    depth=None,
    correspondence_iterations=7,
)
"""SRT3D's settings for the RBOT data set, as M3T runs them."""

YCB_DEPTH = TrackerConfig(region=None)
"""ICG's depth modality alone."""

YCB_ICG = TrackerConfig()
"""ICG for YCB-Video: region and depth."""

GBOT = TrackerConfig(
    region=RegionConfig(
        lines=300, adaptive_coverage=True, scales=(9, 7, 5, 2), occlusion_radius=None
    ),
    depth=DepthConfig(
        points=300,
        adaptive_coverage=True,
        considered_distances=(0.1, 0.08, 0.05),
        stride=0.008,
        scale_by_depth=True,
        occlusion_radius=None,
    ),
    optimizer=OptimizerConfig(rotation=100.0, translation=1000.0),
    correspondence_iterations=6,
    silhouettes=True,
)
"""The settings of GBOT's evaluator, which are M3T's for assemblies."""

FINE_DEPTH = DepthConfig(
    considered_distances=(0.07, 0.05, 0.03, 0.02, 0.01, 0.008),
    sigmas=(0.05, 0.04, 0.03, 0.02, 0.02, 0.015, 0.01),
    stride=0.003,
    unoccluded_frames=0,
)
"""Of `FINE`."""

FINE = TrackerConfig(
    region=RegionConfig(
        scales=(5, 2, 2, 1),
        sigmas_px=(20.0, 7.0, 3.0, 1.5),
        amplitude=0.36,
        slope=0.0,
        unoccluded_frames=0,
    ),
    depth=FINE_DEPTH,
    correspondence_iterations=7,
)
"""Our own, for hand-sized parts on a table: SRT3D's sharp contours, and depth that starts as wide as
ICG for YCB and ends finer. ICG's last 40 mm let such a part match the table beside it, which turns
it by ten degrees; and without the test for occlusion from the first frame on, it follows a hand."""

FOLLOWED_DEPTH = replace(
    FINE_DEPTH, edge_px=3.0, sigmas=(0.05, 0.04, 0.03, 0.02, 0.015, 0.01, 0.005)
)
"""For parts that are followed from frame to frame. With its edges a part of 40 px is measured 4 mm too deep,
as sensors draw what lies behind over them; a single frame's fit needs them for turns. What is measured inside
is more exact, and holds a flat part level, which contours let tilt."""

FOLLOWED = replace(
    FINE, depth=FOLLOWED_DEPTH, silhouettes=True, silhouettes_loose=False, silhouette_px=400
)
"""`FINE` for these. What one joined part hides of another is not asked there, or its surface would draw
that one on; a loose one hides nothing, since where it was lost, it would hide what is right."""

PROPOSED = replace(FOLLOWED, colors=SurfaceColorsConfig(choose=False))
"""The same for parts that a detector began, which may have taken another thing for them."""

PRESETS = {
    "region": RBOT_REGION,
    "depth": YCB_DEPTH,
    "icg": YCB_ICG,
    "gbot": GBOT,
    "fine": FINE,
}
