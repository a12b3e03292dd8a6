"""The compiled loop behind `color_ratio`."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel


@kernel
@no_type_check
def ratio_of(features, middle, deviation, highest, limit):
    """Logarithm of a normal density (independent in its three dimensions) at every cell, cut at +-limit.

    Args:
        features: h w 3.
        middle: of the density.
        deviation: likewise.
        highest: its logarithm there.
        limit: most that a cell says.
    """
    height, width = features.shape[:2]
    found = np.empty((height, width), np.float32)
    for row in range(height):
        for column in range(width):
            squares = 0.0
            for k in range(3):
                off = (features[row, column, k] - middle[k]) / deviation[k]
                squares += off * off
            found[row, column] = min(max(highest - 0.5 * squares, -limit), limit)
    return found
