"""The compiled loop behind `drawn_looks`: how much of the brightness shading by normals leaves unexplained."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.cholesky import solve
from asdfviz.geometry.jit import kernel

RIDGE = 0.01
"""Holds the factors of normals that hardly differ near zero."""
LEAST_INSIDE = 0.2
"""Of a smoothed normal: beside the part's rim its length says little."""
LEAST_SPREAD = 1e-3
"""Of what is left, logarithm of brightness."""
ROBUST = 1.4826
"""Median of absolute deviations to a standard deviation."""


@kernel
@no_type_check
def _gathered(smooth, counted, brightness):
    """Terms (1 and the normal) and brightness of the pixels that count."""
    rows, columns = counted.nonzero()
    terms, bright = np.ones((len(rows), 4)), np.empty(len(rows))
    for i in range(len(rows)):
        pixel = smooth[rows[i], columns[i]]
        for k in range(3):
            terms[i, k + 1] = pixel[k] / max(pixel[3], LEAST_INSIDE)
        bright[i] = brightness[rows[i], columns[i]]
    return terms, bright


@kernel
@no_type_check
def _factors(terms, bright, weight):
    """Weighted least squares of the brightness by its terms."""
    A, y = RIDGE * np.eye(4), np.zeros(4)
    for i in range(len(bright)):
        for a in range(4):
            weighted = weight[i] * terms[i, a]
            y[a] += weighted * bright[i]
            for b in range(4):
                A[a, b] += weighted * terms[i, b]
    factors = np.zeros(4)
    solve(A, y, factors)  # positive definite, by the ridge
    return factors


@kernel
@no_type_check
def uneven(smooth, counted, brightness, rounds, largest):
    """What a linear function of the normal leaves of the brightness' logarithm, root mean square.

    Args:
        smooth: h w 4, smoothed sums of normals, and of ones, over the part's pixels.
        counted: h w, pixels that count.
        brightness: h w, logarithm.
        rounds: in which what does not fit comes to count less.
        largest: what is left counts for no more than this.
    """
    terms, bright = _gathered(smooth, counted, brightness)
    weight, left = np.ones(len(bright)), bright.copy()
    for _ in range(rounds):
        factors = _factors(terms, bright, weight)
        for i in range(len(bright)):
            left[i] = bright[i]
            for a in range(4):
                left[i] -= terms[i, a] * factors[a]
        spread = ROBUST * np.median(np.abs(left)) + LEAST_SPREAD
        for i in range(len(bright)):
            weight[i] = 1.0 / (1.0 + (left[i] / (2 * spread)) ** 2)
    total = 0.0
    for i in range(len(bright)):
        total += min(left[i] ** 2, largest**2)
    return np.sqrt(total / len(bright))
