"""Compiled loops behind `reprojection`: damped Gauss-Newton steps on a robust reprojection error."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.cholesky import solve
from asdfviz.geometry.jit import kernel

NEAREST = 0.01
"""Points nearer to the camera plane than this, metres, make a pose impossible."""
MOST_TURN = 0.7
"""A step turns no farther than this about each axis, radians."""

LEAST_GAIN = 1e-5
"""A step that gains less, of the cost, is the last one."""


@kernel
@no_type_check
def reprojection_cost(T, points, pixels, K, weights, scale):
    """sum_i weight_i log(1 + (r_i / scale)^2), r_i in pixels; infinity for an impossible pose (4, 4)."""
    total = 0.0
    for i in range(len(points)):
        x, y, z = _seen(T, points[i])
        if not z > NEAREST:
            return np.inf
        u = (K[0, 0] * x + K[0, 1] * y) / z + K[0, 2] - pixels[i, 0]
        v = (K[1, 0] * x + K[1, 1] * y) / z + K[1, 2] - pixels[i, 1]
        total += weights[i] * np.log1p((u * u + v * v) / scale**2)
    return total if np.isfinite(total) else np.inf


@kernel
@no_type_check
def lowered(T, cost, damping, steps, points, pixels, K, weights, scale):
    """Lower the cost of a pose by so many damped steps at most.

    Returns the pose, its cost, and the damping that a further step would begin with, or -1 where steps
    hardly gain any more.
    """
    for _ in range(steps):
        trial = _stepped(T, damping, points, pixels, K, weights, scale)
        reached = reprojection_cost(trial, points, pixels, K, weights, scale)
        if reached < cost:
            gained = reached <= (1 - LEAST_GAIN) * cost
            T, cost, damping = trial, reached, max(damping * 0.2, 1e-9)
            if not gained:
                return T, cost, -1.0
        else:
            damping = min(damping * 10, 1e6)
    return T, cost, damping


@kernel
@no_type_check
def _seen(T, point):
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3]
    return x, y, z


@kernel
@no_type_check
def _stepped(T, damping, points, pixels, K, weights, scale):
    """One damped Gauss-Newton step: a turn about the part's origin and a shift, camera axes.

    The pose as it is where the points leave it open.
    """
    H, g, J = np.zeros((6, 6)), np.zeros(6), np.empty((2, 6))
    off = np.empty(2)
    for i in range(len(points)):
        x, y, z = _seen(T, points[i])
        for a in range(2):
            along = K[a, 0] * x + K[a, 1] * y
            off[a] = along / z + K[a, 2] - pixels[i, a]
            J[a, 3], J[a, 4], J[a, 5] = K[a, 0] / z, K[a, 1] / z, -along / (z * z)
            rx, ry, rz = x - T[0, 3], y - T[1, 3], z - T[2, 3]
            J[a, 0] = ry * J[a, 5] - rz * J[a, 4]
            J[a, 1] = rz * J[a, 3] - rx * J[a, 5]
            J[a, 2] = rx * J[a, 4] - ry * J[a, 3]
        weight = weights[i] / (1 + (off[0] ** 2 + off[1] ** 2) / scale**2)
        for a in range(6):
            g[a] += weight * (J[0, a] * off[0] + J[1, a] * off[1])
            for b in range(6):
                H[a, b] += weight * (J[0, a] * J[0, b] + J[1, a] * J[1, b])
    for a in range(6):
        H[a, a] += damping * H[a, a] + 1e-12
    step = np.zeros(6)
    return _moved(T, step) if solve(H, -g, step) else T


@kernel
@no_type_check
def _moved(T, twist):
    """Turn by Cayley's map, which is a rotation for any argument and the turn itself for small ones."""
    half = np.empty(3)
    for a in range(3):
        half[a] = min(max(twist[a], -MOST_TURN), MOST_TURN) / 2
    share = 2 / (1 + half[0] ** 2 + half[1] ** 2 + half[2] ** 2)
    moved = T.copy()
    for column in range(3):
        a, b, c = T[0, column], T[1, column], T[2, column]
        # R v = v + 2 / (1 + |h|^2) (h x v + h x (h x v))
        x, y, z = half[1] * c - half[2] * b, half[2] * a - half[0] * c, half[0] * b - half[1] * a
        moved[0, column] = a + share * (x + half[1] * z - half[2] * y)
        moved[1, column] = b + share * (y + half[2] * x - half[0] * z)
        moved[2, column] = c + share * (z + half[0] * y - half[1] * x)
    for a in range(3):
        moved[a, 3] += twist[3 + a]
    return moved
