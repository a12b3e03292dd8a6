"""Compiled loop behind `rotation_grid`: the peaks of a distribution over rotations."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

MEANS = 2
"""A peak's surroundings are taken so often about their own mean, so the grid's rotation does not pull it."""


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
    left = probabilities.copy()
    product = np.empty(len(left))
    rotations, weights = np.empty((count, 4)), np.empty(count)
    mean, total = np.empty(4), np.empty(4)
    for found in range(count):
        highest = np.argmax(left)
        if left[highest] <= enough:
            return rotations[:found], weights[:found]
        mean[:] = grid[:, highest]
        weight = 0.0
        for turn in range(MEANS):
            for i in range(len(left)):
                product[i] = (
                    grid[0, i] * mean[0]
                    + grid[1, i] * mean[1]
                    + grid[2, i] * mean[2]
                    + grid[3, i] * mean[3]
                )
            total[:], weight = 0.0, 0.0
            for i in range(len(left)):
                if abs(product[i]) < least or left[i] <= 0.0:
                    continue
                weight += left[i]
                total += np.sign(product[i]) * left[i] * grid[:, i]
                if turn == MEANS - 1:
                    left[i] = 0.0
            mean[:] = total / np.sqrt((total**2).sum())
        rotations[found], weights[found] = mean, weight
    return rotations, weights
