"""A box part over a table, seen by a depth camera: exact depth by intersecting rays with boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import farthest_points, surface_points
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Pixels, Points, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, transform_from

WIDTH, HEIGHT = 640, 360
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    dtype=np.int32,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class BoxView:
    """One view of one box; lengths in metres, pixels in an image of WIDTH x HEIGHT."""

    half: Vector
    K: Intrinsics
    T_camera_part: Transform

    @property
    def corners(self) -> Points:
        return CORNERS * self.half

    @property
    def surface(self) -> Points:
        return surface_points(self.corners, FACES, 600)

    @property
    def keypoints(self) -> Points:
        return farthest_points(self.surface, 17)

    @property
    def keypoints_px(self) -> Pixels:
        return project(apply(self.T_camera_part, self.keypoints), self.K)

    @property
    def box_xyxy(self) -> Box:
        pixels = project(apply(self.T_camera_part, self.corners), self.K)
        return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])

    def depth(
        self,
        *,
        table: float | None = None,
        others: tuple[tuple[Transform, Vector], ...] = (),
    ) -> Depth:
        """Depth of this box, other boxes (pose, half extents) and a wall at depth `table`."""
        depth = np.full((HEIGHT, WIDTH), np.inf if table is None else table)
        for T_camera_box, half in ((self.T_camera_part, self.half), *others):
            depth = np.minimum(depth, _box_depth(T_camera_box, half, self.K))
        return np.where(np.isfinite(depth), depth, 0).astype(np.float32)


def _box_depth(T_camera_box: Transform, half: Vector, K: Intrinsics) -> np.ndarray:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)
    T_box_camera = inverse(T_camera_box)
    directions = rays @ T_box_camera[:3, :3].T
    directions = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
    a = (-half - T_box_camera[:3, 3]) / directions
    b = (half - T_box_camera[:3, 3]) / directions
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


@pytest.fixture
def box_view() -> Callable[..., BoxView]:
    """Make a view of a box with half extents `half`, turned by `rotation` (vector, radians)."""

    def make(
        *,
        half: tuple[float, float, float] = (0.05, 0.03, 0.015),
        rotation: tuple[float, float, float] = (0.9, 0.4, -0.5),
        position: tuple[float, float, float] = (0.02, -0.01, 0.6),
    ) -> BoxView:
        K = np.array([[450.0, 0, 319.5], [0, 450.0, 179.5], [0, 0, 1]])
        R = np.asarray(cv2.Rodrigues(np.array(rotation))[0], dtype=np.float64)
        return BoxView(np.array(half), K, transform_from(R, np.array(position)))

    return make
