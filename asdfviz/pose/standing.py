"""Poses of parts that lie on the table, made to lie on it: a side flat down, and neither in it nor above it.

Not in the paper. A plane through a thousand readings is known ten times better than the tilt and the
distance of a small part on it, whose own few readings are smeared at its edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float64
from scipy import spatial  # pyright: ignore[reportMissingTypeStubs]  scipy has none

from asdfviz.datatypes import Mesh
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Depth, Intrinsics, Points, Scores, Transform, Vector
from asdfviz.geometry.symmetry import across
from asdfviz.geometry.transforms import apply, apply_to_point, cross, turn_about
from asdfviz.pose.resting import LEAST_MARGIN, center_of_mass, support_margin
from asdfviz.pose.table import SunkConfig, Table, depth_in_table

ONE_SIDE = 0.9998
"""Cosine from which two faces are one side."""
STEEP = -0.2
"""Cosine between the table's normal and a ray above which the ray is too level to move along."""


@dataclass(frozen=True)
class StandingConfig:
    """When a part is taken to lie on the table.

    Depth has little of a say: it smears a small part towards the table behind it, and had pads of 4 cm up
    to 7 mm deep in a table that was known to half a millimetre.
    """

    angle_deg: float = 25.0
    """A side that is turned from the table by no more than this lies flat on it,"""
    above: float = 0.005
    """if it is no higher than this above it, metres,"""
    worse: float = 0.3
    """and no more than this share of the readings agrees less."""
    below: float = 0.001
    """What is deeper than this in the table, laid flat, is lifted so far: about what the plane errs,
    metres."""
    lift: float = 0.02
    """What lies in the table by no more than this was moved too far by depth, smeared at its edges:
    it is lifted, metres."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.angle_deg, self.above, self.worse, self.below, self.lift) < 0:
            raise MethodError(
                f"standing.angle_deg is {self.angle_deg:g}, above {self.above:g}, worse {self.worse:g}, "
                f"below {self.below:g} and lift {self.lift:g}: use 0 or more"
            )


@dataclass(frozen=True)
class RestConfig:
    """How much it speaks for a pose that a side lies flat on the table."""

    weight: float = 0.1
    """Of all that it can say, against an outline that agrees."""
    tilt_deg: float = 20.0
    """Turned from the table by this it says nothing,"""
    near: float = 0.01
    """nor where the lowest corner is farther from the table than this, metres."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.tilt_deg <= 0 or min(self.weight, self.near) < 0:
            raise MethodError(
                f"rest.weight is {self.weight:g}, tilt_deg {self.tilt_deg:g} and near {self.near:g}: "
                "tilt_deg must be above 0, the others 0 or more"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """What the table says of the poses of one part."""

    corners: Points
    """Spanning the part's outline, metres."""
    downs: Float64[np.ndarray, "s 3"]
    """As `sides` gives them."""
    sunk: SunkConfig
    """What speaks against a pose."""
    rest: RestConfig
    """What speaks for one."""

    def against(
        self,
        Ts: Float64[np.ndarray, "c 4 4"],
        table: Table,
        *,
        depth: Depth,
        K: Intrinsics,
    ) -> Scores:
        """That the part stands in it in each pose, in shares of an outline that agrees, 0 and more.

        Args:
            Ts: poses of the part in the table's frame.
            table: as seen.
            depth: planar depth in the same frame, metres, 0 = none.
            K: its intrinsics.
        """
        deep = depth_in_table(Ts, self.corners, table, depth=depth, K=K)
        return self.sunk.weight * self.sunk.share(deep, self.corners)

    def in_favour(self, Ts: Float64[np.ndarray, "c 4 4"], table: Table) -> Scores:
        """That its lowest side lies flat on it, in the same shares; poses and table as for `against`."""
        if not len(self.downs):
            return np.zeros(len(Ts))
        up = np.einsum("j,cji->ci", table.normal, Ts[:, :3, :3])
        tilt = np.arccos(np.clip((-up @ self.downs.T).max(axis=1), -1, 1))
        height = (up @ self.corners.T).min(axis=1) + Ts[:, :3, 3] @ table.normal + table.offset
        flat = np.maximum(1 - tilt / np.deg2rad(self.rest.tilt_deg), 0.0)
        return self.rest.weight * flat * (np.abs(height) < self.rest.near)


@lru_cache(maxsize=128)
def sides(mesh: Mesh) -> Float64[np.ndarray, "s 3"]:
    """Directions, in the part's frame, that look down when it lies on one of its sides.

    The faces of its convex hull over which its centre of mass stands: all of them, as a round rim has
    dozens, of which a generator's throws (`asdfviz.pose.resting`) find some.
    """
    arms = mesh.vertices - center_of_mass(mesh)
    found: list[Vector] = []
    for down in _hull_normals(arms):
        is_new = all(down @ other <= ONE_SIDE for other in found)
        if is_new and support_margin(arms, down) > LEAST_MARGIN:
            found.append(down)
    return np.array(found).reshape(-1, 3)


def _hull_normals(points: Points) -> Float64[np.ndarray, "f 3"]:
    """Outward normals of the convex hull's triangles; of a flat thing's, both sides."""
    try:
        hull = spatial.ConvexHull(points)
    except spatial.QhullError:  # flat: joggled a little, it has a hull
        hull = spatial.ConvexHull(points, qhull_options="QJ")
    return np.asarray(hull.equations, np.float64)[:, :3]


def laid_flat(
    T_camera_part: Transform,
    downs: Float64[np.ndarray, "s 3"],
    corners: Points,
    table: Table,
    *,
    config: StandingConfig,
) -> Transform | None:
    """The pose with its lowest side flat on the table; None where it does not lie there.

    Args:
        T_camera_part: the pose.
        downs: as `sides` gives them.
        corners: spanning the part's outline, metres.
        table: in the camera's frame.
        config: how far it may be from lying there.
    """
    if not len(downs):
        return None
    turned = downs @ T_camera_part[:3, :3].T
    side = turned[(turned @ -table.normal).argmax()]
    flat, angle, height = _turned_down(T_camera_part, side, corners, table)
    if angle > np.deg2rad(config.angle_deg):
        return None
    if not -config.lift <= height <= config.above:
        return None
    rise = max(-config.below - height, 0.0)
    middle = apply_to_point(T_camera_part, corners.mean(axis=0))
    return _moved(flat, middle, rise, table)


def height_above(T_camera_part: Transform, corners: Points, table: Table) -> float:
    """Of the part's lowest corner above the table, metres; below 0 where it stands in it."""
    return float((apply(T_camera_part, corners) @ table.normal).min()) + table.offset


def standing_on(
    T_camera_part: Transform, down: Float64[np.ndarray, "3"], corners: Points, table: Table
) -> tuple[Transform, float] | None:
    """The pose turned the shortest way until a side looks down, and moved along the ray through its
    middle until it stands on the table; with it how far it was turned, radians.

    Args:
        T_camera_part: the pose.
        down: direction in the part's frame that is to look down.
        corners: spanning the part's outline, metres.
        table: in the camera's frame.

    Returns:
        None where the ray is too level.
    """
    side = T_camera_part[:3, :3] @ down
    turned, angle, height = _turned_down(T_camera_part, side, corners, table)
    middle = apply_to_point(T_camera_part, corners.mean(axis=0))
    moved = _moved(turned, middle, -height, table)
    return None if moved is None else (moved, angle)


def _turned_down(
    T_camera_part: Transform, side: Vector, corners: Points, table: Table
) -> tuple[Transform, float, float]:
    """The pose turned the shortest way about its middle until a side (camera axes) looks down; by how
    much, radians; and how high its lowest corner then is above the table, metres."""
    axis = cross(side, -table.normal)
    sine = math.hypot(*axis.tolist())
    angle = float(np.arctan2(sine, -side @ table.normal))
    if sine <= 1e-9:  # as it is, or head over heels about any level axis
        axis = across(table.normal)
    middle = apply_to_point(T_camera_part, corners.mean(axis=0))
    turned = turn_about(axis, middle, angle) @ T_camera_part
    return turned, angle, height_above(turned, corners, table)


def lifted(
    T_camera_part: Transform,
    corners: Points,
    table: Table,
    *,
    depth: Depth,
    K: Intrinsics,
    sunk: SunkConfig,
    config: StandingConfig,
) -> Transform | None:
    """The pose moved along its viewing ray until it stands on the table; None where it need not.

    Args:
        T_camera_part: the pose.
        corners: spanning the part's outline, metres.
        table: in the camera's frame.
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
        sunk: how deep is too deep.
        config: how far it is lifted.
    """
    found = depth_in_table(T_camera_part[None], corners, table, depth=depth, K=K)
    deep = float(sunk.too_deep(found, corners)[0])
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
