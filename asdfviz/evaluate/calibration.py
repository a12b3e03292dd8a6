"""Whether a method knows when it is wrong: calibration of states, and scores of poses as a warning.

Pure functions of (confidence, was right) pairs. Percent, None where nothing is there to be judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Judged = Sequence[tuple[float, bool]]
"""How sure something was said, 0 to 1, and whether it was right."""

BINS = 15
"""As many as in Guo et al., "On Calibration of Modern Neural Networks" (ICML 2017)."""


@dataclass(frozen=True, slots=True)
class Bin:
    """What was said with about the same confidence."""

    count: int
    confidence: float
    """Mean, 0 to 1."""
    accuracy: float
    """Share that was right, 0 to 1."""


def reliability(judged: Judged, *, bins: int = BINS) -> tuple[Bin, ...]:
    """Sort into equal bins ((m - 1) / M, m / M] of confidence; empty ones are left out."""
    sorted_in: dict[int, list[tuple[float, bool]]] = {}
    for confidence, right in judged:
        place = min(max(int(np.ceil(confidence * bins)) - 1, 0), bins - 1)
        sorted_in.setdefault(place, []).append((confidence, right))
    return tuple(
        Bin(
            count=len(members),
            confidence=float(np.mean([confidence for confidence, _ in members])),
            accuracy=float(np.mean([right for _, right in members])),
        )
        for _, members in sorted(sorted_in.items())
    )


def calibration_error(judged: Judged, *, bins: int = BINS) -> float | None:
    """Expected calibration error: mean gap between confidence and accuracy, weighted by count."""
    if not judged:
        return None
    gaps = (b.count * abs(b.accuracy - b.confidence) for b in reliability(judged, bins=bins))
    return 100.0 * sum(gaps) / len(judged)


def ranking_area(judged: Judged) -> float | None:
    """Area under the ROC curve of confidence as a flag for what is right; ties count half."""
    right = np.array([is_right for _, is_right in judged], dtype=bool)
    good, bad = int(right.sum()), int((~right).sum())
    if not good or not bad:
        return None
    _, place, counts = np.unique(
        [confidence for confidence, _ in judged], return_inverse=True, return_counts=True
    )
    # Equal confidences share the mean of their ranks.
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[place]
    return 100.0 * float(ranks[right].sum() - good * (good + 1) / 2) / (good * bad)
