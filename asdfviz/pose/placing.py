"""Compiled loop behind `hypotheses`: from a box and a rotation to a translation."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

NEAREST = 0.01
"""Corners nearer to the camera than this are projected as if they were there, metres."""
ROUNDS = 3
"""A perspective box is met after so many steps from that of parallel rays."""


@kernel
@no_type_check
def _turned(R, corners, turned, low, high):
    """Fill in the turned corners, and between what they lie."""
    for a in range(3):
        low[a], high[a] = np.inf, -np.inf
        for k in range(len(corners)):
            turned[k, a] = (
                R[a, 0] * corners[k, 0] + R[a, 1] * corners[k, 1] + R[a, 2] * corners[k, 2]
            )
            low[a], high[a] = min(low[a], turned[k, a]), max(high[a], turned[k, a])


@kernel
@no_type_check
def _seen(turned, t):
    """The box of the turned corners, moved by t, at depth 1."""
    x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
    for k in range(len(turned)):
        depth = max(turned[k, 2] + t[2], NEAREST)
        x, y = (turned[k, 0] + t[0]) / depth, (turned[k, 1] + t[1]) / depth
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    return x0, y0, x1, y1


@kernel
@no_type_check
def placed(Rs, distances, corners, box):
    """Poses (c, 4, 4) whose projected corners fill a box: its middle and, unless given, its size.

    Args:
        Rs: rotations, (c, 3, 3).
        distances: depth of the part's origin along the axis, metres; NaN: the box's size tells it.
        corners: of the part, (k, 3), metres.
        box: x0, y0, x1, y1 at depth 1.
    """
    Ts, turned = np.zeros((len(Rs), 4, 4)), np.empty((len(corners), 3))
    middle_x, middle_y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    diagonal = max(np.hypot(box[2] - box[0], box[3] - box[1]), 1e-6)
    low, high, t = np.empty(3), np.empty(3), np.empty(3)
    for c in range(len(Rs)):
        _turned(Rs[c], corners, turned, low, high)
        x, y, inner = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2
        z = np.hypot(high[0] - low[0], high[1] - low[1]) / diagonal
        is_given = not np.isnan(distances[c])
        if is_given:
            z = distances[c] + inner
        t[0], t[1], t[2] = z * middle_x - x, z * middle_y - y, z - inner
        for _ in range(ROUNDS):
            x0, y0, x1, y1 = _seen(turned, t)
            if not is_given:
                t[2] += (t[2] + inner) * (np.hypot(x1 - x0, y1 - y0) / diagonal - 1)
            t[0] += (middle_x - (x0 + x1) / 2) * (t[2] + inner)
            t[1] += (middle_y - (y0 + y1) / 2) * (t[2] + inner)
        Ts[c, 3, 3] = 1.0
        for a in range(3):
            Ts[c, a, 3] = t[a]
            for b in range(3):
                Ts[c, a, b] = Rs[c, a, b]
    return Ts
