"""Where a ray meets a mesh: picking a part under the pointer, without OpenGL."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, inverse


def intersect(
    origin: Vector, direction: Vector, mesh: Mesh, T_world_mesh: Transform
) -> float | None:
    """Return the distance (metres) along the ray to the first face, or None if it misses.

    Every face counts from both sides (Moeller and Trumbore, 1997, all faces at once).

    Args:
        origin: start of the ray, world frame, metres.
        direction: any length but zero, world frame.
        mesh: the surface.
        T_world_mesh: where it is.
    """
    T_mesh_world = inverse(T_world_mesh)
    start = apply(T_mesh_world, origin[None])[0]
    ray = T_mesh_world[:3, :3] @ (direction / np.linalg.norm(direction))
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    edge_b, edge_c = b - a, c - a
    across = np.cross(ray, edge_c)
    determinant = np.einsum("fi,fi->f", edge_b, across)
    # Twice the area times the cosine of incidence, m^2: zero for a face seen edge-on.
    facing = np.abs(determinant) > 1e-15
    scale = 1.0 / np.where(facing, determinant, 1.0)
    away = start - a
    u = np.einsum("fi,fi->f", away, across) * scale
    turned = np.cross(away, edge_b)
    v = (turned @ ray) * scale
    distance = np.einsum("fi,fi->f", edge_c, turned) * scale
    hit = facing & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (distance > 0)
    return float(distance[hit].min()) if hit.any() else None
