"""Probabilities from log odds, and back."""

from __future__ import annotations

import math


def probability(log_odds: float) -> float:
    """The logistic function, 0 to 1."""
    return 1.0 / (1.0 + math.exp(-log_odds))


def log_odds(p: float, *, least: float) -> float:
    """The inverse; probabilities nearer to 0 or 1 than `least`, which is above 0, count as that near."""
    p = min(max(p, least), 1.0 - least)
    return math.log(p / (1.0 - p))
