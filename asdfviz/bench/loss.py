"""Which poses count as right and which as lost, to measure whether a score tells them apart."""

from __future__ import annotations

from collections.abc import Iterable

RIGHT_BELOW = 0.05
"""ADD as a share of the part's diameter below which a pose is right."""
LOST_ABOVE = 0.1
"""And above which it is lost; between both nothing is asked."""


def told_apart(poses: Iterable[tuple[float, float]]) -> list[tuple[float, bool]]:
    """(score, whether it is right) of the poses, given as (score, ADD by diameter)."""
    return [
        (score, share < RIGHT_BELOW)
        for score, share in poses
        if share < RIGHT_BELOW or share > LOST_ABOVE
    ]
