"""Compiled loops behind `hypotheses` that move a pose to where it agrees best with what is seen."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel
from asdfviz.pose.hypothesis_kernels import compare, in_rows, new_grid, splat


@kernel
@no_type_check
def _surface_step(points, normals, T, focal, seen, reach, grid):
    """One Gauss-Newton step of the point-to-plane distance: turn and shift about the part's origin.

    Readings farther than `reach` from the surface, or outside the outline, do not count. Returns
    zeros where fewer than 12 are left.
    """
    outline, measured, _ = seen
    shown = splat(points, T, focal, grid)
    near, owner, covered = grid[1], grid[2], grid[3]
    H = np.zeros((6, 6))
    g = np.zeros(6)
    J = np.empty(6)
    n, r, p = np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for k in range(shown):
        cell = covered[k]
        i, z = owner[cell], measured[cell]
        if z <= 0 or outline[cell] < 0.3 or abs(z - near[cell]) > reach:
            continue
        for a in range(3):
            n[a] = T[a, 0] * normals[i, 0] + T[a, 1] * normals[i, 1] + T[a, 2] * normals[i, 2]
            r[a] = T[a, 0] * points[0, i] + T[a, 1] * points[1, i] + T[a, 2] * points[2, i]
            # The reading is taken on the ray of the point itself, not of the cell's centre.
            p[a] = r[a] + T[a, 3]
        gap = (z / p[2] - 1.0) * (n[0] * p[0] + n[1] * p[1] + n[2] * p[2])
        weight = 1.0 / (1.0 + (gap / (0.3 * reach)) ** 2)
        J[0] = r[1] * n[2] - r[2] * n[1]
        J[1] = r[2] * n[0] - r[0] * n[2]
        J[2] = r[0] * n[1] - r[1] * n[0]
        J[3:] = n
        for a in range(6):
            scaled = weight * J[a]
            g[a] += scaled * gap
            for b in range(a + 1):
                H[a, b] += scaled * J[b]
        count += 1
    if count < 12:
        return np.zeros(6)
    scale = 0.0
    for i in range(points.shape[1]):
        scale = max(scale, abs(points[0, i]), abs(points[1, i]), abs(points[2, i]))
    for a in range(6):
        for b in range(a):
            H[b, a] = H[a, b]
        # What depth does not see (a turn about a symmetry axis, a slide along a face) stays.
        H[a, a] += count * 0.02 * (scale**2 if a < 3 else 1.0)
    return np.linalg.solve(H, g)


@kernel
@no_type_check
def _by_surface(points, normals, T_start, focal, seen, reach, steps, grid):
    """The pose after so many steps of `_surface_step` at most, the first two with twice the reach."""
    T = T_start.copy()
    for step in range(steps):
        wide = 2.0 if step < 2 else 1.0
        twist = _surface_step(points, normals, T, focal, seen, wide * reach, grid)
        angle = np.sqrt(twist[0] ** 2 + twist[1] ** 2 + twist[2] ** 2)
        if angle > 1e-9:
            _turn(T, twist / angle, min(angle, 0.5))
        for a in range(3):
            T[a, 3] += twist[3 + a]
        if np.abs(twist).max() < 1e-4:
            break
    return T


@kernel
@no_type_check
def _turn(T, axis, angle):
    """Turn a pose in place about its own origin: axis of length 1 in the outer frame, radians."""
    x, y, z = axis[0], axis[1], axis[2]
    sine, rest = np.sin(angle), 1.0 - np.cos(angle)
    for column in range(3):
        a, b, c = T[0, column], T[1, column], T[2, column]
        # Rodrigues: v + sin (axis x v) + (1 - cos) (axis (axis . v) - v)
        along = x * a + y * b + z * c
        T[0, column] = a + sine * (y * c - z * b) + rest * (x * along - a)
        T[1, column] = b + sine * (z * a - x * c) + rest * (y * along - b)
        T[2, column] = c + sine * (x * b - y * a) + rest * (z * along - c)


@kernel
@no_type_check
def _in_its_plane(points, T_start, focal, seen, how, middle, radius, grid):
    """Shift and turn a pose in the view's plane to where outline and depth agree best.

    Point to plane does not see where a flat side lies; its rim does. Steps are of a cell and less,
    those of turns by what they move at `radius` from `middle`.
    """
    best = T_start.copy()
    most = _rim(points, best, focal, seen, how, grid)
    for step in (1.0, 0.5, 0.25):
        size = step * T_start[2, 3] / focal
        for axis in range(3):
            for sign in (1.0, -1.0):
                moved = False
                for _ in range(2):
                    trial = _in_plane(best, axis, sign * size, middle, radius)
                    score = _rim(points, trial, focal, seen, how, grid)
                    if score <= most:
                        break
                    best, most, moved = trial, score, True
                if moved:
                    break
    return best


@kernel
@no_type_check
def _in_plane(T, axis, size, middle, radius):
    """The pose shifted along the view's x or y, or turned about its z."""
    moved = T.copy()
    if axis < 2:
        moved[axis, 3] += size
        return moved
    x = T[0, 0] * middle[0] + T[0, 1] * middle[1] + T[0, 2] * middle[2]
    y = T[1, 0] * middle[0] + T[1, 1] * middle[1] + T[1, 2] * middle[2]
    _turn(moved, np.array([0.0, 0.0, 1.0]), size / radius)
    moved[0, 3] += x - (moved[0, 0] * middle[0] + moved[0, 1] * middle[1] + moved[0, 2] * middle[2])
    moved[1, 3] += y - (moved[1, 0] * middle[0] + moved[1, 1] * middle[1] + moved[1, 2] * middle[2])
    return moved


@kernel
@no_type_check
def _rim(points, T, focal, seen, how, grid):
    """Overlap and weighted depth agreement of one pose."""
    margin, weight, least = how
    overlap, hits, readings = compare(points, T, focal, seen, margin, grid)
    return overlap if readings < least else overlap + weight * hits / readings


@kernel
@no_type_check
def fits(points, normals, Ts, view, how, middle, radius):
    """Poses (c, 4, 4), each fitted to the measured depth, and then in the view's plane to depth and outline.

    All in one call: threads that work on other parts meet at calls.

    Args:
        points: (n, 3), part frame.
        normals: outward there.
        Ts: where they begin.
        view: focal length, outline and measured depth.
        how: reach of the fit to depth, metres, and its steps; margin as for `compare`, weight of the
            depth's agreement against the outline's, and how many readings it takes for that.
        middle: of the part, its frame.
        radius: its corners lie within this of it, metres.
    """
    focal, outline, measured = view
    reach, steps, margin, weight, least = how
    grid, columns = new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    seen, rim = in_rows(outline, measured), (margin, weight, least)
    fitted = np.empty(Ts.shape)
    for c in range(len(Ts)):
        T = _by_surface(columns, normals, Ts[c], focal, seen, reach, steps, grid)
        fitted[c] = _in_its_plane(columns, T, focal, seen, rim, middle, radius, grid)
    return fitted
