"""The peaks of a distribution over rotations, found in a compiled loop."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.jit import kernel
from asdfviz.geometry.rotation_grid import MEANS, Quaternions
from asdfviz.geometry.shapes import Scores

FAINTEST = 0.003
"""Peaks lower than this share of the highest are none."""


def modes(
    probabilities: Scores, grid: Quaternions, *, count: int, reach: float
) -> tuple[Quaternions, Float64[np.ndarray, "_"]]:
    """The separate peaks of a distribution over a grid, each the mean of its surroundings.

    A peak's mean lies between the grid's rotations and is finer than its spacing.

    Args:
        probabilities: of the grid's rotations.
        grid: `even_rotations`.
        count: how many peaks at most.
        reach: radius of a peak's surroundings, radians; they are used up by it.

    Returns:
        Rotations, most probable first, and the probability of each one's surroundings.
    """
    enough = FAINTEST * float(probabilities.max())
    columns = np.ascontiguousarray(grid.T)
    rotations, weights = _peaks(probabilities, columns, count, np.cos(reach / 2), enough)
    order = np.argsort(weights)[::-1]
    return rotations[order], weights[order]


@kernel
@no_type_check
def _mean(left, grid, product, least, mean):
    """Move `mean` to that of its surroundings; returns their weight."""
    for i in range(len(left)):
        product[i] = (
            grid[0, i] * mean[0]
            + grid[1, i] * mean[1]
            + grid[2, i] * mean[2]
            + grid[3, i] * mean[3]
        )
    weight, length, total = 0.0, 0.0, np.zeros(4)
    for i in range(len(left)):
        if abs(product[i]) >= least and left[i] > 0.0:
            weight += left[i]
            signed = left[i] if product[i] > 0.0 else -left[i]
            for k in range(4):
                total[k] += signed * grid[k, i]
    for k in range(4):
        length += total[k] ** 2
    for k in range(4):
        mean[k] = total[k] / np.sqrt(length)
    return weight


@kernel
@no_type_check
def _peaks(probabilities, grid, count, least, enough):
    """The highest peaks one after the other, each using up its surroundings: means and their weights.

    Args:
        probabilities: of the grid's rotations.
        grid: their quaternions, (4, n).
        count: so many peaks at most.
        least: |<q, p>| of a rotation with the peak from which it belongs to it.
        enough: a peak that is lower is none.
    """
    left, product = probabilities.copy(), np.empty(len(probabilities))
    rotations, weights, mean = np.empty((count, 4)), np.empty(count), np.empty(4)
    for found in range(count):
        highest = np.argmax(left)
        if left[highest] <= enough:
            return rotations[:found], weights[:found]
        for k in range(4):
            mean[k] = grid[k, highest]
        for _ in range(MEANS):
            weights[found] = _mean(left, grid, product, least, mean)
        for i in range(len(left)):
            if abs(product[i]) >= least:
                left[i] = 0.0
        for k in range(4):
            rotations[found, k] = mean[k]
    return rotations, weights
