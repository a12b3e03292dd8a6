"""The points of a part that a pose shows: of the views around it, together in one buffer."""

from __future__ import annotations

from typing import Literal

import numpy as np

from asdfviz.track.view_choice import gather
from asdfviz.track.viewpoint_model import ViewpointModel, Views


class GatheredPoints:
    """Contour or surface points of one part."""

    def __init__(
        self,
        model: ViewpointModel,
        kind: Literal["contour", "surface"],
        *,
        most: int,
        radius: float | None = None,
        adaptive: bool = False,
    ) -> None:
        """Make room.

        Args:
            model: the part's views.
            kind: which of its points.
            most: so many, fewer where less of the part shows if `adaptive`.
            radius: of the test of measured occlusion, metres; None where it is not asked.
            adaptive: see there.
        """
        if kind == "contour":
            self._views = model.contours, model.contour_offsets, model.contour_lengths
        else:
            self._views = model.surfaces, model.surface_offsets, model.surface_areas
        self._column = int(np.argmin(np.abs(np.array(model.occlusion_radii) - (radius or 0.0))))
        self._most, self._adaptive = most, adaptive
        self.points = np.zeros((most, self._views[0].shape[2]), np.float32)
        """As the model has them; those gathered last come first."""
        self.offsets = np.zeros(most, np.float32)
        """How much nearer the part's own surface comes within the nearest radius known, metres."""

    def gather(self, views: Views) -> int:
        """Collect the points of the views; return how many."""
        points, offsets, sizes = self._views
        return gather(
            points,
            offsets,
            self._column,
            sizes,
            views.indices,
            views.shares,
            self._most,
            self._adaptive,
            self.points,
            self.offsets,
        )
