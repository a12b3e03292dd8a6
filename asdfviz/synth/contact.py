"""Where solids touch and interpenetrate: inside tests by ray parity, ways in which a part slides home."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from asdfviz.datatypes import Mesh
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse

# Odd directions, so that rays do not run along faces and edges of CAD parts.
_RAYS = np.array([[0.411, 0.287, 0.865], [-0.713, 0.534, 0.454], [0.238, -0.871, -0.430]])


def points_inside(points: Points, mesh: Mesh) -> Bool[np.ndarray, "n"]:
    """Whether points (in the mesh's frame) lie inside, by the majority of three ray parities.

    The majority makes it useful for light meshes with small holes, too.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    result = np.zeros(len(points), dtype=bool)
    near = np.nonzero(((points > low) & (points < high)).all(axis=1))[0]
    if len(near) == 0:
        return result
    votes = np.zeros(len(near), dtype=int)
    for ray in _RAYS / np.linalg.norm(_RAYS, axis=1, keepdims=True):
        votes += _crossings(points[near], ray, mesh) % 2
    result[near] = votes >= 2
    return result


def _crossings(points: Points, ray: Vector, mesh: Mesh) -> np.ndarray:
    """How many triangles each ray crosses (Möller and Trumbore, 1997)."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    edge_1, edge_2 = b - a, c - a
    p = np.cross(ray, edge_2)
    determinant = (edge_1 * p).sum(axis=1)
    usable = np.abs(determinant) > 1e-15
    scale = 1.0 / np.where(usable, determinant, 1.0)
    count = np.zeros(len(points), dtype=int)
    for start in range(0, len(points), 64):
        s = points[start : start + 64, None] - a
        u = (s * p).sum(axis=2) * scale
        q = np.cross(s, edge_1)
        v = (q @ ray) * scale
        t = (q * edge_2).sum(axis=2) * scale
        hit = usable & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        count[start : start + 64] = hit.sum(axis=1)
    return count


def approach(
    mesh: Mesh,
    T_base_part: Transform,
    others: Sequence[tuple[Mesh, Transform]],
    candidates: Sequence[Vector],
    *,
    distance: float,
) -> Vector:
    """The direction (base frame) from which a part reaches its place with the least interpenetration.

    Args:
        mesh: the part.
        T_base_part: its place.
        others: meshes that are there already, with T_base_other.
        candidates: unit vectors in the base frame, from the place outwards.
        distance: how far out the way begins, metres.
    """
    samples = apply(T_base_part, surface_points(mesh.vertices, mesh.faces, 160, seed=3))
    best, least = candidates[0], np.inf
    for direction in candidates:
        inside = 0.0
        for share in (0.12, 0.3, 0.55, 0.8, 1.0):
            moved = samples + direction * (share * distance)
            for other, T_base_other in others:
                local = apply(inverse(T_base_other), moved)
                inside += float(points_inside(local, other).sum())
        if inside < least:
            best, least = direction, inside
    return best
