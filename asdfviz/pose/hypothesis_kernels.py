"""Compiled loops behind `hypotheses`: draw a part's points into a small grid, compare, take a step.

All in the crop camera's frame, metres. The grid has the crop's field of view; a cell's index is its
centre in cell units.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel


@kernel
@no_type_check
def splat(points, T, focal, near, owner):
    """Fill `near` (n, n) with the depth of the nearest point of each cell, and `owner` with its row."""
    side = near.shape[0]
    center = (side - 1) / 2
    near[:] = np.inf
    owner[:] = -1
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if depth < 0.01:
            continue
        u = focal * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth + center
        v = focal * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth + center
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        if 0 <= column < side and 0 <= row < side and depth < near[row, column]:
            near[row, column] = depth
            owner[row, column] = i


@kernel
@no_type_check
def _compare(points, T, focal, outline, measured, margin, near, owner):
    """Draw a pose into `near` and `owner`, and compare it with what was seen.

    Returns the overlap of silhouette and outline, how well readings on the silhouette agree, summed, and
    their number; those in front are left out.
    """
    side = outline.shape[0]
    splat(points, T, focal, near, owner)
    both, either, hits, readings = 0.0, 1e-9, 0.0, 0
    for row in range(side):
        for column in range(side):
            seen = outline[row, column]
            if owner[row, column] < 0:
                either += seen
                continue
            known = measured[row, column] > 0
            gap = measured[row, column] - near[row, column]
            if known and gap < -margin and seen < 0.5:
                continue  # something else stands in front
            both += seen
            either += 1.0
            if known and gap > -2 * margin:
                readings += 1
                hits += np.exp(-0.5 * (gap / margin) ** 2)
    return both / either, hits, readings


@kernel
@no_type_check
def agreement(points, Ts, focal, outline, measured, margin):
    """Compare poses (c, 4, 4) with what was seen.

    Returns (c, 4): overlap of silhouette and outline; share of readings on the silhouette within
    `margin` of the surface, those in front left out; their number; and the median difference of
    readings (within the outline) to the surface, NaN without any.
    """
    side = outline.shape[0]
    near = np.empty((side, side))
    owner = np.empty((side, side), np.int64)
    gaps = np.empty(side * side)
    result = np.zeros((len(Ts), 4))
    for c in range(len(Ts)):
        overlap, hits, readings = _compare(
            points, Ts[c], focal, outline, measured, margin, near, owner
        )
        count = 0
        for row in range(side):
            for column in range(side):
                known = owner[row, column] >= 0 and measured[row, column] > 0
                if known and outline[row, column] > 0.5:
                    gaps[count] = measured[row, column] - near[row, column]
                    count += 1
        result[c, 0] = overlap
        result[c, 1] = hits / max(readings, 1)
        result[c, 2] = readings
        result[c, 3] = np.median(gaps[:count]) if count > 0 else np.nan
    return result


@kernel
@no_type_check
def surface_step(points, normals, T, focal, outline, measured, reach):
    """One Gauss-Newton step of the point-to-plane distance: turn and shift about the part's origin.

    Readings farther than `reach` from the surface, or outside the outline, do not count. Returns
    zeros where fewer than 12 are left.
    """
    side = outline.shape[0]
    near = np.empty((side, side))
    owner = np.empty((side, side), np.int64)
    splat(points, T, focal, near, owner)
    H = np.zeros((6, 6))
    g = np.zeros(6)
    J = np.empty(6)
    n, r, p = np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for row in range(side):
        for column in range(side):
            i = owner[row, column]
            z = measured[row, column]
            if i < 0 or z <= 0 or outline[row, column] < 0.3 or abs(z - near[row, column]) > reach:
                continue
            for a in range(3):
                n[a] = T[a, 0] * normals[i, 0] + T[a, 1] * normals[i, 1] + T[a, 2] * normals[i, 2]
                r[a] = T[a, 0] * points[i, 0] + T[a, 1] * points[i, 1] + T[a, 2] * points[i, 2]
                # The reading is taken on the ray of the point itself, not of the cell's centre.
                p[a] = r[a] + T[a, 3]
            gap = (z / p[2] - 1.0) * (n[0] * p[0] + n[1] * p[1] + n[2] * p[2])
            weight = 1.0 / (1.0 + (gap / (0.3 * reach)) ** 2)
            J[0] = r[1] * n[2] - r[2] * n[1]
            J[1] = r[2] * n[0] - r[0] * n[2]
            J[2] = r[0] * n[1] - r[1] * n[0]
            J[3:] = n
            for a in range(6):
                g[a] += weight * J[a] * gap
                for b in range(6):
                    H[a, b] += weight * J[a] * J[b]
            count += 1
    if count < 12:
        return np.zeros(6)
    scale = 0.0
    for i in range(len(points)):
        scale = max(scale, abs(points[i, 0]), abs(points[i, 1]), abs(points[i, 2]))
    for a in range(6):
        # What depth does not see (a turn about a symmetry axis, a slide along a face) stays.
        H[a, a] += count * 0.02 * (scale**2 if a < 3 else 1.0)
    return np.linalg.solve(H, g)


@kernel
@no_type_check
def surface_fit(points, normals, T_start, focal, outline, measured, reach, steps):
    """The pose after so many steps of `surface_step` at most, the first two with twice the reach."""
    T = T_start.copy()
    for step in range(steps):
        wide = 2.0 if step < 2 else 1.0
        twist = surface_step(points, normals, T, focal, outline, measured, wide * reach)
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
def plane_fit(
    points, T_start, focal, outline, measured, margin, depth_weight, least, middle, radius
):
    """Shift and turn a pose in the view's plane to where outline and depth agree best.

    Point to plane does not see where a flat side lies; its rim does. Steps are of a cell and less,
    those of turns by what they move at `radius` from `middle` (part frame). `least` readings count.
    """
    side = outline.shape[0]
    near = np.empty((side, side))
    owner = np.empty((side, side), np.int64)
    best = T_start.copy()
    most = _rim(points, best, focal, outline, measured, margin, depth_weight, least, near, owner)
    for step in (1.0, 0.5, 0.25):
        size = step * T_start[2, 3] / focal
        for axis in range(3):
            for sign in (1.0, -1.0):
                moved = False
                for _ in range(2):
                    trial = _in_plane(best, axis, sign * size, middle, radius)
                    score = _rim(
                        points,
                        trial,
                        focal,
                        outline,
                        measured,
                        margin,
                        depth_weight,
                        least,
                        near,
                        owner,
                    )
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
def _rim(points, T, focal, outline, measured, margin, depth_weight, least, near, owner):
    """Overlap and weighted depth agreement of one pose."""
    overlap, hits, readings = _compare(points, T, focal, outline, measured, margin, near, owner)
    return overlap if readings < least else overlap + depth_weight * hits / readings
