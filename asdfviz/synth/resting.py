"""Poses in which things lie still on a table, and footprints that must not overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull  # pyright: ignore[reportMissingTypeStubs] - scipy has none

from asdfviz.geometry.shapes import Points, Rotation
from asdfviz.geometry.transforms import rotation_about

Outline = Float64[np.ndarray, "_ 2"]


@dataclass(frozen=True, slots=True, eq=False)
class RestingFace:
    """A facet of the convex hull on which a thing can stand."""

    R_world_part: Rotation
    """Turns the facet down; any turn about z may follow."""
    probability: float
    margin: float
    """Distance of the centre of mass from the facet's border, seen from above, metres."""


def resting_faces(points: Points) -> tuple[RestingFace, ...]:
    """Facets over which the centre of mass lies, with how likely a throw ends on each.

    The probability goes with the facet's solid angle seen from the centre of mass, a common
    quasi-static estimate; the hull's centroid stands for the centre of mass.
    """
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    center, equations = _centroid(points, hull), np.asarray(hull.equations, np.float64)
    groups: dict[tuple[int, ...], list[int]] = {}
    for k, plane in enumerate(equations):
        key = tuple(round(float(v) * s) for v, s in zip(plane, (40, 40, 40, 2500), strict=True))
        groups.setdefault(key, []).append(k)
    found: list[RestingFace] = []
    for members in groups.values():
        normal = equations[members][:, :3].mean(axis=0)
        normal /= np.linalg.norm(normal)
        angle = float(sum(_solid_angle(corners[k] - center) for k in members))
        R = _turn_down(normal)
        facet = np.unique(corners[members].reshape(-1, 3), axis=0) @ R.T
        margin = _margin(facet[:, :2], (R @ center)[:2])
        if margin > 0.0002:
            found.append(RestingFace(R, angle, margin))
    total = sum(f.probability for f in found)
    return tuple(RestingFace(f.R_world_part, f.probability / total, f.margin) for f in found)


def _centroid(points: Points, hull: ConvexHull) -> Float64[np.ndarray, "3"]:
    inner = points[hull.vertices].mean(axis=0)
    corners = points[hull.simplices] - inner
    volume = np.abs(np.linalg.det(corners))
    return inner + (corners.sum(axis=1) / 4 * volume[:, None]).sum(axis=0) / volume.sum()


def _solid_angle(triangle: Float64[np.ndarray, "3 3"]) -> float:
    """Van Oosterom and Strackee (1983)."""
    a, b, c = triangle
    la, lb, lc = np.linalg.norm(triangle, axis=1)
    top = abs(float(a @ np.cross(b, c)))
    return 2 * float(np.arctan2(top, la * lb * lc + (a @ b) * lc + (b @ c) * la + (c @ a) * lb))


def _turn_down(normal: Float64[np.ndarray, "3"]) -> Rotation:
    down = np.array([0.0, 0.0, -1.0])
    axis = np.cross(normal, down)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3) if normal[2] < 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_about(axis, float(np.arctan2(length, normal @ down)))


def _margin(facet: Outline, point: Float64[np.ndarray, "2"]) -> float:
    if np.ptp(facet, axis=0).min() < 1e-6:
        return -1.0
    hull = ConvexHull(facet, qhull_options="QJ")
    return float(-(hull.equations[:, :2] @ point + hull.equations[:, 2]).max())


def footprint(points_world: Points) -> Outline:
    """Convex outline of a thing seen from above, counter-clockwise."""
    hull = ConvexHull(points_world[:, :2], qhull_options="QJ")
    return points_world[hull.vertices, :2].copy()


def overlap(a: Outline, b: Outline, *, gap: float) -> bool:
    """Whether two convex outlines come nearer than `gap` metres (separating axes)."""
    for outline in (a, b):
        edges = np.roll(outline, -1, axis=0) - outline
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
        pa, pb = a @ normals.T, b @ normals.T
        apart = (pa.min(axis=0) - pb.max(axis=0) > gap) | (pb.min(axis=0) - pa.max(axis=0) > gap)
        if bool(apart.any()):
            return False
    return True
