"""The table in the depth image, and how deep a pose would have a part stand in it.

Not in the paper. A part that is taken end for end, or for another one, may well show the outline and the
front that the camera measured; its far side then often lies under the table, where nothing can be.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float32, Float64

from asdfviz.errors import MethodError
from asdfviz.geometry.median import median
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points, Rotation, Vector
from asdfviz.pose.depth_kernels import deepest, heights_around

Depths: TypeAlias = Float64[np.ndarray, "c"]
"""One of each pose."""

TRIALS = 64
"""Planes that are tried."""
SAMPLES = 1500
"""Readings that judge them."""

AROUND = 0.6
"""The table around a box is taken so many of its sides from it,"""
GRID = 32
"""from no more readings across than about twice this,"""
LEAST = 30
"""and is not known from fewer."""


@dataclass(frozen=True)
class TableConfig:
    """What counts as a table."""

    margin: float = 0.006
    """Readings this near to a plane lie on it, metres."""
    share: float = 0.25
    """Share of all readings that the table has at least, 0 to 1."""


@dataclass(frozen=True)
class SunkConfig:
    """How much it speaks against a pose that the part would stand in the table."""

    weight: float = 0.5
    """Of all that it can say, against an outline that agrees."""
    free: float = 0.001
    """Up to this deep it says nothing, since readings err, metres,"""
    free_share: float = 0.04
    """and this share of the diameter more, since rotations do;"""
    full_share: float = 0.1
    """from this share of the diameter deeper on it says all that it can."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.free, self.free_share) < 0 or self.full_share <= 0:
            raise MethodError(
                f"sunk.free is {self.free:g}, free_share {self.free_share:g} and full_share "
                f"{self.full_share:g}: full_share must be above 0, the others 0 or more"
            )

    def too_deep(self, depths: Depths, corners: Points) -> Depths:
        """How much deeper a part stands in the table than errors explain, metres.

        Args:
            depths: as `depth_in_table` gives them.
            corners: spanning the part's outline, metres.
        """
        return np.maximum(depths - self.depths(corners)[0], 0.0)

    def share(self, depths: Depths, corners: Points) -> Depths:
        """From how deep a part stands in the table, as for `too_deep`, to what that says, 0 to 1."""
        return np.minimum(self.too_deep(depths, corners) / self.depths(corners)[1], 1.0)

    def depths(self, corners: Points) -> tuple[float, float]:
        """How deep is free, and how much deeper says all, metres; of a part with such corners."""
        size = float(np.linalg.norm(np.ptp(corners, axis=0)))
        return self.free + self.free_share * size, self.full_share * size


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A plane in the frame of a camera."""

    normal: Vector
    """Towards the camera, of length 1."""
    offset: float
    """normal . p + offset is the height of a point p above the table, metres."""

    def seen_from(self, R_camera_view: Rotation) -> Table:
        """The same table in the frame of a view with the same centre."""
        return Table(R_camera_view.T @ self.normal, self.offset)

    def heights(
        self,
        depth: Float32[np.ndarray, "a b"],
        *,
        rows: np.ndarray,
        columns: np.ndarray,
        K: Intrinsics,
    ) -> Float32[np.ndarray, "a b"]:
        """How high readings in these rows and columns of the image lie above it, metres."""
        x, y = (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]
        # Whole images pass here: in place, and in their own precision, it takes a third of the time.
        above = np.add(self.normal[0] * x + self.normal[2], self.normal[1] * y, dtype=np.float32)
        above *= depth
        above += np.float32(self.offset)
        return above


def largest_plane(depth: Depth, K: Intrinsics, *, config: TableConfig) -> Table | None:
    """The plane that most readings lie on, None where too few do.

    Args:
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
        config: what counts.
    """
    known = np.flatnonzero(depth > 0)
    if len(known) < 3 * SAMPLES:
        return None
    rng = np.random.default_rng(0)
    rows, columns = np.divmod(known[rng.choice(len(known), SAMPLES, replace=False)], depth.shape[1])
    z = depth[rows, columns].astype(np.float64)
    x = (columns - K[0, 2]) / K[0, 0] * z
    y = (rows - K[1, 2]) / K[1, 1] * z
    points = np.stack([x, y, z], axis=1)
    corners = points[rng.integers(0, SAMPLES, (TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(lengths, 1e-12)
    heights = normals @ points.T - (normals * corners[:, 0]).sum(axis=1, keepdims=True)
    on = np.abs(heights) < config.margin
    best = int((on.sum(axis=1) * (lengths[:, 0] > 1e-9)).argmax())
    if on[best].mean() < config.share:
        return None
    return _fitted(points, on[best], config)


def _fitted(points: Points, near: np.ndarray, config: TableConfig) -> Table:
    """Least squares through the readings on the plane, twice."""
    normal: Vector = np.zeros(3)
    middle: Vector = np.zeros(3)
    for _ in range(2):
        middle = points[near].mean(axis=0)
        normal = np.linalg.svd(points[near] - middle, full_matrices=False)[2][2]
        near = np.abs((points - middle) @ normal) < config.margin
    normal = -normal if normal[2] > 0 else normal
    return Table(normal, float(-normal @ middle))


def table_around(box_xyxy: Box, table: Table, *, depth: Depth, K: Intrinsics) -> Table | None:
    """The table at the height that it has around a box; None where too little of it is seen.

    Lenses bend planes by millimetres from one side of the image to the other.

    Args:
        box_xyxy: around a part, pixels.
        table: as all of the image has it.
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
    """
    size = AROUND * (box_xyxy[2:] - box_xyxy[:2])
    most = np.array(depth.shape[::-1]) - 1
    low = np.clip(box_xyxy[:2] - size, 0, most).astype(int)
    high = np.clip(box_xyxy[2:] + size, 0, most).astype(int)
    step = max(1, int((high - low).max()) // GRID)
    window = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    plane = (table.normal, table.offset)
    seen = heights_around(depth, window, step, np.asarray(box_xyxy, np.float64), plane, K)
    if len(seen) < LEAST:
        return None
    return Table(table.normal, table.offset - median(seen))


def depth_in_table(
    Ts: Float64[np.ndarray, "c 4 4"],
    corners: Points,
    table: Table,
    *,
    depth: Float64[np.ndarray, "h w"] | Depth,
    K: Intrinsics,
) -> Depths:
    """How deep the lowest corner of a part lies under the table in each of its poses, metres.

    What lies outside the image, or where one looks past the table's edge, is not under it.

    Args:
        Ts: poses of the part in the table's frame.
        corners: spanning the part's outline, metres.
        table: as seen.
        depth: planar depth in the same frame, metres, 0 = none.
        K: its intrinsics.
    """
    return deepest(Ts, corners, (table.normal, table.offset), depth, K)
