"""How probably a tracked pose is right: what fits the picture by so much mostly is, and what a state holds more so.

Not in the paper. A tracker's score says how well contours and depth agree. Of held gears of a hidden base that
score 0.05 nine in ten are right, of loose parts that score so one in five.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from asdfviz.datatypes import PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.odds import log_odds, probability

CLIPPED = 0.02
"""Scores nearer to 0 or 1 than this are alike."""


@dataclass(frozen=True)
class TrackConfidenceConfig:
    """From log odds of a score to those of the pose, by a logistic model.

    Fitted on eight synthetic sequences (the paper's assemblies, seeds 0 and 85), each weighing the same; right
    is ADD(S) below a tenth of the diameter, on either twin.
    """

    enabled: bool = True
    """Whether scores are probabilities; else they are how well poses fit."""
    bias: float = 1.25
    """Log odds of a loose part that scores 0.5,"""
    weight: float = 0.97
    """and per log odds of its score;"""
    held_bias: float = 3.08
    """the same of a part that the state holds,"""
    held_weight: float = 0.57
    """which says less of it."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a weight is no number or out of its range."""
        if not all(map(math.isfinite, (self.bias, self.held_bias))):
            raise MethodError(
                f"confidence.bias is {self.bias:g} and held_bias {self.held_bias:g}: use finite numbers"
            )
        if not (0 <= self.weight < math.inf and 0 <= self.held_weight < math.inf):
            raise MethodError(
                f"confidence.weight is {self.weight:g} and held_weight {self.held_weight:g}: use 0 or more, finite"
            )


def as_probabilities(
    poses: Mapping[str, PoseEstimate], *, config: TrackConfidenceConfig
) -> dict[str, PoseEstimate]:
    """The poses, each scored by how probably it is right.

    Args:
        poses: by part; those of stage "group" are held.
        config: the model.
    """
    if not config.enabled:
        return dict(poses)
    told: dict[str, PoseEstimate] = {}
    for name, pose in poses.items():
        fits = log_odds(pose.score, least=CLIPPED)
        held = pose.stage == "group"
        odds = config.held_bias if held else config.bias
        odds += (config.held_weight if held else config.weight) * fits
        told[name] = replace(pose, score=probability(odds))
    return told
