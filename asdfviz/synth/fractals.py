"""Smooth periodic noise, of which the patterns and the cloth's creases are made."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32

Plane = Float32[np.ndarray, "n n"]


def fractal(
    rng: np.random.Generator, n: int, *, base: int, octaves: int, gain: float = 0.55
) -> Plane:
    """Periodic fractal noise of mean 0 and deviation 1; `base` is the coarsest grid."""
    total = np.zeros((n, n), np.float32)
    for octave in range(octaves):
        k = min(base * 2**octave, n // 2)
        grid = np.pad(rng.random((k, k)).astype(np.float32), 4, mode="wrap")
        side = n * (k + 8) // k
        cut = (side - n) // 2
        # Columns are cut before the rows are drawn out: a coarse grid's border is most of it.
        wide = cv2.resize(grid, (side, k + 8), interpolation=cv2.INTER_CUBIC)[:, cut : cut + n]
        large = cv2.resize(wide.copy(), (n, side), interpolation=cv2.INTER_CUBIC)
        total += gain**octave * large[cut : cut + n]
    total -= total.mean()
    return (total / (total.std() + 1e-6)).astype(np.float32)


def unit_axes(n: int) -> tuple[Plane, Plane]:
    """X and y of every texel, 0 to 1."""
    y, x = np.mgrid[0:n, 0:n].astype(np.float32) / n
    return x, y
