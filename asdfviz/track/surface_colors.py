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
from asdfviz.track.confidence import HIDDEN_BY
from asdfviz.track.gathered_points import GatheredPoints
from asdfviz.track.jit import kernel
from asdfviz.track.viewpoint_model import ViewpointModel, Views
from asdfviz.track.visibility import MaybeDepth, Silhouettes, id_at, pixel_of

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


class SurfaceColors:
    """Colours of one part's visible surface.

    At any pose, depth that is nearer than the model hides a point, and silhouettes where the part's
    `number` does not show.
    """

    def __init__(self, model: ViewpointModel, lens: Scores, config: SurfaceColorsConfig) -> None:
        """Take the camera's (fu, fv, cu, cv) in pixels."""
        self.config = config
        self._known: Scores | None = None
        self._lens = lens
        self._surface = GatheredPoints(model, "surface", most=config.points)

    def forget(self) -> None:
        """Let the next colours that are learnt be the part's."""
        self._known = None

    def alike(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        views: Views,
        silhouettes: Silhouettes,
        number: int,
    ) -> float | None:
        """How like the known colours those at a pose are (Bhattacharyya coefficient), 0 to 1.

        Half of a surface does not show all of its colours: at right poses the coefficient fell about as
        the cube root of the share that was seen, which is made up for.

        Returns:
            None where nothing is known, or too little is seen.
        """
        if self._known is None:
            return None
        seen = self._seen(rgb, depth, T_camera_centre, views, silhouettes, number)
        if seen is None:
            return None
        return min(1.0, _overlap(seen.shares, self._known) / float(np.cbrt(seen.visible)))

    def learn(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        *,
        views: Views,
        silhouettes: Silhouettes,
        number: int,
    ) -> None:
        """Blend in the colours at a pose if they hardly differ from the known ones.

        The first ones are taken as they are, once enough is seen.
        """
        seen = self._seen(rgb, depth, T_camera_centre, views, silhouettes, number)
        if seen is None:
            return
        if self._known is None:
            self._known = seen.shares
        elif _overlap(seen.shares, self._known) >= self.config.same:
            self._known = self._known + self.config.rate * (seen.shares - self._known)

    def _seen(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        T_camera_centre: Transform,
        views: Views,
        silhouettes: Silhouettes,
        number: int,
    ) -> _Seen | None:
        """What can be seen of the surface; None where that is too little."""
        counts = np.zeros(BINS**3)
        asked = self._surface.gather(views)
        count = count_surface(
            rgb,
            depth,
            self._surface.points,
            asked,
            T_camera_centre,
            self._lens,
            HIDDEN_BY,
            silhouettes.ids,
            silhouettes.crop,
            number,
            counts,
        )
        return _Seen(counts / count, count / asked) if count >= self.config.least else None


class _Seen(NamedTuple):
    """Colours of what can be seen of a surface at a pose."""

    shares: Scores
    """Share of it a colour, sum 1."""
    visible: float
    """Share of the surface's points that can be seen, 0 to 1."""


def _overlap(shares: Scores, known: Scores) -> float:
    return float(np.sqrt(shares * known).sum())


@kernel
@no_type_check
def count_surface(image, depth, points, count, T, lens, hidden_by, ids, crop, own, counts):
    """Count the colours of surface points that can be seen at pose T; return how many there are."""
    height, width = image.shape[0], image.shape[1]
    low, share = np.zeros(3, np.int64), np.zeros(3)
    seen = 0
    for k in range(count):
        u, v, z = pixel_of(points[k], T, lens, width, height)
        if z <= 0.0:
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
