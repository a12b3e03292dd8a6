"""The compiled loops behind `translation` and `depth_fit`: a depth image read at a part's points."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

BEYOND = 0.015
"""Where a reading is farther than the table by this, one looks past its edge, metres."""


@kernel
@no_type_check
def ray_shifts(points, shift, K, depth, box_xyxy, cells, edge):
    """How far along its ray the measured surface lies behind the nearest point of each cell, metres.

    Args:
        points: (n, 3) in the camera's frame, to which `shift` (3,) is added.
        shift: see above.
        K: intrinsics.
        depth: planar, metres, 0 = none.
        box_xyxy: pixels; points outside it are left out.
        cells: of the box in each direction.
        edge: a reading whose neighbours differ by more is left out, as are holes.
    """
    height, width = depth.shape
    left, top, right, bottom = box_xyxy[0], box_xyxy[1], box_xyxy[2], box_xyxy[3]
    across, down = max(right - left, 1e-6), max(bottom - top, 1e-6)
    nearest = np.full((cells * cells, 5), np.inf)
    for i in range(len(points)):
        x, y, z = points[i, 0] + shift[0], points[i, 1] + shift[1], points[i, 2] + shift[2]
        if not z > 1e-6:
            continue
        u = K[0, 0] * x / z + K[0, 1] * y / z + K[0, 2]
        v = K[1, 1] * y / z + K[1, 2]
        if not (max(left, 0.0) <= u <= min(right, width - 1.0)):
            continue
        if not (max(top, 0.0) <= v <= min(bottom, height - 1.0)):
            continue
        column = int(min(max((u - left) / across * cells, 0.0), cells - 1.0))
        row = int(min(max((v - top) / down * cells, 0.0), cells - 1.0))
        cell = nearest[row * cells + column]
        if z < cell[2]:
            cell[0], cell[1], cell[2], cell[3], cell[4] = x, y, z, u, v
    shifts = np.empty(cells * cells)
    count = 0
    for k in range(cells * cells):
        x, y, z = nearest[k, 0], nearest[k, 1], nearest[k, 2]
        if z == np.inf:
            continue
        measured = _reading(depth, int(np.rint(nearest[k, 4])), int(np.rint(nearest[k, 3])), edge)
        if measured > 0.0:
            shifts[count] = (measured - z) * np.sqrt(x * x + y * y + z * z) / z
            count += 1
    return shifts[:count]


@kernel
@no_type_check
def _reading(depth, row, column, edge):
    """The depth there, 0 where it is none or beside an edge."""
    center = depth[row, column]
    low = high = center
    for v in range(max(row - 1, 0), min(row + 2, depth.shape[0])):
        for u in range(max(column - 1, 0), min(column + 2, depth.shape[1])):
            high = max(high, depth[v, u])
            if depth[v, u] > 0.0:
                low = min(low, depth[v, u])
    return center if np.float64(high) - np.float64(low) <= edge else 0.0


@kernel
@no_type_check
def front_readings(points, normals, T, K, depth, margin):
    """Readings at the points that face the camera: all, those on the surface, those before it.

    Args:
        points: (n, 3) in the part's frame.
        normals: outward there.
        T: T_camera_part.
        K: intrinsics.
        depth: planar, metres, 0 = none.
        margin: readings this near to the surface are on it, metres.
    """
    height, width = depth.shape
    count = on = before = 0
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
        y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
        z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        if z <= 1e-3:
            continue
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        facing = x * (T[0, 0] * a + T[0, 1] * b + T[0, 2] * c)
        facing += y * (T[1, 0] * a + T[1, 1] * b + T[1, 2] * c)
        facing += z * (T[2, 0] * a + T[2, 1] * b + T[2, 2] * c)
        if facing >= 0.0:
            continue
        u = np.rint(K[0, 0] * x / z + K[0, 1] * y / z + K[0, 2])
        v = np.rint(K[1, 1] * y / z + K[1, 2])
        if not (0.0 <= u <= width - 1.0 and 0.0 <= v <= height - 1.0):
            continue
        measured = depth[int(v), int(u)]
        if measured > 0.0:
            gap = np.float64(measured) - z
            count += 1
            on += abs(gap) <= margin
            before += gap < -margin
    return count, on, before


@kernel
@no_type_check
def deepest(Ts, corners, table, depth, K):
    """How deep the lowest corner (k, 3) lies under a plane in each pose (c, 4, 4), metres, 0 or more.

    Args:
        Ts: poses in the camera's frame.
        corners: metres, part frame.
        table: normal and offset.
        depth: planar depth image, metres, 0 = none.
        K: its intrinsics.
    """
    normal, offset = table
    deep = np.zeros(len(Ts))
    height, width = depth.shape
    for c in range(len(Ts)):
        T = Ts[c]
        for k in range(len(corners)):
            a, b, d = corners[k, 0], corners[k, 1], corners[k, 2]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * d + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * d + T[1, 3]
            z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * d + T[2, 3]
            along = x * normal[0] + y * normal[1] + z * normal[2]
            under = -(along + offset)
            if z <= 0 or under <= deep[c]:
                continue
            column = int(np.floor(K[0, 0] * x / z + K[0, 2] + 0.5))
            row = int(np.floor(K[1, 1] * y / z + K[1, 2] + 0.5))
            if not (0 <= row < height and 0 <= column < width):
                continue
            there = offset / max(-along / z, 1e-6)
            if depth[row, column] < there + BEYOND:
                deep[c] = under
    return deep


@kernel
@no_type_check
def heights_around(depth, window, step, box_xyxy, table, K):
    """How high readings in a window, but not in a box, lie above a plane, metres; those near it alone.

    Args:
        depth: planar depth image, metres, 0 = none.
        window: first and last column and row: x0, y0, x1, y1.
        step: every how many pixels one is read.
        box_xyxy: pixels.
        table: normal and offset of the plane.
        K: intrinsics.
    """
    normal, offset = table
    x0, y0, x1, y1 = window
    heights = np.empty(((y1 - y0) // step + 1) * ((x1 - x0) // step + 1))
    count = 0
    for row in range(y0, y1 + 1, step):
        across = normal[1] * (row - K[1, 2]) / K[1, 1] + normal[2]
        is_beside = box_xyxy[1] <= row <= box_xyxy[3]
        for column in range(x0, x1 + 1, step):
            z = depth[row, column]
            if z <= 0 or (is_beside and box_xyxy[0] <= column <= box_xyxy[2]):
                continue
            height = z * (normal[0] * (column - K[0, 2]) / K[0, 0] + across) + offset
            if abs(height) < BEYOND:
                heights[count] = height
                count += 1
    return heights[:count]


@kernel
@no_type_check
def readings_along(depth, K, R_camera_view, focal, side):
    """A depth image as a view with the same centre has it, (side, side), nearest readings, 0 = none.

    Args:
        depth: planar, metres, 0 = none.
        K: its intrinsics.
        R_camera_view: the view's camera in the image's.
        focal: of the view, cells; its principal point is the middle.
        side: of the view, cells.
    """
    R = R_camera_view
    height, width = depth.shape
    found = np.zeros((side, side))
    for row in range(side):
        y = (row - (side - 1) / 2) / focal
        for column in range(side):
            x = (column - (side - 1) / 2) / focal
            ahead = R[2, 0] * x + R[2, 1] * y + R[2, 2]
            if ahead <= 1e-3:
                continue
            right = R[0, 0] * x + R[0, 1] * y + R[0, 2]
            down = R[1, 0] * x + R[1, 1] * y + R[1, 2]
            u = np.rint(K[0, 0] * right / ahead + K[0, 2])
            v = np.rint(K[1, 1] * down / ahead + K[1, 2])
            if 0 <= u < width and 0 <= v < height:
                # A point at planar depth d on a ray of unit view depth lies at d / (ray's planar depth).
                found[row, column] = depth[int(v), int(u)] / ahead
    return found
