"""Smooth periodic noise, of which the patterns and the cloth's creases are made."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32

Plane = Float32[np.ndarray, "n n"]


def fractal(
    rng: np.random.Generator,
    n: int,
    *,
    base: int,
    octaves: int,
    gain: float = 0.55,
    drawn_out: int = 1,
) -> Plane:
    """Periodic fractal noise of mean 0 and deviation 1.

    Args:
        rng: what it is drawn from.
        n: texels of a side.
        base: columns of the coarsest grid.
        octaves: grids, each twice as fine as the one before.
        gain: strength of each against the one before.
        drawn_out: so many times as long along the columns as across them.
    """
    total = np.zeros((n, n), np.float32)
    for octave in range(octaves):
        k = min(base * 2**octave, n // 2)
        rows = max(k // drawn_out, 1)
        grid = np.pad(rng.random((rows, k)).astype(np.float32), 4, mode="wrap")
        side, high = n * (k + 8) // k, n * (rows + 8) // rows
        left, top = (side - n) // 2, (high - n) // 2
        # Columns are cut before the rows are drawn out: a coarse grid's border is most of it.
        wide = cv2.resize(grid, (side, rows + 8), interpolation=cv2.INTER_CUBIC)
        large = cv2.resize(
            wide[:, left : left + n].copy(), (n, high), interpolation=cv2.INTER_CUBIC
        )
        total += gain**octave * large[top : top + n]
    total -= total.mean()
    return (total / (total.std() + 1e-6)).astype(np.float32)


def unit_axes(n: int) -> tuple[Plane, Plane]:
    """X and y of every texel, 0 to 1."""
    y, x = np.mgrid[0:n, 0:n].astype(np.float32) / n
    return x, y
