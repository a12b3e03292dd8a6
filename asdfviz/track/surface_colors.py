"""Which colours a part shows where it is surely seen, kept apart from what its tracker goes on learning.

The histograms along the contour follow the picture, and so forget the part once it is lost: they learn
what lies there instead. These colours are those of the whole visible surface at the start, and later
ones are blended in only where they hardly differ. Of poses of four assemblies that a tracker had
kept or lost behind hands they tell right from wrong by themselves with an AUC of 0.97 to 0.99, contour
and depth with 0.89.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, no_type_check

import numpy as np

from asdfviz.geometry.shapes import Rgb, Scores, Transform
from asdfviz.track.jit import kernel
from asdfviz.track.view_choice import gather
from asdfviz.track.viewpoint_model import ViewpointModel, Views
from asdfviz.track.visibility import MaybeDepth, Silhouettes, id_at

BINS = 16
"""A channel. A colour counts in the bins around it, as near as it is to each: a little more light must
not move all of an even surface into other bins."""


@dataclass(frozen=True, slots=True)
class SurfaceColorsConfig:
    """How the colours of a surface are kept."""

    points: int = 200
    """Surface points whose pixels are asked."""
    least: int = 12
    """Fewer that can be seen tell nothing."""
    rate: float = 0.2
    """Weight of a frame, where the light may have changed a little:"""
    same: float = 0.85
    """only what is at least so much alike is blended in, 0 to 1."""
    choose: bool = True
    """Whether they help to choose between trials of a part. Not where it may have been begun on another
    thing, whose colours would hold it there."""


class SeenColors(NamedTuple):
    """Colours of what can be seen of a surface at a pose."""

    shares: Scores
    """Share of it a colour, sum 1."""
    visible: float
    """Share of the surface's points that can be seen, 0 to 1."""


class SurfaceColors:
    """Colours of one part's visible surface."""

    def __init__(self, model: ViewpointModel, lens: Scores, config: SurfaceColorsConfig) -> None:
        """Take the camera's (fu, fv, cu, cv) in pixels."""
        self.model = model
        self.config = config
        self.known: Scores | None = None
        """Share of the surface a colour; None until enough of it was seen."""
        self._lens = lens
        self._points = np.zeros((config.points, model.surfaces.shape[2]), np.float32)
        self._offsets = np.zeros(config.points, np.float32)

    def seen(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        views: Views,
        silhouettes: Silhouettes,
        number: int,
        hidden_by: float,
    ) -> SeenColors | None:
        """Colours of what can be seen of the surface at a pose; None where that is too little.

        Depth nearer by `hidden_by` (metres) hides a point, and silhouettes where the part's `number`
        does not show.
        """
        counts = np.zeros(BINS**3)
        asked = self._gather(views)
        count = count_surface(
            rgb,
            depth,
            self._points,
            asked,
            T_camera_centre,
            self._lens,
            hidden_by,
            silhouettes.ids,
            silhouettes.crop,
            number,
            counts,
        )
        return SeenColors(counts / count, count / asked) if count >= self.config.least else None

    def alike(self, seen: SeenColors | None) -> float | None:
        """How like the known colours these are (Bhattacharyya coefficient), 0 to 1; None if unknown.

        Half of a surface does not show all of its colours: at right poses the coefficient fell about as
        the cube root of the share that was seen, which is made up for.
        """
        if seen is None or self.known is None:
            return None
        return min(1.0, self._overlap(seen, self.known) / float(np.cbrt(seen.visible)))

    def learn(self, seen: SeenColors | None) -> None:
        """Blend colours in that hardly differ from the known ones; the first ones are taken as they are."""
        if seen is None:
            return
        if self.known is None:
            self.known = seen.shares
        elif self._overlap(seen, self.known) >= self.config.same:
            self.known = self.known + self.config.rate * (seen.shares - self.known)

    @staticmethod
    def _overlap(seen: SeenColors, known: Scores) -> float:
        return float(np.sqrt(seen.shares * known).sum())

    def _gather(self, views: Views) -> int:
        """Collect the surface points of the views; return how many."""
        model = self.model
        return gather(
            model.surfaces,
            model.surface_offsets,
            0,
            model.surface_areas,
            views.indices,
            views.shares,
            self.config.points,
            False,
            self._points,
            self._offsets,
        )


@kernel
@no_type_check
def count_surface(image, depth, points, count, T, lens, hidden_by, ids, crop, own, counts):
    """Count the colours of surface points that can be seen at pose T; return how many there are."""
    height, width = image.shape[0], image.shape[1]
    low, share = np.zeros(3, np.int64), np.zeros(3)
    seen = 0
    for k in range(count):
        p = points[k]
        z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
        if z <= 0.0:
            continue
        x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
        y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
        u, v = int(lens[0] * x / z + lens[2] + 0.5), int(lens[1] * y / z + lens[3] + 0.5)
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        if depth.size > 0 and 0.0 < depth[v, u] < z - hidden_by:
            continue
        if ids.size > 0 and id_at(ids, crop, u, v) != own:
            continue
        seen += 1
        for c in range(3):
            at = min(max(image[v, u, c] * (BINS / 256.0) - 0.5, 0.0), BINS - 1.001)
            low[c] = int(at)
            share[c] = at - low[c]
        for corner in range(8):
            weight, bin_ = 1.0, 0
            for c in range(3):
                upper = (corner >> c) & 1
                weight *= share[c] if upper else 1.0 - share[c]
                bin_ = bin_ * BINS + low[c] + upper
            counts[bin_] += weight
    return seen
