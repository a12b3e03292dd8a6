"""From how well a pose fits to how probably it is right: a logistic model, so that loss can be told.

Right is ADD(S) below a tenth of the part's diameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ConfidenceConfig:
    """Weights of the logistic model."""

    bias: float = -6.0
    """Log odds of a pose that nothing speaks for."""
    depth: float = 4.0
    """Per share of depth readings on the surface, 0 to 1."""
    outline: float = 3.0
    """Per overlap of the projected box with the detected one, 0 to 1."""
    registered: float = 1.0
    """Per share of measured points with a partner on the surface, 0 to 1."""
    residual: float = -200.0
    """Per metre of their root mean square distance."""
    detection: float = 2.0
    """Per score of the first pose, 0 to 1."""


def confidence(
    *,
    depth: float,
    outline: float,
    registered: float,
    residual: float,
    detection: float,
    config: ConfidenceConfig,
) -> float:
    """Probability that a pose is right.

    Args:
        depth: share of depth readings on the surface, 0 to 1.
        outline: overlap of boxes, 0 to 1.
        registered: share of measured points near the surface, 0 to 1; 0 without registration.
        residual: their root mean square distance, metres.
        detection: score of the first pose, 0 to 1; 0 where there was none.
        config: weights.
    """
    odds = (
        config.bias
        + config.depth * depth
        + config.outline * outline
        + config.registered * registered
        + config.residual * residual
        + config.detection * detection
    )
    return 1 / (1 + math.exp(-odds))
