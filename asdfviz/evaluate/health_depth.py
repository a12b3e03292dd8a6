"""Checks on the depth images alone: a plausible unit, and how much of them is missing."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Rows

import cv2
import numpy as np

from asdfviz.datatypes import Frame
from asdfviz.evaluate.health_camera import LIKELY_DISTANCE
from asdfviz.evaluate.health_report import Finding
from asdfviz.geometry.shapes import Depth, Mask

NEAREST, FARTHEST = 0.1, 10.0
"""Metres. RGB-D cameras measure neither nearer nor, at a table, farther."""
MANY_HOLES = 0.1
"""Share within the depth camera's view; an Azure Kinect leaves 3 % on a table with dark parts."""
WIDE_RIM = 0.55
"""Share outside its view; 42 % is natural for an Azure Kinect in its narrow mode."""


def median_depth(frames: Rows[Frame]) -> float | None:
    """Median of everything measured, metres; None where nothing was."""
    values = [
        frame.depth[::4, ::4][frame.depth[::4, ::4] > 0]
        for frame in frames
        if frame.depth is not None
    ]
    measured = np.concatenate(values) if values else np.empty(0)
    return float(np.median(measured)) if len(measured) else None


def check_distance(frames: Rows[Frame]) -> Iterator[Finding]:
    """Look at the median depth: a wrong unit puts the scene at half a millimetre or at 500 m."""
    median = median_depth(frames)
    if median is None or NEAREST <= median <= FARTHEST:
        return
    factors = (1e-3, 1e-2, 1e-1, 0.125, 0.2, 0.25, 1e1, 1e2, 1e3)
    fitting = [f for f in factors if LIKELY_DISTANCE[0] <= median * f <= LIKELY_DISTANCE[1]]
    advice = (
        f"Multiply depth_scale (millimetres per unit) by {fitting[-1]:g}."
        if fitting
        else "Set depth_scale to the millimetres that one unit of the depth images stands for."
    )
    yield Finding(
        "depth_unit",
        "error",
        f"The median depth is {median:.3g} m, which no table-top camera measures: the depth unit "
        f"is wrong. {advice}",
        median,
    )


def check_far(frames: Rows[Frame]) -> Iterator[Finding]:
    """Say so where the scene is farther than a table, as ten times too far; parts of a known size tell more."""
    median = median_depth(frames)
    if median is not None and LIKELY_DISTANCE[1] < median <= FARTHEST:
        yield Finding(
            "depth_unit",
            "info",
            f"The median depth is {median:.3g} m, far for a table. If the scene is nearer, set "
            f"depth_scale (millimetres per unit): with a tenth of it, it is {median / 10:.2g} m.",
            median,
        )


def check_missing_depth(frames: Rows[Frame]) -> Iterator[Finding]:
    """Report the share of pixels without depth, apart for the depth camera's blind rim."""
    depths = [frame.depth for frame in frames if frame.depth is not None]
    if not depths:
        yield Finding(
            "missing_depth",
            "warning",
            "There is no depth image at all (100 % missing): poses rest on colour alone. Put "
            "16-bit PNGs named as the colour images into depth/.",
            1.0,
        )
        return
    missing = float(np.mean([np.mean(depth <= 0) for depth in depths]))
    if missing == 1.0:
        yield Finding(
            "missing_depth",
            "warning",
            f"All depth pixels are 0 in all {len(depths)} depth images looked at (100 % missing): no "
            "depth was recorded, and poses rest on colour alone. Record or convert the depth again.",
            1.0,
        )
        return
    rim = float(np.mean(_blind_rim(depths)))
    inside = max(missing - rim, 0.0) / max(1.0 - rim, 1e-9)
    parts = f"{100 * missing:.1f} % of the depth pixels hold no measurement"
    if rim > 0.005:
        parts += (
            f" ({100 * rim:.1f} % outside the depth camera's view, {100 * inside:.1f} % holes "
            "within it)"
        )
    advice = ""
    if inside > MANY_HOLES:
        advice = " So many holes come from dark or shiny surfaces, or from too near or far a table."
    elif rim > WIDE_RIM:
        advice = " Keep the work within the depth camera's view, or use its wide mode."
    yield Finding("missing_depth", "warning" if advice else "info", f"{parts}.{advice}", missing)


def _blind_rim(depths: Rows[Depth]) -> Mask:
    """Pixels that no frame measures and that hang together with the image's border."""
    same = [depth for depth in depths if depth.shape == depths[0].shape]
    never = np.all(np.stack([depth <= 0 for depth in same]), axis=0).astype(np.uint8)
    labels = np.asarray(cv2.connectedComponents(never, connectivity=4)[1], dtype=np.int32)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return np.isin(labels, edge[edge > 0])
