"""Tolerances of relative poses and loose parts, by how near the poses of a method are and what its scores say."""

from __future__ import annotations

from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.relative_pose import SCORED_BY_PROBABILITY, RelativePoseConfig

REGISTERED_PLACES = RelativePoseConfig(
    sigma_translation=0.02,
    doubted=1.0,
    in_place=SCORED_BY_PROBABILITY,
    wrong_rotations=0.9,
)
"""Of `asdf_plus`: narrower than ASDF's, as the poses are."""
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
