"""Tolerances of relative poses and loose parts, by how near the poses of a method are and what its scores say."""

from __future__ import annotations

from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.relative_pose import SCORED_BY_PROBABILITY, PlaceOdds, RelativePoseConfig

REGISTERED_PLACES = RelativePoseConfig(
    sigma_translation=0.02,
    doubted=1.0,
    in_place=PlaceOdds(offset=0.5, slope=3.5),
    wrong_rotations=0.9,
)
"""Of `asdf_plus`: narrower than ASDF's, as the poses are. Its scores tell whether a pose is right in all; of those
below 0.5 nine in ten still had the part within 30 mm of where it was, and nearly all others."""
TRACKED_PLACES = RelativePoseConfig(
    sigma_translation=0.012,
    sigma_rotation=0.3,
    doubted=1.0,
    in_place=SCORED_BY_PROBABILITY,
    wrong_rotations=0.9,
)
"""Of `asdf_track`: tracked poses are millimetres off, where detected ones are centimetres."""
SURELY_LOOSE = LatelyLooseConfig(found=0.9)
"""Of `asdf_plus`, whose scores are probabilities: a thing that is no part has up to 0.8 while the part is hidden."""
