"""A small z-buffer rasteriser for silhouettes: no OpenGL, so that a tracker runs in any thread.

Used twice: for the views of a viewpoint model, and for the id image by which the tracker knows
which part hides which. An integer pixel is a centre; depth is planar and stored as 1 / z, because
that is linear over the image, with 0 where nothing is.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float32, Int32

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Intrinsics, Transform
from asdfviz.track.jit import kernel

NEAR = 1e-3
"""Triangles that come nearer than this (metres) are left out."""


def new_buffers(
    width: int, height: int
) -> tuple[Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]:
    """Return an empty image of inverse depth (1 / m) and one of ids (-1 = background)."""
    return np.zeros((height, width), np.float32), np.full((height, width), -1, np.int32)


def draw(
    mesh: Mesh,
    T_camera_part: Transform,
    *,
    K: Intrinsics,
    inverse_depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    number: int | None = None,
) -> None:
    """Draw a mesh into both buffers, in place, wherever it is nearer than what is there.

    `number` is what `ids` gets; None gives each triangle's own index.
    """
    triangles(
        mesh.vertices,
        mesh.faces,
        np.ascontiguousarray(T_camera_part),
        np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]),
        -1 if number is None else number,
        inverse_depth,
        ids,
    )


@kernel
@no_type_check
def _crossing(u0, v0, u1, v1, v, low, high):
    """Widen [low, high] by where the edge from (u0, v0) to (u1, v1) meets row v, if it does."""
    if (v < v0 and v < v1) or (v > v0 and v > v1):
        return low, high
    if v0 == v1:
        return min(low, min(u0, u1)), max(high, max(u0, u1))
    u = u0 + (v - v0) * (u1 - u0) / (v1 - v0)
    return min(low, u), max(high, u)


@kernel
@no_type_check
def _triangle(u0, v0, w0, u1, v1, w1, u2, v2, w2, number, inverse_depth, ids):
    """Fill one triangle of screen points (u, v, w = 1/z), row by row between its edges."""
    height, width = inverse_depth.shape
    first = int(np.ceil(max(min(v0, min(v1, v2)), 0.0)))
    last = int(np.floor(min(max(v0, max(v1, v2)), height - 1.0)))
    if first > last:
        return
    if np.ceil(max(min(u0, min(u1, u2)), 0.0)) > min(max(u0, max(u1, u2)), width - 1.0):
        return  # between two columns, as many triangles of a small picture are
    area = (u1 - u0) * (v2 - v0) - (v1 - v0) * (u2 - u0)
    if abs(area) < 1e-6:
        return
    slope_u = ((w1 - w0) * (v2 - v0) - (w2 - w0) * (v1 - v0)) / area
    slope_v = ((w2 - w0) * (u1 - u0) - (w1 - w0) * (u2 - u0)) / area
    for v in range(first, last + 1):
        low, high = _crossing(u0, v0, u1, v1, v, 1e9, -1e9)
        low, high = _crossing(u1, v1, u2, v2, v, low, high)
        low, high = _crossing(u2, v2, u0, v0, v, low, high)
        start = int(np.ceil(max(low, 0.0)))
        stop = int(np.floor(min(high, width - 1.0)))
        value = w0 + slope_u * (start - u0) + slope_v * (v - v0)
        for u in range(start, stop + 1):
            if value > inverse_depth[v, u]:
                inverse_depth[v, u] = value
                ids[v, u] = number
            value += slope_u


@kernel
@no_type_check
def triangles(vertices, faces, T, lens, number, inverse_depth, ids):
    """Draw faces (f,3) of vertices (n,3) moved by T (4,4); lens is fu, fv, cu, cv in pixels."""
    n = len(vertices)
    s = np.empty((n, 3))
    for i in range(n):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        w = 1.0 / depth if depth >= NEAR else -1.0
        s[i, 0] = lens[0] * w * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) + lens[2]
        s[i, 1] = lens[1] * w * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) + lens[3]
        s[i, 2] = w
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if s[i, 2] < 0.0 or s[j, 2] < 0.0 or s[k, 2] < 0.0:
            continue
        name = f if number < 0 else number
        _triangle(
            s[i, 0], s[i, 1], s[i, 2], s[j, 0], s[j, 1], s[j, 2], s[k, 0], s[k, 1], s[k, 2],
            name, inverse_depth, ids,
        )  # fmt: skip
