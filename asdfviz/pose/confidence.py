"""From how well a pose fits to how probably it is right: a logistic model, so that loss can be told.

Right is ADD(S) below a tenth of the part's diameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ConfidenceConfig:
    """Weights of the logistic model.

    Fitted on 677 poses of three synthetic sequences of the corner clamp that no table judges (seeds
    5, 502 and 503; with a ridge, since the two best witnesses say much the same), then scaled so
    that the mean probability there is the share of right poses.
    """

    bias: float = -3.5
    """Log odds of a pose that nothing speaks for."""
    trust: float = 1.4
    """Per agreement over time, 0 to 1."""
    lead: float = 3.5
    """Per lead over the next best pose, 0 to 1."""
    agreeing: float = 2.0
    """Per share of the visible depth readings on the surface, 0 to 1."""
    visible: float = 0.8
    """Per share of readings that nothing nearer hides, 0 to 1."""
    outline: float = 0.6
    """Per overlap of the projected box with the detected one, 0 to 1."""
    detection: float = 1.0
    """Per score of the detected box, 0 to 1."""


def confidence(
    *,
    trust: float,
    lead: float,
    agreeing: float,
    visible: float,
    outline: float,
    detection: float,
    config: ConfidenceConfig,
) -> float:
    """Probability that a pose is right.

    Args:
        trust: agreement over time, 0 to 1.
        lead: over the next best pose, 0 to 1.
        agreeing: share of the visible depth readings on the surface, 0 to 1.
        visible: share of readings that nothing nearer hides, 0 to 1.
        outline: overlap of boxes, 0 to 1.
        detection: score of the box, 0 to 1; 0 where there was none.
        config: weights.
    """
    odds = (
        config.bias
        + config.trust * trust
        + config.lead * lead
        + config.agreeing * agreeing
        + config.visible * visible
        + config.outline * outline
        + config.detection * detection
    )
    return 1 / (1 + math.exp(-odds))
