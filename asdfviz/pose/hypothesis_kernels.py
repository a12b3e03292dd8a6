"""Compiled loops behind `hypotheses`: draw a part's points into a small grid, compare, take a step.

All in the crop camera's frame, metres. The grid has the crop's field of view; a cell's index is its
centre in cell units.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

FAR = 6.0
"""A reading farther behind the surface than so many margins does not agree at all (exp(-18))."""


@kernel
@no_type_check
def _splat(points, T, focal, grid):
    """Draw a pose: the nearest point of each cell, its depth and its row; infinity and -1 where none is.

    Returns how many cells it covers; `grid` tells which.

    Args:
        points: coordinates (3, n), so that the projection runs over many of them at once.
        T: the pose.
        focal: of the grid, cells.
        grid: as `_new_grid` makes it.
    """
    side, near, owner, covered, cells, depths = grid
    center = (side - 1) / 2
    outside = side * side  # one cell more, for what is not in view
    near[:] = np.inf
    owner[:] = -1
    for i in range(points.shape[1]):
        x, y, z = points[0, i], points[1, i], points[2, i]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        u = focal * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth + center + 0.5
        v = focal * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth + center + 0.5
        inside = (depth >= 0.01) & (u >= 0) & (u < side) & (v >= 0) & (v < side)
        cells[i] = int(v) * side + int(u) if inside else outside
        depths[i] = depth
    count = 0
    near[outside] = -np.inf
    for i in range(points.shape[1]):
        cell = cells[i]
        if depths[i] < near[cell]:
            if owner[cell] < 0:
                covered[count] = cell
                count += 1
            near[cell] = depths[i]
            owner[cell] = i
    return count


@kernel
@no_type_check
def _new_grid(side, count):
    """Buffers for `_splat` of so many points: side, depths, rows and numbers of cells, cells and depths
    by point."""
    cells = side * side + 1
    near, owner, covered = np.empty(cells), np.empty(cells, np.int64), np.empty(cells, np.int64)
    return side, near, owner, covered, np.empty(count, np.int64), np.empty(count)


@kernel
@no_type_check
def _compare(points, T, focal, seen, margin, grid):
    """Draw a pose into `grid`, and compare it with what was seen.

    Returns the overlap of silhouette and outline, how well readings on the silhouette agree, summed, and
    their number; those in front are left out.

    Args:
        points: as for `_splat`.
        T: likewise.
        focal: likewise.
        grid: likewise.
        seen: outline and depth of the cells one after the other, and the outline's sum.
        margin: readings this near to the surface agree with it, metres.
    """
    outline, measured, area = seen
    count = _splat(points, T, focal, grid)
    near, covered = grid[1], grid[3]
    both, either, hits, readings = 0.0, area + 1e-9, 0.0, 0
    for k in range(count):
        cell = covered[k]
        shown, depth = outline[cell], measured[cell]
        gap = depth - near[cell]
        either -= shown
        if depth > 0 and gap < -margin and shown < 0.5:
            continue  # something else stands in front
        both += shown
        either += 1.0
        if depth > 0 and gap > -2 * margin:
            readings += 1
            if gap < FAR * margin:
                hits += np.exp(-0.5 * (gap / margin) ** 2)
    return both / either, hits, readings


@kernel
@no_type_check
def _in_rows(outline, measured):
    """What is seen, as `_compare` takes it."""
    side, area = outline.shape[0], 0.0
    shown, depth = np.empty(side * side), np.empty(side * side)
    for row in range(side):
        for column in range(side):
            shown[row * side + column] = outline[row, column]
            depth[row * side + column] = measured[row, column]
            area += outline[row, column]
    return shown, depth, area


@kernel
@no_type_check
def agreement(points, Ts, focal, outline, measured, margin):
    """Compare poses (c, 4, 4) with what was seen.

    Returns (c, 3): overlap of silhouette and outline; share of readings on the silhouette within
    `margin` of the surface, those in front left out; and their number.
    """
    grid, columns = _new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    seen = _in_rows(outline, measured)
    result = np.zeros((len(Ts), 3))
    for c in range(len(Ts)):
        overlap, hits, readings = _compare(columns, Ts[c], focal, seen, margin, grid)
        result[c, 0] = overlap
        result[c, 1] = hits / max(readings, 1)
        result[c, 2] = readings
    return result


@kernel
@no_type_check
def slid(points, Ts, focal, outline, measured, max_shift, middle):
    """Poses (c, 4, 4), each moved along the ray of the part's `middle` by the median difference of the readings within the
    outline to the surface; those stay that would move by more than `max_shift` of their distance."""
    grid, columns = _new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    shown, depth, _ = _in_rows(outline, measured)
    near, covered = grid[1], grid[3]
    gaps, at = np.empty(len(shown)), np.empty(3)
    moved = Ts.copy()
    for c in range(len(Ts)):
        known = 0
        for k in range(_splat(columns, Ts[c], focal, grid)):
            cell = covered[k]
            if depth[cell] > 0 and shown[cell] > 0.5:
                gaps[known] = depth[cell] - near[cell]
                known += 1
        if known == 0:
            continue
        for a in range(3):
            x, y, z = Ts[c, a, 0] * middle[0], Ts[c, a, 1] * middle[1], Ts[c, a, 2] * middle[2]
            at[a] = x + y + z + Ts[c, a, 3]
        shift = np.median(gaps[:known]) / at[2]
        if abs(shift) < max_shift:
            for a in range(3):
                moved[c, a, 3] += shift * at[a]
    return moved


@kernel
@no_type_check
def _surface_step(points, normals, T, focal, outline, measured, reach, grid):
    """One Gauss-Newton step of the point-to-plane distance: turn and shift about the part's origin.

    Readings farther than `reach` from the surface, or outside the outline, do not count. Returns
    zeros where fewer than 12 are left.
    """
    side = outline.shape[0]
    _splat(points, T, focal, grid)
    near, owner = grid[1], grid[2]
    H = np.zeros((6, 6))
    g = np.zeros(6)
    J = np.empty(6)
    n, r, p = np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for row in range(side):
        for column in range(side):
            cell, z = row * side + column, measured[row, column]
            i = owner[cell]
            if i < 0 or z <= 0 or outline[row, column] < 0.3 or abs(z - near[cell]) > reach:
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
                g[a] += weight * J[a] * gap
                for b in range(6):
                    H[a, b] += weight * J[a] * J[b]
            count += 1
    if count < 12:
        return np.zeros(6)
    scale = 0.0
    for i in range(points.shape[1]):
        scale = max(scale, abs(points[0, i]), abs(points[1, i]), abs(points[2, i]))
    for a in range(6):
        # What depth does not see (a turn about a symmetry axis, a slide along a face) stays.
        H[a, a] += count * 0.02 * (scale**2 if a < 3 else 1.0)
    return np.linalg.solve(H, g)


@kernel
@no_type_check
def surface_fit(points, normals, T_start, focal, outline, measured, reach, steps):
    """The pose after so many steps of `_surface_step` at most, the first two with twice the reach."""
    T = T_start.copy()
    grid, columns = _new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    for step in range(steps):
        wide = 2.0 if step < 2 else 1.0
        twist = _surface_step(columns, normals, T, focal, outline, measured, wide * reach, grid)
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
    grid, columns = _new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    best = T_start.copy()
    seen = _in_rows(outline, measured)
    most = _rim(columns, best, focal, seen, margin, depth_weight, least, grid)
    for step in (1.0, 0.5, 0.25):
        size = step * T_start[2, 3] / focal
        for axis in range(3):
            for sign in (1.0, -1.0):
                moved = False
                for _ in range(2):
                    trial = _in_plane(best, axis, sign * size, middle, radius)
                    score = _rim(columns, trial, focal, seen, margin, depth_weight, least, grid)
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
def _rim(points, T, focal, seen, margin, depth_weight, least, grid):
    """Overlap and weighted depth agreement of one pose."""
    overlap, hits, readings = _compare(points, T, focal, seen, margin, grid)
    return overlap if readings < least else overlap + depth_weight * hits / readings
