"""Probabilities from log odds."""

from __future__ import annotations

import math


def probability(log_odds: float) -> float:
    """The logistic function, 0 to 1."""
    return 1.0 / (1.0 + math.exp(-log_odds))
