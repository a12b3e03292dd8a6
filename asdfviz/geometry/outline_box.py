"""The box around projected points, in a compiled loop: it is asked for dozens of times a frame."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

NEAREST = 0.01
"""Points nearer to the camera than this are projected as if they were there, metres."""


@kernel
@no_type_check
def outline_box(T, points, K):
    """x0, y0, x1, y1 in pixels around all points, one or more.

    Args:
        T: T_camera_part.
        points: (n, 3) in the part's frame, metres.
        K: intrinsics.
    """
    x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
        y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
        z = max(T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3], NEAREST)
        u, v = K[0, 0] * x / z + K[0, 1] * y / z + K[0, 2], K[1, 1] * y / z + K[1, 2]
        x0, y0, x1, y1 = min(x0, u), min(y0, v), max(x1, u), max(y1, v)
    return np.array([x0, y0, x1, y1])
