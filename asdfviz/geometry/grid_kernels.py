"""Compiled loop behind `rotation_grid`: the peaks of a distribution over rotations."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

MEANS = 2
"""A peak's surroundings are taken so often about their own mean, so the grid's rotation does not pull it."""


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
def peaks(probabilities, grid, count, least, enough):
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
