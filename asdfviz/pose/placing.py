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
def placed(Rs, distances, corners, box):
    """Poses (c, 4, 4) whose projected corners fill a box: its middle and, unless given, its size.

    Args:
        Rs: rotations, (c, 3, 3).
        distances: of the part's middle along the axis, metres; NaN: the box's size tells it.
        corners: of the part, (k, 3), metres.
        box: x0, y0, x1, y1 at depth 1.
    """
    Ts = np.zeros((len(Rs), 4, 4))
    turned = np.empty((len(corners), 3))
    middle_x, middle_y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    diagonal = max(np.hypot(box[2] - box[0], box[3] - box[1]), 1e-6)
    low, high, inner, t = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for c in range(len(Rs)):
        low[:], high[:] = np.inf, -np.inf
        for k in range(len(corners)):
            for a in range(3):
                value = 0.0
                for b in range(3):
                    value += Rs[c, a, b] * corners[k, b]
                turned[k, a] = value
                low[a], high[a] = min(low[a], value), max(high[a], value)
        inner[:] = (low + high) / 2
        is_given = not np.isnan(distances[c])
        z = np.hypot(high[0] - low[0], high[1] - low[1]) / diagonal
        if is_given:
            z = distances[c] + inner[2]
        t[0], t[1], t[2] = z * middle_x - inner[0], z * middle_y - inner[1], z - inner[2]
        for _ in range(ROUNDS):
            x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
            for k in range(len(corners)):
                depth = max(turned[k, 2] + t[2], NEAREST)
                x, y = (turned[k, 0] + t[0]) / depth, (turned[k, 1] + t[1]) / depth
                x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
            if not is_given:
                t[2] += (t[2] + inner[2]) * (np.hypot(x1 - x0, y1 - y0) / diagonal - 1)
            t[0] += (middle_x - (x0 + x1) / 2) * (t[2] + inner[2])
            t[1] += (middle_y - (y0 + y1) / 2) * (t[2] + inner[2])
        Ts[c, :3, :3], Ts[c, :3, 3], Ts[c, 3, 3] = Rs[c], t, 1.0
    return Ts
