"""Whether a tracked pose still fits the picture: a probability a part and frame, from what is seen.

The optimiser always has an answer; this module judges it afterwards, at the final pose, by three
plain questions. Do the colours change at the contour the way the histograms say? Is there measured
surface where the model has it? Are the colours of that surface those that the part had? Points that
something nearer hides are left out of all and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, no_type_check

import numpy as np

from asdfviz.track.jit import kernel
from asdfviz.track.region_kernels import place, posterior
from asdfviz.track.visibility import id_at, pixel_of

INSIDE_PX = (1.5, 3.0, 4.5)
"""Distances from the contour, on both sides, at which colours are asked, pixels."""
HIDDEN_BY = 0.02
"""Measured depth nearer than the model by more than this (metres) hides the point."""


class Evidence(NamedTuple):
    """What the picture says of one pose."""

    contrast: float
    """Mean probability of foreground inside the contour minus that outside, as a share of what the
    histograms have; about 1 where it fits, 0 unseen."""
    fit: float
    """Share of the seen surface points with measured depth within the tolerance, 0 to 1; 0 unseen."""
    visible: float
    """Share of the model's points that nothing hides, 0 to 1."""
    alike: float | None = None
    """How like the colours of the seen surface are to those known of the part, 0 to 1; None where too
    little is seen, or nothing is known but the frame in which it was begun."""
    measured: bool = True
    """Whether depth was measured on the surface at all; where not, fit says nothing."""
    gap: float | None = None
    """How far the measured surface is behind the part's in the middle, hidden or not, metres; None where
    too little is measured."""


@dataclass(frozen=True, slots=True)
class ConfidenceConfig:
    """A logistic judgement of the evidence.

    The weights are logistic fits of ADD below 5 % of the diameter against ADD above 10 %. Those for
    colour: 29,000 poses of the parts of four assemblies in twenty rendered sequences, eight
    of them with hands, where a tracker had kept or lost them; fitted on three assemblies they tell the
    fourth's apart behind hands with an AUC of 0.98 to 0.99, and where all is in sight and what is
    wrong is mostly a small part turned round with 0.90. A part that lies flat fits the table by depth,
    and a part of one colour its neighbour by colour, so the weaker of contour and depth counts. That
    for depth alone: 3873 poses of five rendered parts, a bar before half of them. Where the true pose
    is only a little wrong, or looks alike from another side, it cannot know.
    """

    tolerance: float = 0.06
    """Depth that still fits, as a share of the part's reach from its centre, at least 4 mm."""
    color: tuple[float, float, float] = (3.6, 5.3, -0.4)
    """Where there is colour: weights of the logarithm of the weaker of contrast and fit (of the contrast
    where no depth was measured), at least 0.02, and of how like the colours of the surface are to those
    known, and log-odds at a perfect contour of colours that are not alike at all. Of poses with a
    quarter of either or less hardly any was right, whatever the colours. Colours alone hardly see a
    tracker drift along the viewing ray."""
    depth: tuple[float, float] = (12.7, -4.5)
    """Weight of the fit and log-odds without, where there is depth alone."""
    least_visible: float = 0.15
    """Visible share below which the evidence is too little; confidence falls to 0 with it."""
    lost_below: float = 0.2
    """A part whose confidence is lower counts as lost."""
    sharp: float = 3e-3
    """Depth that fits where poses are compared that fit about as well, metres. Rendered parts that lay
    still were settled in wrong turns, their colours learnt there, and compared with the right ones in
    single frames: of 96 pairs of four parts of a vise depth told all, 2 mm and 4 mm nearly so, colours
    56 %; of two other parts 65 and 88 %, and of one whose lobes look alike neither told anything."""


def confidence(
    evidence: Evidence, config: ConfidenceConfig, *, has_color: bool, has_depth: bool
) -> float:
    """Probability that the pose is near the truth, 0 to 1."""
    alike = evidence.contrast if evidence.alike is None else evidence.alike
    if has_color:
        asks_depth = has_depth and evidence.measured
        weaker = min(evidence.contrast, evidence.fit) if asks_depth else evidence.contrast
        first, second, offset = config.color
        logit = first * np.log(min(max(weaker, 0.02), 1.0)) + second * alike + offset
    else:
        logit = config.depth[0] * evidence.fit + config.depth[1]
    enough = min(1.0, evidence.visible / config.least_visible)
    return float(enough / (1 + np.exp(-logit)))


def depth_tolerance(config: ConfidenceConfig, reach: float) -> float:
    """Depth that still fits a part of that reach from its centre, metres."""
    return max(4e-3, config.tolerance * reach)


@kernel
@no_type_check
def contour_evidence(
    image, table, bits, points, count, T, lens, depth, distances, hidden_by, ids, crop, own
):
    """Return (mean contrast, share of contour points that are seen) at pose T.

    A point counts as hidden where the measured depth just inside of it is nearer by `hidden_by`.
    """
    height, width = image.shape[0], image.shape[1]
    at = np.empty(5)
    total, seen = 0.0, 0
    for k in range(count):
        if not place(points[k], T, lens, at):
            continue
        n = 0
        difference = 0.0
        hidden = False
        for distance in distances:
            u_in, v_in = int(at[0] - distance * at[3] + 0.5), int(at[1] - distance * at[4] + 0.5)
            u_out, v_out = int(at[0] + distance * at[3] + 0.5), int(at[1] + distance * at[4] + 0.5)
            if min(u_in, u_out) < 0 or min(v_in, v_out) < 0:
                continue
            if max(u_in, u_out) >= width or max(v_in, v_out) >= height:
                continue
            if depth.size > 0 and 0.0 < depth[v_in, u_in] < at[2] - hidden_by:
                hidden = True
            if ids.size > 0 and id_at(ids, crop, u_in, v_in) != own:
                hidden = True
            difference += posterior(image, table, bits, u_in, v_in)
            difference -= posterior(image, table, bits, u_out, v_out)
            n += 1
        if n > 0 and not hidden:
            total += difference / n
            seen += 1
    return (total / seen if seen > 0 else 0.0), seen / max(count, 1)


@kernel
@no_type_check
def surface_evidence(depth, points, count, T, lens, tolerance, hidden_by, ids, crop, own):
    """Return (share of seen points whose measured depth fits, share that is seen) at pose T.

    Pixels without measured depth say nothing and count as neither.
    """
    height, width = depth.shape
    fitting, seen, asked = 0, 0, 0
    for k in range(count):
        u, v, z = pixel_of(points[k], T, lens, width, height)
        if z <= 0.0 or depth[v, u] <= 0.0:
            continue
        asked += 1
        if depth[v, u] < z - hidden_by or (ids.size > 0 and id_at(ids, crop, u, v) != own):
            continue
        seen += 1
        if abs(depth[v, u] - z) < tolerance:
            fitting += 1
    return (fitting / seen if seen > 0 else 0.0), seen / max(asked, 1)


@kernel
@no_type_check
def depth_gaps(depth, points, count, T, lens):
    """Return how far measured depth lies behind the first `count` points at pose T, metres.

    Points outside of the image and without measured depth are left out.
    """
    height, width = depth.shape
    gaps = np.empty(count)
    n = 0
    for k in range(count):
        u, v, z = pixel_of(points[k], T, lens, width, height)
        if z > 0.0 and depth[v, u] > 0.0:
            gaps[n] = depth[v, u] - z
            n += 1
    return gaps[:n]
