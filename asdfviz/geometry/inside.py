"""Whether points lie inside a closed mesh, asked of many points many times.

A coarse grid of cells knows which of them no triangle touches: those are inside or outside as a whole.
Elsewhere rays tell: each of three odd directions has the triangles sorted into a grid across it, so that
a point meets only the triangles of its own column. The majority of the three makes light meshes with
small holes useful too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int8, Int64

from asdfviz.geometry.shapes import Points, Rotation
from asdfviz.geometry.transforms import rotation_about

_COLUMNS = 48
_CELLS = 28
_OUTSIDE, _INSIDE, _MIXED = 0, 1, 2
_NEXT = (1, 2, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Triangles seen along one direction, sorted into columns; one may be in several."""

    R: Rotation
    """Turns the direction to +z."""
    low: Float64[np.ndarray, "2"]
    cell: float
    starts: Int64[np.ndarray, "_"]
    lines: Float64[np.ndarray, "12 e"]
    """Of every entry: factors of x, y and 1 in the three edge functions, which are not negative over the
    triangle, and in the height of its plane. A triangle seen edge-on is nowhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Boxes of space."""

    low: Float64[np.ndarray, "3"]
    size: float
    labels: Int8[np.ndarray, "i j k"]
    """Outside, inside, or touched by a triangle."""


@dataclass(frozen=True, slots=True, eq=False)
class Interior:
    """What tells inside from outside, in the mesh's frame, metres."""

    low: Float64[np.ndarray, "3"]
    high: Float64[np.ndarray, "3"]
    columns: tuple[Columns, ...]
    cells: Cells


def interior_of(triangles: Float64[np.ndarray, "f 3 3"]) -> Interior:
    """Prepare a mesh."""
    # Odd turns, so that rays do not run along faces and edges of CAD parts.
    turns = [
        rotation_about(np.array(axis), angle)
        for axis, angle in (
            ((0.41, 0.29, 0.86), 0.9),
            ((-0.71, 0.53, 0.45), 2.0),
            ((1.0, 0.3, 0.0), 4.0),
        )
    ]
    columns = tuple(_columns(triangles, R) for R in turns)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    return Interior(low, high, columns, _cells(triangles, columns, low, high))


def _columns(triangles: Float64[np.ndarray, "f 3 3"], R: Rotation) -> Columns:
    turned = triangles @ R.T
    flat = turned[:, :, :2]
    low = flat.min(axis=(0, 1)) - 1e-9
    cell = float((flat.max(axis=(0, 1)) - low).max()) / _COLUMNS + 1e-9
    first = ((flat.min(axis=1) - low) / cell).astype(int)
    last = ((flat.max(axis=1) - low) / cell).astype(int)
    size = last - first + 1
    owner, place = expand(size.prod(axis=1))
    cells = first[owner] + np.stack([place % size[owner, 0], place // size[owner, 0]], axis=1)
    ids = cells[:, 1] * (_COLUMNS + 1) + cells[:, 0]
    order = np.argsort(ids, kind="stable")
    starts = np.searchsorted(ids[order], np.arange((_COLUMNS + 1) ** 2 + 1))
    return Columns(R, low, cell, starts, np.ascontiguousarray(_lines(turned)[:, owner[order]]))


def _lines(turned: Float64[np.ndarray, "f 3 3"]) -> Float64[np.ndarray, "12 f"]:
    """Factors of x, y and 1 in the edge functions and in the height."""
    x, y, z = (turned[:, :, k] for k in range(3))
    edges = [
        (
            y[:, k] - y[:, _NEXT[k]],
            x[:, _NEXT[k]] - x[:, k],
            x[:, k] * y[:, _NEXT[k]] - x[:, _NEXT[k]] * y[:, k],
        )
        for k in range(3)
    ]
    area = sum(constant for *_, constant in edges)
    flat = area == 0
    sign = np.where(area < 0, -1.0, 1.0)
    # Each edge function over the area is the weight of the corner opposite to the edge.
    whole = np.where(flat, 1.0, area)
    height = [sum(edges[k][m] * z[:, (k + 2) % 3] for k in range(3)) / whole for m in range(3)]
    lines = np.array([*(sign * factor for edge in edges for factor in edge), *height])
    lines[:3, flat] = np.array([[0.0], [0.0], [-1.0]])
    return lines


def _cells(
    triangles: Float64[np.ndarray, "f 3 3"],
    columns: tuple[Columns, ...],
    low: Float64[np.ndarray, "3"],
    high: Float64[np.ndarray, "3"],
) -> Cells:
    size = float((high - low).max()) / _CELLS + 1e-9
    counts = ((high - low) / size).astype(int) + 1
    labels = np.full(tuple(counts), _OUTSIDE, np.int8)
    # A little more than the boxes of the triangles, against rounding.
    first = np.maximum(((triangles.min(axis=1) - low) / size - 1e-6).astype(int), 0)
    last = np.minimum(((triangles.max(axis=1) - low) / size + 1e-6).astype(int), counts - 1)
    extent = last - first + 1
    owner, place = expand(extent.prod(axis=1))
    wide, deep = extent[owner, 0], extent[owner, 1]
    i = first[owner, 0] + place % wide
    j = first[owner, 1] + place // wide % deep
    k = first[owner, 2] + place // (wide * deep)
    labels[i, j, k] = _MIXED
    free = np.argwhere(labels != _MIXED)
    middles = low + (free + 0.5) * size
    labels[tuple(free.T)] = np.where(_by_rays(middles, columns), _INSIDE, _OUTSIDE)
    return Cells(low, size, labels)


def expand(counts: Int64[np.ndarray, "n"]) -> tuple[np.ndarray, np.ndarray]:
    """Owner and place within the owner of every element of ranges laid behind one another."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def inside(points: Points, interior: Interior) -> Bool[np.ndarray, "n"]:
    """Which points (in the mesh's frame) lie inside it."""
    found = np.zeros(len(points), dtype=bool)
    near, doubted = in_cells(points, interior)
    found[near] = settled(points[near], doubted, interior)
    return found


def in_cells(
    points: Points, interior: Interior
) -> tuple[Int64[np.ndarray, "k"], Bool[np.ndarray, "k"]]:
    """Which points (in the mesh's frame) may lie inside it, and whether only rays can tell: a quick look."""
    near = np.nonzero(all_axes((points > interior.low) & (points < interior.high)))[0]
    if not len(near):
        return near, np.zeros(0, dtype=bool)
    cells = interior.cells
    i, j, k = ((points[near] - cells.low) / cells.size).astype(int).T
    label = cells.labels[i, j, k]
    possible = label != _OUTSIDE
    return near[possible], label[possible] == _MIXED


def settled(
    points: Points, doubted: Bool[np.ndarray, "n"], interior: Interior
) -> Bool[np.ndarray, "n"]:
    """Whether points that `in_cells` named lie inside: rays are asked of those that it doubted alone."""
    within = ~doubted
    if doubted.any():
        within[doubted] = _by_rays(points[doubted], interior.columns)
    return within


def _by_rays(points: Points, columns: tuple[Columns, ...]) -> Bool[np.ndarray, "n"]:
    first, second, third = columns
    within = _crossings(points, first) % 2 == 1
    doubted = np.nonzero(within != (_crossings(points, second) % 2 == 1))[0]
    if len(doubted):
        within[doubted] = _crossings(points[doubted], third) % 2 == 1
    return within


def all_axes(holds: Bool[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether something holds on all three axes."""
    # Many times as fast as all(axis=1), whose loop is over three values.
    return holds[:, 0] & holds[:, 1] & holds[:, 2]


def _crossings(points: Points, columns: Columns) -> Int64[np.ndarray, "n"]:
    """How many triangles a ray from each point along the columns' direction crosses."""
    x, y, z = columns.R @ points.T
    i = np.floor((x - columns.low[0]) / columns.cell).astype(int)
    j = np.floor((y - columns.low[1]) / columns.cell).astype(int)
    within = (i >= 0) & (i <= _COLUMNS) & (j >= 0) & (j <= _COLUMNS)
    ids = np.where(within, j * (_COLUMNS + 1) + i, 0)
    counts = np.where(within, columns.starts[ids + 1] - columns.starts[ids], 0)
    owner, place = expand(counts)
    entry = columns.starts[ids[owner]] + place
    # The height first: it leaves half of the entries to the edges, and each of these fewer.
    for k in (9, 0, 3, 6):
        of_x, of_y, constant = (line.take(entry) for line in columns.lines[k : k + 3])
        value = of_x * x.take(owner) + of_y * y.take(owner) + constant
        hit = value > z.take(owner) if k == 9 else value >= 0
        owner, entry = owner[hit], entry[hit]
    return np.bincount(owner, minlength=len(points))
