"""Poses in which things lie still on a table, and footprints that must not overlap.

A thing that is put down rolls: over its lowest corner, then over an edge, until its centre of mass
stands over what touches the table. `resting_faces` lets it roll from many sides, which gives the
poses and how often each comes; only numpy and OpenCV are needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import cast

import cv2
import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Points, Rotation, Vector
from asdfviz.geometry.transforms import rotation_about

Outline = Float64[np.ndarray, "_ 2"]
CONTACT = 2e-4
"""Points this near to the table touch it, metres."""
LEAST_MARGIN = 2e-4
"""Rests whose centre of mass stands nearer to the border of the contacts are no rests, metres."""
_DIRECTIONS, _THROWS, _ROLLS = 700, 96, 60


@dataclass(frozen=True, slots=True, eq=False)
class RestingFace:
    """A side on which a thing can stand."""

    R_world_part: Rotation
    """Turns the side down; any turn about z may follow."""
    probability: float
    margin: float
    """Distance of the centre of mass from the border of the contacts, seen from above, metres."""


def center_of_mass(mesh: Mesh) -> Vector:
    """Centre of mass of an evenly filled closed mesh, metres; of its corners if it is not closed."""
    middle = mesh.vertices.mean(axis=0)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - middle for i in range(3))
    volumes = (a * np.cross(b, c)).sum(axis=1)
    total = float(volumes.sum())
    if abs(total) < 1e-12:
        return middle
    found = middle + ((a + b + c) / 4 * volumes[:, None]).sum(axis=0) / total
    within = (found > mesh.vertices.min(axis=0)) & (found < mesh.vertices.max(axis=0))
    return found if bool(within.all()) else middle


def resting_faces(
    points: Points, *, center: Vector | None = None, throws: int = _THROWS
) -> tuple[RestingFace, ...]:
    """Sides on which a thing comes to rest, with the share of throws that end on each.

    Args:
        points: corners of the thing, metres.
        center: its centre of mass; the middle of its outermost points by default.
        throws: from how many sides, evenly spread, it is put down.
    """
    outer = _outermost(points)
    middle = outer.mean(axis=0) if center is None else center
    arms = outer - middle
    ends: list[tuple[Vector, int]] = []
    for down in sphere(throws):
        rest = _roll(arms, down)
        if rest is None:
            continue
        same = next((k for k, (other, _) in enumerate(ends) if rest @ other > 0.9998), None)
        if same is None:
            ends.append((rest, 1))
        else:
            ends[same] = (ends[same][0], ends[same][1] + 1)
    everything = points - middle
    found = [
        RestingFace(turn_down(down), float(count), support_margin(everything, down))
        for down, count in ends
    ]
    stable = [f for f in found if f.margin > LEAST_MARGIN]
    total = sum(f.probability for f in stable)
    return tuple(RestingFace(f.R_world_part, f.probability / total, f.margin) for f in stable)


@cache
def sphere(count: int) -> Float64[np.ndarray, "_ 3"]:
    """Unit vectors spread evenly over the sphere (a Fibonacci lattice)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count) + 0.1
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _outermost(points: Points) -> Float64[np.ndarray, "_ 3"]:
    """The points that are the farthest in some direction: corners of the convex hull, nearly all."""
    axes = np.concatenate([np.eye(3), -np.eye(3), sphere(_DIRECTIONS)])
    spread = points - points.mean(axis=0)
    chosen = [(spread @ axes[k : k + 100].T).argmax(axis=0) for k in range(0, len(axes), 100)]
    return points[np.unique(np.concatenate(chosen))]


def _roll(arms: Points, down: Vector) -> Vector | None:
    """The direction (part frame) that looks down when the rolling has ended.

    Args:
        arms: from the centre of mass to the outermost points, metres.
        down: where the table is when the thing touches it.
    """
    for _ in range(_ROLLS):
        height = arms @ down
        touching = arms[height > height.max() - CONTACT / 4]
        pivot = _pivot(touching, down)
        if len(pivot) == 0:
            return down
        level = pivot[0] - (pivot[0] @ down) * down
        if len(pivot) == 2:
            edge = (pivot[1] - pivot[0]) - ((pivot[1] - pivot[0]) @ down) * down
            edge /= np.linalg.norm(edge)
            level = level - (level @ edge) * edge
        length = float(np.linalg.norm(level))
        if length < 1e-7:
            return None  # It balances on a corner or an edge, which nothing does for long.
        level /= length
        # Turning by t: down becomes cos t down - sin t level; who reaches the table first?
        behind = arms - pivot[0]
        rise, fall = -(behind @ down), -(behind @ level)
        meets = np.where((fall > 1e-9) & (rise > CONTACT / 5), np.arctan2(rise, fall), np.inf)
        turn = float(meets.min())
        if not np.isfinite(turn):
            return None
        down = np.cos(turn) * down - np.sin(turn) * level
        down = down / np.linalg.norm(down)
    return None


def _pivot(touching: Points, down: Vector) -> Float64[np.ndarray, "_ 3"]:
    """The contacts over which the thing tips: none, one corner or two ends of an edge."""
    R = turn_down(down)
    flat = touching @ R[:2].T
    outline = convex_outline(flat)
    if len(outline) >= 3 and _inside_by(flat[outline], np.zeros(2)) >= 0:
        return touching[:0]
    best, nearest = touching[:1], np.inf
    for i, j in zip(outline, _next(outline), strict=True):
        edge = flat[j] - flat[i]
        share = float(np.clip(-(flat[i] @ edge) / max(float(edge @ edge), 1e-18), 0, 1))
        distance = float(np.linalg.norm(flat[i] + share * edge))
        if distance < nearest - 1e-12:
            nearest = distance
            ends = [i, j] if 1e-6 < share < 1 - 1e-6 else [i if share < 0.5 else j]
            best = touching[ends]
    return best


def support_margin(arms: Points, down: Vector) -> float:
    """How far within the contacts the centre of mass stands, seen from above, metres; below 0 it tips.

    Args:
        arms: points of the thing from its centre of mass, metres.
        down: unit vector towards the table, in the same frame.
    """
    height = arms @ down
    flat = arms[height > height.max() - CONTACT] @ turn_down(down)[:2].T
    outline = convex_outline(flat)
    if len(outline) < 3:
        return -float(np.linalg.norm(flat, axis=1).min())
    return _inside_by(flat[outline], np.zeros(2))


def _inside_by(outline: Outline, point: Float64[np.ndarray, "2"]) -> float:
    """Distance of a point from the border of a convex outline (counter-clockwise), inside positive."""
    edges = _next(outline) - outline
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-15
    return float(((point - outline) * normals).sum(axis=1).min())


def _next(rows: np.ndarray) -> np.ndarray:
    """For each row the one after it, for the last the first; `numpy.roll` takes ten times longer."""
    return np.concatenate((rows[1:], rows[:1]))


def turn_down(direction: Vector) -> Rotation:
    """The shortest turn that makes a direction look down (-z)."""
    axis = np.array([-direction[1], direction[0], 0.0])  # across both
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3) if direction[2] < 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_about(axis, float(np.arctan2(length, -direction[2])))


def convex_outline(flat: Outline) -> Int64[np.ndarray, "_"]:
    """Indices of the corners of a plane convex hull, counter-clockwise."""
    # OpenCV wants float32; lengths about the middle keep it to a tenth of a micrometre.
    near = (flat - flat.mean(axis=0)).astype(np.float32)
    hull = cast(np.ndarray, cv2.convexHull(near[:, None], returnPoints=False))
    found = hull.reshape(-1).astype(np.int64)
    x, y = flat[found].T
    area = float((x * _next(y) - y * _next(x)).sum())
    return found if area >= 0 else found[::-1]


def footprint(points_world: Points) -> Outline:
    """Convex outline of a thing seen from above, counter-clockwise."""
    flat = points_world[:, :2]
    return flat[convex_outline(flat)].copy()


def overlap(a: Outline, b: Outline, *, gap: float) -> bool:
    """Whether two convex outlines come nearer than `gap` metres (separating axes)."""
    for outline in (a, b):
        edges = _next(outline) - outline
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
        pa, pb = a @ normals.T, b @ normals.T
        apart = (pa.min(axis=0) - pb.max(axis=0) > gap) | (pb.min(axis=0) - pa.max(axis=0) > gap)
        if bool(apart.any()):
            return False
    return True
