"""How deep solids stand in one another: what scripts avoid, and what their tests measure.

Depth is the distance of what is inside to the nearest triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from asdfviz.datatypes import Mesh
from asdfviz.geometry.inside import Interior, all_axes, in_cells, interior_of, settled
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse

_SAMPLES = 1500
_CHUNK = 200_000
_FEW = 600
_AT_ONCE = 16


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
    interior: Interior

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
    low, high = points.min(axis=0), points.max(axis=0)
    return Solid(triangles, _planes(triangles), points, low, high, interior_of(triangles))


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
    return np.nonzero(all_axes((solid.planes.high >= low) & (solid.planes.low <= high)))[0]


def _deepest(points: Points, solid: Solid, least: float, enough: float) -> float:
    """The largest distance of points from the surface, metres: the likeliest are asked first."""
    bounds = _bounds(points, solid)
    order = np.argsort(-bounds, kind="stable")
    deepest = 0.0
    for start in range(0, len(order), _AT_ONCE):
        some = order[start : start + _AT_ONCE]
        if bounds[some[0]] <= max(deepest, least) or deepest >= enough:
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


def out_of_reach(
    middles: Points, radii: Float64[np.ndarray, "n"], solid: Solid
) -> Bool[np.ndarray, "n"]:
    """Which balls (in the solid's frame) cannot reach the bounding box of its faces."""
    low, high = solid.interior.low, solid.interior.high
    beyond = np.maximum(np.maximum(low - middles, middles - high), 0.0)
    return (beyond * beyond).sum(axis=1) > radii * radii


def depth(
    points: Points,
    solid: Solid,
    *,
    most: int | None = None,
    least: float = 0.0,
    enough: float = np.inf,
) -> float:
    """How deep the deepest of the points (in the solid's frame) lies inside, metres; 0 outside.

    Args:
        points: metres.
        solid: what they may be in.
        most: of how many of the points inside the depth is measured; of all by default.
        least: a depth up to this may be told as any other up to this.
        enough: from this depth on none that is deeper is looked for.
    """
    possible, doubted = in_cells(points, solid.interior)
    if not len(possible):
        return 0.0
    near = points[possible]
    if least > 0:
        may_count = _bounds(near, solid) > least
        if not may_count.any():
            return 0.0
        if most is None or len(near) < most:
            near, doubted = near[may_count], doubted[may_count]
    within = near[settled(near, doubted, solid.interior)]
    if most is not None:
        within = within[:: len(within) // most + 1]
    return _deepest(within, solid, least, enough) if len(within) else 0.0


def penetration(
    a: Solid,
    b: Solid,
    T_b_a: Transform,
    *,
    most: int | None = None,
    least: float = 0.0,
    enough: float = np.inf,
) -> float:
    """How deep the surfaces of two solids stand in each other, metres.

    Measured at the corners and at points spread over the faces of both, so that what is finer than
    their spacing (about 2 mm on a part of 10 cm) may be missed. `most`, `least` and `enough` are those
    of `depth`.
    """
    one = depth(apply(T_b_a, a.samples), b, most=most, least=least, enough=enough)
    if one >= enough:
        return one
    samples_a = apply(inverse(T_b_a), b.samples)
    return max(one, depth(samples_a, a, most=most, least=max(one, least), enough=enough))
