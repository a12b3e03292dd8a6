"""From how well a pose fits to how probably it is right: a logistic model, so that loss can be told.

Right is ADD(S) below a tenth of the part's diameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ConfidenceConfig:
    """Weights of the logistic model.

    Fitted on 2,689 poses of four synthetic sequences of three assemblies that no table judges (vise,
    geared caliper twice, corner clamp; 640x360), with a ridge, since the witnesses say much the same.
    What is visible of the part adds nothing to them.
    """

    bias: float = -7.95
    """Log odds of a pose that nothing speaks for."""
    trust: float = 2.4
    """Per agreement over time, 0 to 1."""
    lead: float = 0.84
    """Per lead over the next best pose, 0 to 1."""
    agreeing: float = 4.97
    """Per share of the visible depth readings on the surface, 0 to 1."""
    outline: float = 2.13
    """Per overlap of the projected box with the detected one, 0 to 1."""
    detection: float = 4.21
    """Per score of the detected box, 0 to 1."""
    undetected: float = 1.84
    """Where there is no box, of which outline and detection say nothing then."""


def confidence(
    *,
    trust: float,
    lead: float,
    agreeing: float,
    outline: float,
    detection: float | None,
    config: ConfidenceConfig,
) -> float:
    """Probability that a pose is right.

    Args:
        trust: agreement over time, 0 to 1.
        lead: over the next best pose, 0 to 1.
        agreeing: share of the visible depth readings on the surface, 0 to 1.
        outline: overlap of boxes, 0 to 1.
        detection: score of the box, 0 to 1; None where there was none.
        config: weights.
    """
    odds = config.bias + config.trust * trust + config.lead * lead + config.agreeing * agreeing
    if detection is None:
        odds += config.undetected
    else:
        odds += config.outline * outline + config.detection * detection
    return 1 / (1 + math.exp(-odds))
