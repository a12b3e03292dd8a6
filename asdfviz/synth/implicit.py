"""Meshes an implicit surface by naive surface nets (Gibson, 1998), vectorised; used for hands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Points, Vector

_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_EDGES = [
    (a, b) for a in range(8) for b in range(a + 1, 8) if (_CORNERS[a] ^ _CORNERS[b]).sum() == 1
]

_BLOCK = 4
"""Grid points along a side of the blocks that are looked at first."""
_STEEPEST = 1.3
"""A signed distance of tapered bones grows by no more than this a metre."""


def mesh_implicit(
    distance: Callable[[Points], Float64[np.ndarray, "n"]],
    low: Vector,
    high: Vector,
    *,
    step: float,
) -> Mesh:
    """Mesh the zero set of a signed distance (negative inside) within a box.

    Args:
        distance: signed distance at points, metres.
        low: corner of the box, metres.
        high: opposite corner of the box.
        step: cell size, metres.
    """
    shape = np.ceil((high - low) / step).astype(int) + 1
    values = _sampled(distance, low, shape, step=step)
    cells = shape - 1
    corner_values = np.stack(
        [
            values[c[0] : c[0] + cells[0], c[1] : c[1] + cells[1], c[2] : c[2] + cells[2]]
            for c in _CORNERS
        ]
    )
    inside = corner_values < 0
    mixed = inside.any(axis=0) & ~inside.all(axis=0)
    index = np.full(tuple(cells), -1)
    where = np.argwhere(mixed)
    index[mixed] = np.arange(len(where))
    picked = corner_values[:, mixed]
    total = np.zeros((len(where), 3))
    crossings = np.zeros(len(where))
    for a, b in _EDGES:
        va, vb = picked[a], picked[b]
        crossing = (va < 0) != (vb < 0)
        t = np.where(crossing, va / np.where(crossing, va - vb, 1.0), 0.0)[:, None]
        point = _CORNERS[a] * (1 - t) + _CORNERS[b] * t
        total += np.where(crossing[:, None], point, 0.0)
        crossings += crossing
    vertices = low + step * (where + total / crossings[:, None])
    for _ in range(2):
        vertices = _nearer(distance, vertices, step=step)
    return Mesh(vertices, _quads(values, index))


def _sampled(
    distance: Callable[[Points], Float64[np.ndarray, "n"]],
    low: Vector,
    shape: np.ndarray,
    *,
    step: float,
) -> Float64[np.ndarray, "x y z"]:
    """The distance on a grid, near its zero set; farther away only its sign, as -1 and 1."""
    blocks = -(-shape // _BLOCK)
    middle = (_BLOCK - 1) / 2
    centres = low + step * (_BLOCK * np.indices(tuple(blocks)).reshape(3, -1).T + middle)
    rough = distance(centres).reshape(tuple(blocks))
    # From a block's centre to its corners, and one cell on.
    is_near = np.abs(rough) < _STEEPEST * step * (middle * np.sqrt(3) + 1)
    values = np.where(_spread(rough, shape) < 0, -1.0, 1.0)
    near = np.argwhere(_spread(is_near, shape))
    values[tuple(near.T)] = distance(low + step * near)
    return values


def _spread(blocks: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """What is known of blocks, for each of their cells."""
    for axis in range(3):
        blocks = blocks.repeat(_BLOCK, axis=axis)
    return blocks[: shape[0], : shape[1], : shape[2]]


def _nearer(
    distance: Callable[[Points], Float64[np.ndarray, "n"]], points: Points, *, step: float
) -> Points:
    """Points moved towards the zero set along the gradient (Newton), at most half a cell."""
    nudge = 0.05 * step
    slopes = [
        (distance(points + nudge * axis) - distance(points - nudge * axis)) / (2 * nudge)
        for axis in np.eye(3)
    ]
    gradient = np.stack(slopes, axis=1)
    way = distance(points) / np.maximum((gradient**2).sum(axis=1), 0.25)
    way = np.clip(way, -0.5 * step, 0.5 * step)
    return points - way[:, None] * gradient


def _quads(values: Float64[np.ndarray, "x y z"], index: np.ndarray) -> np.ndarray:
    """Two triangles round every grid edge that the surface crosses."""
    faces: list[np.ndarray] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        first = [slice(None)] * 3
        second = [slice(None)] * 3
        first[axis], second[axis] = slice(0, -1), slice(1, None)
        a, b = values[tuple(first)], values[tuple(second)]
        edge = np.argwhere((a < 0) != (b < 0))
        edge = edge[(edge[:, u] > 0) & (edge[:, v] > 0)]
        edge = edge[(edge[:, u] < index.shape[u]) & (edge[:, v] < index.shape[v])]
        steps = np.eye(3, dtype=int)
        around = [edge - steps[u] - steps[v], edge - steps[v], edge, edge - steps[u]]
        quad = np.stack([index[tuple(p.T)] for p in around], axis=1)
        outwards = a[tuple(edge.T)] < 0
        quad = np.where(outwards[:, None], quad, quad[:, ::-1])
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(faces).astype(np.int32)
