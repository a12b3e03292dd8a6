"""Frame numbers: by what step they rise, so that gaps can be told from sparse recordings, or if by a clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

_EPOCH = 10**9
"""More than any recording has frames; less than any time since 1970, in seconds or finer."""
_LEAST_TICKS = 10
"""Rises from which on a clock shows: frame times in whole milliseconds are 33 or 34 apart, not the same."""
_JITTER = 0.2
"""How far, as a share, such rises are off the middle one at most; a quarter of them is off by something."""


def usual_step(indices: Sequence[int]) -> int | None:
    """The most common difference of rising frame numbers, the least of equals; None of fewer than two."""
    steps = Counter(b - a for a, b in pairwise(indices))
    return min(steps, key=lambda step: (-steps[step], step), default=None)


def clock_rise(indices: Sequence[int]) -> int | None:
    """How far apart rising frame numbers are, in the middle, where they are times; None where they count frames."""
    rises = sorted(b - a for a, b in pairwise(indices))
    if not rises:
        return None
    middle = rises[len(rises) // 2]
    uneven = sum(0 < abs(rise - middle) <= _JITTER * middle for rise in rises)
    is_uneven = middle >= _LEAST_TICKS and 4 * uneven >= len(rises)
    return middle if is_uneven or indices[0] >= _EPOCH else None


def frame_counts(indices: Sequence[int]) -> dict[int, int]:
    """By rising frame number, how many frames after the first it is; frames that are missing count.

    A rise by the usual step, or where numbers are times by about the time between frames, is one frame.
    """
    rise = clock_rise(indices) or usual_step(indices) or 1
    counts = dict.fromkeys(indices[:1], 0)
    for before, index in pairwise(indices):
        counts[index] = counts[before] + max(1, (2 * (index - before) + rise) // (2 * rise))
    return counts
