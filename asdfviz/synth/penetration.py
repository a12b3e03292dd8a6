"""How deep solids stand in one another: what scripts avoid, and what their tests measure.

Inside is asked by rays: each of three odd directions has the triangles sorted into a grid across it,
so that a point meets only the triangles of its own column. The majority of the three makes light
meshes with small holes useful too. Depth is the distance to the nearest triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from asdfviz.datatypes import Mesh
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Points, Rotation, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, rotation_about

_COLUMNS = 48
_SAMPLES = 1500
_CHUNK = 200_000
_FEW = 600
_AT_ONCE = 16
_NEXT = np.array([1, 2, 0])


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Triangles seen along one direction, sorted into columns."""

    R: Rotation
    """Turns the direction to +z."""
    triangles: Float64[np.ndarray, "f 3 3"]
    low: Float64[np.ndarray, "2"]
    cell: float
    starts: Int64[np.ndarray, "_"]
    order: Int64[np.ndarray, "_"]


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """What distances from triangles need to know of them."""

    normals: Float64[np.ndarray, "f 3"]
    """Unit vectors; zero where a triangle has no area."""
    edges: Float64[np.ndarray, "3 f 3"]
    """From each corner to the next."""
    sides: Float64[np.ndarray, "3 f 3"]
    """Across each edge, inwards, as long as it."""
    areas: Float64[np.ndarray, "f"]
    """Square metres."""
    squares: Float64[np.ndarray, "3 f"]
    """Of the edges' lengths, not quite 0."""
    from_corner: Float64[np.ndarray, "3 f"]
    """|corner|^2."""
    along_corner: Float64[np.ndarray, "3 f"]
    """corner . edge."""
    across_corner: Float64[np.ndarray, "3 f"]
    """corner . side."""
    heights: Float64[np.ndarray, "f"]
    """Of the triangles' planes: first corner . normal."""
    low: Float64[np.ndarray, "f 3"]
    high: Float64[np.ndarray, "f 3"]
    """Corners of the triangles' bounding boxes."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A mesh prepared for inside tests, in its own frame, metres."""

    triangles: Float64[np.ndarray, "f 3 3"]
    planes: Planes
    samples: Float64[np.ndarray, "s 3"]
    """Corners and points spread over the faces."""
    low: Float64[np.ndarray, "3"]
    high: Float64[np.ndarray, "3"]
    columns: tuple[Columns, ...]

    @property
    def middle(self) -> Vector:
        """Middle of the bounding box."""
        return (self.low + self.high) / 2


def solid_of(mesh: Mesh, *, samples: int = _SAMPLES) -> Solid:
    """Prepare a mesh with `samples` points spread over its faces and at most as many of its corners."""
    spread = surface_points(mesh.vertices, mesh.faces, samples, seed=3)
    # Of faces alone: what lies on no face would tell a distance from the surface that is none.
    corners = np.unique(mesh.vertices[np.unique(mesh.faces)], axis=0)
    points = np.concatenate([corners[:: len(corners) // samples + 1], spread])
    triangles = mesh.vertices[mesh.faces]
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
    low, high = points.min(axis=0), points.max(axis=0)
    return Solid(triangles, _planes(triangles), points, low, high, columns)


def _planes(triangles: Float64[np.ndarray, "f 3 3"]) -> Planes:
    edges = np.stack([triangles[:, (k + 1) % 3] - triangles[:, k] for k in range(3)])
    normals = np.cross(edges[0], -edges[2])
    length = np.linalg.norm(normals, axis=1)
    normals = np.where(length[:, None] > 1e-15, normals / np.maximum(length, 1e-18)[:, None], 0.0)
    sides = np.cross(normals, edges)
    corners = triangles.transpose(1, 0, 2)
    return Planes(
        normals=normals,
        edges=edges,
        sides=sides,
        areas=length / 2,
        squares=np.maximum((edges * edges).sum(axis=2), 1e-18),
        from_corner=(corners * corners).sum(axis=2),
        along_corner=(corners * edges).sum(axis=2),
        across_corner=(corners * sides).sum(axis=2),
        heights=(corners[0] * normals).sum(axis=1),
        low=triangles.min(axis=1),
        high=triangles.max(axis=1),
    )


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
    return Columns(R, turned, low, cell, starts, owner[order])


def expand(counts: Int64[np.ndarray, "n"]) -> tuple[np.ndarray, np.ndarray]:
    """Owner and place within the owner of every element of ranges laid behind one another."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def inside(points: Points, solid: Solid) -> Bool[np.ndarray, "n"]:
    """Whether points (in the solid's frame) lie inside it."""
    found = np.zeros(len(points), dtype=bool)
    near = np.nonzero(_all_axes((points > solid.low) & (points < solid.high)))[0]
    if len(near):
        first, second, third = solid.columns
        within = _crossings(points[near], first) % 2 == 1
        doubted = np.nonzero(within != (_crossings(points[near], second) % 2 == 1))[0]
        within[doubted] = _crossings(points[near[doubted]], third) % 2 == 1
        found[near] = within
    return found


def _all_axes(holds: Bool[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    # Many times as fast as all(axis=1), whose loop is over three values.
    return holds[:, 0] & holds[:, 1] & holds[:, 2]


def _crossings(points: Points, columns: Columns) -> np.ndarray:
    """How many triangles a ray from each point along the columns' direction crosses."""
    p = points @ columns.R.T
    cells = np.floor((p[:, :2] - columns.low) / columns.cell).astype(int)
    fits = (cells >= 0) & (cells <= _COLUMNS)
    within = fits[:, 0] & fits[:, 1]
    ids = np.where(within, cells[:, 1] * (_COLUMNS + 1) + cells[:, 0], 0)
    counts = np.where(within, columns.starts[ids + 1] - columns.starts[ids], 0)
    owner, place = expand(counts)
    t = columns.triangles[columns.order[columns.starts[ids[owner]] + place]]
    q = p[owner]
    x, y = (t[:, :, k] - q[:, None, k] for k in range(2))
    # Edge functions, each the weight of the corner opposite to the edge.
    a, b, c = (x[:, k] * y[:, _NEXT[k]] - y[:, k] * x[:, _NEXT[k]] for k in range(3))
    area = a + b + c
    hit = ((a >= 0) & (b >= 0) & (c >= 0)) | ((a <= 0) & (b <= 0) & (c <= 0))
    z = (b * t[:, 0, 2] + c * t[:, 1, 2] + a * t[:, 2, 2]) / np.where(area == 0, 1.0, area)
    return np.bincount(owner[hit & (area != 0) & (z > q[:, 2])], minlength=len(points))


def surface_distance(points: Points, solid: Solid) -> Float64[np.ndarray, "n"]:
    """Distance of points (in the solid's frame) from its surface, metres."""
    if not len(points):
        return np.empty(0)
    near = _nearby(points, solid, float(_bounds(points, solid).max()))
    result = np.empty(len(points))
    count = max(1, _CHUNK // len(near))
    for start in range(0, len(points), count):
        result[start : start + count] = _to_triangles(points[start : start + count], solid, near)
    return result


def _bounds(points: Points, solid: Solid) -> Float64[np.ndarray, "n"]:
    """At most this far is each point from the surface: the distance from some of its points."""
    few = solid.samples[:: len(solid.samples) // _FEW + 1]
    squares = (
        (points * points).sum(axis=1)[:, None] - 2 * (points @ few.T) + (few * few).sum(axis=1)
    )
    return np.sqrt(np.maximum(squares.min(axis=1), 0.0)) + 1e-6


def _nearby(points: Points, solid: Solid, reach: float) -> Int64[np.ndarray, "k"]:
    """The triangles that come this near to the points' bounding box."""
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    return np.nonzero(_all_axes((solid.planes.high >= low) & (solid.planes.low <= high)))[0]


def _deepest(points: Points, solid: Solid) -> float:
    """The largest distance of points from the surface, metres: the likeliest are asked first."""
    bounds = _bounds(points, solid)
    order = np.argsort(-bounds, kind="stable")
    deepest = 0.0
    for start in range(0, len(order), _AT_ONCE):
        some = order[start : start + _AT_ONCE]
        if bounds[some[0]] <= deepest:
            break
        near = _nearby(points[some], solid, float(bounds[some[0]]))
        deepest = max(deepest, float(_to_triangles(points[some], solid, near).max()))
    return deepest


def _to_triangles(points: Points, solid: Solid, near: Int64[np.ndarray, "k"]) -> np.ndarray:
    """Distance of each point from the nearest triangle: over its inside, else along its edges."""
    planes = solid.planes
    normals = planes.normals[near]
    nearest = np.full((len(points), len(near)), np.inf)
    over = np.broadcast_to(normals.any(axis=1), nearest.shape).copy()
    squares = (points * points).sum(axis=1)[:, None]
    for k in range(3):
        square = planes.squares[k, near]
        # |p - a|^2 and the parts along the edge, without arrays of vectors.
        corners = solid.triangles[near, k]
        away = squares - 2 * (points @ corners.T) + planes.from_corner[k, near]
        along = points @ planes.edges[k, near].T - planes.along_corner[k, near]
        share = np.minimum(np.maximum(along / square, 0), 1)
        np.minimum(nearest, away - share * (2 * along - share * square), out=nearest)
        over &= points @ planes.sides[k, near].T >= planes.across_corner[k, near]
    height = points @ normals.T - planes.heights[near]
    np.copyto(nearest, height * height, where=over)
    return np.sqrt(np.maximum(nearest.min(axis=1), 0.0))


def out_of_reach(middle: Vector, radius: float, solid: Solid) -> bool:
    """Whether a ball (in the solid's frame) cannot reach its bounding box."""
    beyond = np.maximum(np.maximum(solid.low - middle, middle - solid.high), 0.0)
    return float(beyond @ beyond) > radius * radius


def depth(points: Points, solid: Solid, *, most: int | None = None) -> float:
    """How deep the deepest of the points (in the solid's frame) lies inside, metres; 0 outside.

    Args:
        points: metres.
        solid: what they may be in.
        most: of how many of the points inside the depth is measured; of all by default.
    """
    within = points[inside(points, solid)]
    if most is not None:
        within = within[:: len(within) // most + 1]
    return _deepest(within, solid) if len(within) else 0.0


def penetration(a: Solid, b: Solid, T_b_a: Transform, *, most: int | None = None) -> float:
    """How deep the surfaces of two solids stand in each other, metres.

    Measured at the corners and at points spread over the faces of both, so that what is finer than
    their spacing (about 2 mm on a part of 10 cm) may be missed.
    """
    one = depth(apply(T_b_a, a.samples), b, most=most)
    return max(one, depth(apply(inverse(T_b_a), b.samples), a, most=most))
