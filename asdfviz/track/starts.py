"""Several starts for one part: each is settled by the optimiser, and the picture judges them.

A tracker that moves from one pose alone is lost for good once the part moved too far. From several
starts (where the part was, where it was heading, where a detector sees it) the best fit is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.geometry.shapes import Rgb, Transform
from asdfviz.track.confidence import Evidence
from asdfviz.track.modalities import Modalities
from asdfviz.track.optimizer import Group
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.visibility import NO_SILHOUETTES, MaybeDepth


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Where a start ended, and what the picture says of that pose."""

    T_camera_part: Transform
    evidence: Evidence
    confidence: float
    """Probability, 0 to 1, that it is near the truth."""
    sharp: float = 0.0
    """Share of the seen surface points that depth fits closely, 0 to 1."""

    @property
    def detail(self) -> float:
        """For choosing between trials that look alike and end in one place, about 0 to 1.

        The colours were learnt at one of them, which they then favour, be it wrong: they count little.
        """
        return self.sharp + 0.2 * self.evidence.contrast

    @property
    def score(self) -> float:
        """For choosing between trials of one part: what fits counts as far as it can be seen.

        About 2 at a right pose in full view, 0 where all is hidden, negative where the picture
        speaks against it. Depth fits a flat part wherever it lies flat, so it counts no more than
        the colours at the contour do; those of the surface count half as much as they, where known.
        """
        return self._scored(self.evidence.fit)

    @property
    def sharp_score(self) -> float:
        """The same where only what depth fits closely counts: lower, and tells turns apart."""
        return self._scored(self.sharp)

    def _scored(self, fit: float) -> float:
        seen = self.evidence
        alike = seen.contrast if seen.alike is None else seen.alike
        return seen.visible * (0.5 * (seen.contrast + alike) + 2.0 * min(fit, seen.contrast) - 1.0)


def settle(
    modalities: Modalities,
    rgb: Rgb,
    depth: MaybeDepth,
    T_camera_centre: Transform,
    *,
    config: TrackerConfig,
    rounds: int,
) -> Transform:
    """Optimise one part's pose alone, from a start, by so many correspondence searches."""
    group = Group(0, (), config.optimizer)
    Ts = T_camera_centre[None].copy()
    for iteration in range(rounds):
        modalities.calculate_correspondences(
            rgb,
            depth,
            Ts[0],
            iteration=iteration,
            silhouettes=NO_SILHOUETTES,
            number=0,
            region=0,
        )
        for update in range(config.update_iterations):
            gradient, hessian = np.zeros((1, 6)), np.zeros((1, 6, 6))
            modalities.calculate_gradient_and_hessian(
                Ts[0], update=update, gradient=gradient[0], hessian=hessian[0]
            )
            group.step(Ts, gradient, hessian)
    return Ts[0]
