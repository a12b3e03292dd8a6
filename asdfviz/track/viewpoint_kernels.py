"""Samples one rendered view: its outline in pixels, and points in the part's axes."""

from __future__ import annotations

from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int32

from asdfviz.track.jit import kernel

CHORD_PX = 3
"""A normal stands on the chord between the contour pixels this many steps before and after."""
SHORTEST_PX = 15
"""Contours of fewer pixels are specks and left out."""
FAR = 1e6
"""Stands for a width that no picture ended, metres."""
# Powers of the inverse of the plastic number.
R2_U, R2_V = 0.7548776662466927, 0.5698402909980532
PROBES = 10
"""Steps from the middle to the rim of the largest occlusion radius."""


def outline(
    inverse_depth: Float32[np.ndarray, "h w"],
) -> tuple[Int32[np.ndarray, "n 2"], Float64[np.ndarray, "n 2"]]:
    """Return all contour pixels (u, v), inner contours too, and the unit normals out of the part.

    Pixels whose chord is so short that it has no direction are left out.
    """
    mask = (inverse_depth > 0).astype(np.uint8)
    found, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    pixels: list[np.ndarray] = [np.zeros((0, 2), np.int32)]
    normals: list[np.ndarray] = [np.zeros((0, 2))]
    for contour in found:
        if len(contour) < SHORTEST_PX:
            continue
        points = np.asarray(contour, np.int32)[:, 0]
        chord = (np.roll(points, -CHORD_PX, axis=0) - np.roll(points, CHORD_PX, axis=0)).astype(
            np.float64
        )
        length = np.linalg.norm(chord, axis=1)
        usable = length > CHORD_PX
        # OpenCV follows a contour with the part on a fixed hand, holes included.
        outwards = np.stack([-chord[:, 1], chord[:, 0]], axis=1)[usable]
        pixels.append(points[usable])
        normals.append(outwards / length[usable, None])
    return np.concatenate(pixels), np.concatenate(normals)


def edge_distances(
    inverse_depth: Float32[np.ndarray, "h w"],
) -> Float32[np.ndarray, "h w"]:
    """How far the middle of each pixel of the silhouette is from where that ends, pixels."""
    mask = (inverse_depth > 0).astype(np.uint8)
    # To the next pixel outside, half of which is not its middle yet.
    return np.maximum(cv2.distanceTransform(mask, cv2.DIST_L2, 3) - np.float32(0.5), 0)


@kernel
@no_type_check
def spread_pixels(ids, wanted, start):
    """Pick `wanted` pixels with an id, any first few of which are spread over the silhouette too.

    They follow the R2 sequence (Roberts, 2018) over the bounding box, from `start` (2,) on.

    Returns:
        their flat indices, and how many pixels the silhouette has; 0 means that there are none.
    """
    height, width = ids.shape
    count, left, right, top, bottom = 0, width, -1, height, -1
    for v in range(height):
        for u in range(width):
            if ids[v, u] >= 0:
                count += 1
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    picked = np.zeros(wanted, np.int64)
    found, k = 0, 0
    while found < wanted and count > 0:
        u = left + int((right - left + 1) * ((start[0] + k * R2_U) % 1.0))
        v = top + int((bottom - top + 1) * ((start[1] + k * R2_V) % 1.0))
        k += 1
        if ids[v, u] >= 0:
            picked[found] = v * width + u
            found += 1
    return picked, count


@kernel
@no_type_check
def _width(inverse_depth, u, v, step_u, step_v, inside):
    """Steps of one pixel until the silhouette is left (inside) or met again; -1 at the border."""
    height, width = inverse_depth.shape
    steps = 1
    while True:
        x, y = int(np.floor(u + steps * step_u + 0.5)), int(np.floor(v + steps * step_v + 0.5))
        if x < 0 or y < 0 or x >= width or y >= height:
            return -1
        if (inverse_depth[y, x] > 0.0) != inside:
            return steps
        steps += 1


@kernel
@no_type_check
def _offsets(inverse_depth, u, v, lens, radii, out):
    """How much nearer than pixel (u, v) the picture comes within each radius (metres)."""
    height, width = inverse_depth.shape
    z = 1.0 / inverse_depth[v, u]
    scale = lens[0] / z
    stride = max(1, int(radii[-1] * scale / PROBES))
    reach = int(radii[-1] * scale) // stride
    nearest = np.full(len(radii), z)
    for j in range(-reach, reach + 1):
        for i in range(-reach, reach + 1):
            x, y = u + i * stride, v + j * stride
            if x < 0 or y < 0 or x >= width or y >= height or inverse_depth[y, x] <= 0.0:
                continue
            distance = np.sqrt(float(i * i + j * j)) * stride / scale
            near = 1.0 / inverse_depth[y, x]
            for r in range(len(radii)):
                if distance <= radii[r] and near < nearest[r]:
                    nearest[r] = near
    for r in range(len(radii)):
        out[r] = z - nearest[r]


@kernel
@no_type_check
def _to_part(T, u, v, z, lens, out):
    """Write the part-frame point that lies at depth z behind pixel (u, v)."""
    x = (u - lens[1]) * z / lens[0] - T[0, 3]
    y = (v - lens[1]) * z / lens[0] - T[1, 3]
    w = z - T[2, 3]
    for i in range(3):
        out[i] = T[0, i] * x + T[1, i] * y + T[2, i] * w


@kernel
@no_type_check
def contour_points(pixels, normals, inverse_depth, T, lens, radii, points, offsets):
    """Fill rows of CONTOUR_COLUMNS from outline pixels (n,2) and their normals (n,2)."""
    for k in range(len(pixels)):
        u, v = pixels[k, 0], pixels[k, 1]
        n_u, n_v = normals[k, 0], normals[k, 1]
        z = 1.0 / inverse_depth[v, u]
        # The edge lies between this pixel, the last inside, and its neighbour along the normal.
        half = 0.5 * max(abs(n_u), abs(n_v))
        _to_part(T, u + half * n_u, v + half * n_v, z, lens, points[k])
        for i in range(3):
            points[k, 3 + i] = T[0, i] * n_u + T[1, i] * n_v
        metres = z / lens[0]
        inner = _width(inverse_depth, float(u), float(v), -n_u, -n_v, True)
        outer = _width(inverse_depth, u + n_u, v + n_v, n_u, n_v, False)
        points[k, 6] = inner * metres if inner >= 0 else FAR
        points[k, 7] = outer * metres if outer >= 0 else FAR
        _offsets(inverse_depth, u, v, lens, radii, offsets[k])


@kernel
@no_type_check
def surface_points(pixels, normals, edges, inverse_depth, T, lens, radii, points, offsets):
    """Fill rows of SURFACE_COLUMNS from flat pixel indices (n,) and normals in part axes (n,3).

    `edges` is how far each pixel is from the outline, pixels.
    """
    width = inverse_depth.shape[1]
    for k in range(len(pixels)):
        u, v = pixels[k] % width, pixels[k] // width
        _to_part(T, float(u), float(v), 1.0 / inverse_depth[v, u], lens, points[k])
        for i in range(3):
            points[k, 3 + i] = normals[k, i]
        points[k, 6] = edges[v, u] / (inverse_depth[v, u] * lens[0])
        _offsets(inverse_depth, u, v, lens, radii, offsets[k])
