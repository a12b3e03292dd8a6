"""Poses of parts that lie on the table, made to lie on it: a side flat down, and neither in it nor above it.

Not in the paper. A plane through a thousand readings is known ten times better than the tilt and the
distance of a small part on it, whose own few readings are smeared at its edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Depth, Intrinsics, Points, Transform
from asdfviz.geometry.transforms import apply_to_point, rotation_about, transform_from
from asdfviz.pose.resting import center_of_mass, resting_faces
from asdfviz.pose.table import SunkConfig, Table, depth_in_table

STEEP = -0.2
"""Cosine between the table's normal and a ray above which the ray is too level to move along."""


@dataclass(frozen=True)
class StandingConfig:
    """When a part is taken to lie on the table."""

    angle_deg: float = 10.0
    """A side that is turned from the table by no more than this lies flat on it,"""
    above: float = 0.003
    """if it is no higher than this above it, metres,"""
    worse: float = 0.05
    """and no more than this share of the readings agrees less."""
    below: float = 0.002
    """What is deeper than this in the table, laid flat, is lifted so far: about what the plane errs,
    metres."""


@lru_cache(maxsize=128)
def sides(mesh: Mesh) -> Float64[np.ndarray, "s 3"]:
    """Directions, in the part's frame, that look down when it lies on one of its sides."""
    faces = resting_faces(mesh.vertices, center=center_of_mass(mesh))
    return np.array([-face.R_world_part[2] for face in faces]).reshape(-1, 3)


def laid_flat(
    T_camera_part: Transform,
    downs: Float64[np.ndarray, "s 3"],
    corners: Points,
    table: Table,
    *,
    config: StandingConfig,
    lift: float,
) -> Transform | None:
    """The pose with its lowest side flat on the table; None where it does not lie there.

    Args:
        T_camera_part: the pose.
        downs: as `sides` gives them.
        corners: spanning the part's outline, metres.
        table: in the camera's frame.
        config: how far it may be from lying there.
        lift: how deep in the table it may be, metres.
    """
    if not len(downs):
        return None
    turned = downs @ T_camera_part[:3, :3].T
    side = turned[(turned @ -table.normal).argmax()]
    axis = np.cross(side, -table.normal)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, -side @ table.normal))
    if angle > np.deg2rad(config.angle_deg):
        return None
    R = rotation_about(axis, angle) if sine > 1e-9 else np.eye(3)
    middle_part = corners.mean(axis=0)
    middle = apply_to_point(T_camera_part, middle_part)
    R_flat = R @ T_camera_part[:3, :3]
    lowest = float(((corners - middle_part) @ (R_flat.T @ table.normal)).min())
    height = lowest + float(middle @ table.normal) + table.offset
    if not -lift <= height <= config.above:
        return None
    rise = max(-config.below - height, 0.0)
    return _moved(transform_from(R_flat, middle - R_flat @ middle_part), middle, rise, table)


def lifted(
    T_camera_part: Transform,
    corners: Points,
    table: Table,
    *,
    depth: Depth,
    K: Intrinsics,
    config: SunkConfig,
) -> Transform | None:
    """The pose moved along its viewing ray until it stands on the table; None where it need not.

    Args:
        T_camera_part: the pose.
        corners: spanning the part's outline, metres.
        table: in the camera's frame.
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
        config: how deep is too deep.
    """
    found = depth_in_table(T_camera_part[None], corners, table, depth=depth, K=K)
    deep = float(config.too_deep(found, corners)[0])
    if not 0 < deep <= config.lift:
        return None
    middle = apply_to_point(T_camera_part, corners.mean(axis=0))
    return _moved(T_camera_part, middle, deep, table)


def _moved(
    T_camera_part: Transform, middle: Float64[np.ndarray, "3"], rise: float, table: Table
) -> Transform | None:
    """The pose moved along the ray through its middle until it is so much higher."""
    ray = middle / np.linalg.norm(middle)
    steep = float(table.normal @ ray)
    if steep > STEEP:
        return None
    moved = T_camera_part.copy()
    moved[:3, 3] += rise / steep * ray
    return moved
