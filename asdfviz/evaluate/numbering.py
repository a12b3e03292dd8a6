"""Frame numbers: by what step they rise, so that gaps can be told from sparse recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise


def usual_step(indices: Sequence[int]) -> int | None:
    """The most common difference of rising frame numbers, the least of equals; None of fewer than two."""
    steps = Counter(b - a for a, b in pairwise(indices))
    return min(steps, key=lambda step: (-steps[step], step), default=None)
