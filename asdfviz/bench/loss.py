"""Which poses count as right and which as lost, to measure whether a score tells them apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from asdfviz.evaluate.calibration import ranking_area

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


def loss_figures(
    told: Sequence[tuple[float, bool]], *, suffix: str = ""
) -> dict[str, float | int | None]:
    """Area under the ROC curve in percent (None without both kinds), and how many of each kind.

    Args:
        told: (score, whether it is right), as `told_apart` gives them.
        suffix: of the figures' names.
    """
    right = sum(is_right for _, is_right in told)
    return {
        f"loss_auc{suffix}": ranking_area(told),
        f"right{suffix}": right,
        f"lost{suffix}": len(told) - right,
    }
