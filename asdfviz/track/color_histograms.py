"""What colours a part and its surroundings have: two RGB histograms, learnt along the contour."""

from __future__ import annotations

from typing import TypeAlias, no_type_check

import numpy as np
from jaxtyping import Float32

from asdfviz.track.jit import kernel
from asdfviz.track.region_kernels import place
from asdfviz.track.visibility import id_at, occluded

ColorTable: TypeAlias = Float32[np.ndarray, "colors"]


class ColorHistograms:
    """Foreground and background of one part; `table` is the probability of foreground a colour."""

    def __init__(self, bins: int) -> None:
        self.bits = int(np.log2(bins))
        colors = 1 << (3 * self.bits)
        self.counts = np.zeros((colors, 2), np.float32)
        self._frequencies = np.zeros((colors, 2), np.float32)
        self.table: ColorTable = np.full(colors, 0.5, np.float32)

    @property
    def contrast(self) -> float:
        """Mean probability of foreground on the part minus that beside it, 0 to 1: what a right
        pose shows."""
        return float((self._frequencies[:, 0] - self._frequencies[:, 1]) @ self.table)

    def learn(self, rate: float) -> None:
        """Blend `counts` in and empty them; a side that saw no pixel keeps what it has."""
        blend(self.counts, self._frequencies, rate, self.table)


@kernel
@no_type_check
def blend(counts, frequencies, rate, table):
    """Blend frequency <- (1 - rate) frequency + rate counts / sum, then table <- f / (f + b)."""
    for side in range(2):
        total = 0.0
        for i in range(len(counts)):
            total += counts[i, side]
        if total == 0.0:
            continue
        for i in range(len(counts)):
            new = rate * counts[i, side] / total
            frequencies[i, side] = (1.0 - rate) * frequencies[i, side] + new
    for i in range(len(counts)):
        counts[i, 0], counts[i, 1] = 0.0, 0.0
        both = frequencies[i, 0] + frequencies[i, 1]
        table[i] = frequencies[i, 0] / both if both > 0.0 else 0.5


@kernel
@no_type_check
def _walk(image, bits, at, sign, length, start, ids, crop, own, counts, side):
    """Count pixels from `start` px off the contour to `length` px, until the part's id ends."""
    height, width = image.shape[0], image.shape[1]
    pace = 1.0 / max(abs(at[3]), abs(at[4]))
    shift = 8 - bits
    distance = start
    while distance <= length:
        u = int(np.floor(at[0] + sign * distance * at[3] + 0.5))
        v = int(np.floor(at[1] + sign * distance * at[4] + 0.5))
        if u < 0 or v < 0 or u >= width or v >= height:
            return
        if ids.size > 0 and (id_at(ids, crop, u, v) == own) != (side == 0):
            return
        r, g, b = image[v, u, 0] >> shift, image[v, u, 1] >> shift, image[v, u, 2] >> shift
        counts[(((r << bits) + g) << bits) + b, side] += 1.0
        distance += pace


@kernel
@no_type_check
def count_colors(
    image, bits, points, count, T, lens, lengths, depth, offsets, occlusion, ids, crop, own, counts
):
    """Count the colours beside the first `count` contour points into `counts` (colours, 2).

    `lengths` is (unconsidered, greatest) in pixels from the contour.
    """
    at = np.empty(5)
    for k in range(count):
        point = points[k]
        if not place(point, T, lens, at):
            continue
        per_metre = lens[0] / at[2]
        if depth.size > 0:
            limit = at[2] - offsets[k] - occlusion[1]
            if occluded(depth, at[0], at[1], limit, occlusion[0] * per_metre):
                continue
        inner = min(lengths[1], point[6] * per_metre - 2.0 * lengths[0])
        outer = min(lengths[1], point[7] * per_metre - 2.0 * lengths[0])
        _walk(image, bits, at, -1.0, inner, lengths[0], ids, crop, own, counts, 0)
        _walk(image, bits, at, 1.0, outer, lengths[0], ids, crop, own, counts, 1)
