"""Compiled loops behind `hypotheses`: draw a part's points into a small grid, and compare.

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
def splat(points, T, focal, grid):
    """Draw a pose: the nearest point of each cell, its depth and its row; infinity and -1 where none is.

    Returns how many cells it covers; `grid` tells which.

    Args:
        points: coordinates (3, n), so that the projection runs over many of them at once.
        T: the pose.
        focal: of the grid, cells.
        grid: as `new_grid` makes it.
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
        # Written without branches: which point is nearer is as good as random, and a wrong guess of it is dear.
        cell, depth = cells[i], depths[i]
        nearest, before = near[cell], owner[cell]
        is_nearer = depth < nearest
        covered[count] = cell
        count += 1 if is_nearer & (before < 0) else 0
        near[cell] = depth if is_nearer else nearest
        owner[cell] = i if is_nearer else before
    return count


@kernel
@no_type_check
def new_grid(side, count):
    """Buffers for `splat` of so many points: side, depths, rows and numbers of cells, cells and depths
    by point."""
    cells = side * side + 1
    near, owner, covered = np.empty(cells), np.empty(cells, np.int64), np.empty(cells, np.int64)
    return side, near, owner, covered, np.empty(count, np.int64), np.empty(count)


@kernel
@no_type_check
def compare(points, T, focal, seen, margin, grid):
    """Draw a pose into `grid`, and compare it with what was seen.

    Returns the overlap of silhouette and outline, how well readings on the silhouette agree, summed, and
    their number; those in front are left out.

    Args:
        points: as for `splat`.
        T: likewise.
        focal: likewise.
        grid: likewise.
        seen: outline and depth of the cells one after the other, and the outline's sum.
        margin: readings this near to the surface agree with it, metres.
    """
    outline, measured, area = seen
    count = splat(points, T, focal, grid)
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
def in_rows(outline, measured):
    """What is seen, as `compare` takes it."""
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
    grid, columns = new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    seen = in_rows(outline, measured)
    result = np.zeros((len(Ts), 3))
    for c in range(len(Ts)):
        overlap, hits, readings = compare(columns, Ts[c], focal, seen, margin, grid)
        result[c, 0] = overlap
        result[c, 1] = hits / max(readings, 1)
        result[c, 2] = readings
    return result


@kernel
@no_type_check
def slid(points, Ts, focal, outline, measured, max_shift, middle):
    """Poses (c, 4, 4), each moved along the ray of the part's `middle` by the median difference of the readings within the
    outline to the surface; those stay that would move by more than `max_shift` of their distance."""
    grid, columns = new_grid(outline.shape[0], len(points)), np.ascontiguousarray(points.T)
    shown, depth, _ = in_rows(outline, measured)
    near, covered = grid[1], grid[3]
    gaps, at = np.empty(len(shown)), np.empty(3)
    moved = Ts.copy()
    for c in range(len(Ts)):
        known = 0
        for k in range(splat(columns, Ts[c], focal, grid)):
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
