"""The maths of the exact AR view: image plane, field of view, zoom. Pure.

viser's world is the camera frame here (OpenCV's axes). The picture hangs on a plane at its metric
size; meshes then lie exactly over it from wherever the viewer's camera CENTRE is the origin, whatever
its rotation, field of view or window. Zoom is field of view and rotation alone, so it stays exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.geometry.shapes import Intrinsics, Rotation, Vector
from asdfviz.geometry.transforms import rotation_about

PLANE_DEPTH = 10.0
"""Metres to the picture: behind everything that a depth camera sees."""
DRAWING_DEPTH = 0.12
"""Metres to boxes and keypoints: before every mesh."""
ORBIT = 1e-5
"""Metres from the pinned centre to the point looked at, so that turning moves it by nothing visible."""
ZOOM_RANGE = (1.0, 16.0)


@dataclass(frozen=True, slots=True)
class Plane:
    """Where the picture hangs."""

    width: float
    height: float
    position: tuple[float, float, float]


def image_plane(K: Intrinsics, size_wh: tuple[int, int], *, depth: float = PLANE_DEPTH) -> Plane:
    """Metric size and centre of the picture at `depth` metres.

    An integer pixel is a centre, so the picture spans -0.5 to width - 0.5.
    """
    width, height = size_wh
    x = ((width / 2 - 0.5) - K[0, 2]) / K[0, 0] * depth
    y = ((height / 2 - 0.5) - K[1, 2]) / K[1, 1] * depth
    size = float(width / K[0, 0] * depth), float(height / K[1, 1] * depth)
    return Plane(*size, (float(x), float(y), depth))


def rest_centre(K: Intrinsics) -> tuple[float, float]:
    """The pixel that the view looks through at rest: straight ahead, so that the picture is upright."""
    return float(K[0, 2]), float(K[1, 2])


def fit_fov(K: Intrinsics, size_wh: tuple[int, int], aspect: float) -> float:
    """Vertical field of view (radians) that shows the whole picture, looking straight ahead.

    Args:
        K: intrinsics of the picture.
        size_wh: of the picture, pixels.
        aspect: width over height of the window.
    """
    width, height = size_wh
    x = max(K[0, 2] + 0.5, width - 0.5 - K[0, 2]) / K[0, 0]
    y = max(K[1, 2] + 0.5, height - 0.5 - K[1, 2]) / K[1, 1]
    return float(2 * np.arctan(max(y, x / aspect)))


def zoomed_fov(fov: float, zoom: float) -> float:
    """Field of view that magnifies the middle of the view `zoom` times."""
    return float(2 * np.arctan(np.tan(fov / 2) / zoom))


def look_direction(K: Intrinsics, pixel: tuple[float, float]) -> Vector:
    """Unit vector from the camera centre through a pixel."""
    u, v = pixel
    ray = np.array([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0])
    return ray / np.linalg.norm(ray)


def look_rotation(K: Intrinsics, pixel: tuple[float, float]) -> Rotation:
    """R_camera_view of a viewer that looks through a pixel without tilting its head."""
    z = look_direction(K, pixel)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def pixel_at(
    K: Intrinsics, R_camera_view: Rotation, *, fov: float, aspect: float, ndc: tuple[float, float]
) -> tuple[float, float]:
    """The picture's pixel at a place of the window.

    Args:
        K: intrinsics of the picture.
        R_camera_view: how the viewer is turned.
        fov: vertical field of view, radians.
        aspect: width over height of the window.
        ndc: place in the window, -1 to 1 from left to right and from top to bottom.
    """
    t = np.tan(fov / 2)
    ray = R_camera_view @ np.array([ndc[0] * t * aspect, ndc[1] * t, 1.0])
    z = max(float(ray[2]), 1e-6)
    return (
        float(K[0, 0] * ray[0] / z + K[0, 2]),
        float(K[1, 1] * ray[1] / z + K[1, 2]),
    )


@dataclass(frozen=True, slots=True)
class Window:
    """What of a window the view depends on."""

    K: Intrinsics
    size_wh: tuple[int, int]
    """Of the picture, pixels."""
    aspect: float
    """Width over height of the window."""

    def fov(self, zoom: float) -> float:
        """Vertical field of view at a zoom, radians."""
        return zoomed_fov(fit_fov(self.K, self.size_wh, self.aspect), zoom)

    def pixel(
        self, centre: tuple[float, float], ndc: tuple[float, float], *, zoom: float
    ) -> tuple[float, float]:
        """The picture's pixel at a place of the window when the view looks through `centre`."""
        return pixel_at(
            self.K,
            look_rotation(self.K, centre),
            fov=self.fov(zoom),
            aspect=self.aspect,
            ndc=ndc,
        )


def zoom_about(
    window: Window,
    centre: tuple[float, float],
    *,
    zoom: float,
    factor: float,
    ndc: tuple[float, float] = (0.0, 0.0),
) -> tuple[float, tuple[float, float]]:
    """New zoom and new centre pixel such that what is under `ndc` stays under it.

    At zoom 1 the whole picture is shown again, from straight ahead.
    """
    new = float(np.clip(zoom * factor, *ZOOM_RANGE))
    if new <= ZOOM_RANGE[0] + 1e-9:
        return ZOOM_RANGE[0], rest_centre(window.K)
    point = window.pixel(centre, ndc, zoom=zoom)
    t = np.tan(window.fov(new) / 2)
    ray = np.array([ndc[0] * t * window.aspect, ndc[1] * t, 1.0])
    z = _level_rotation(ray / np.linalg.norm(ray), look_direction(window.K, point))[:, 2]
    ahead = max(float(z[2]), 1e-6)
    moved = (
        float(window.K[0, 0] * z[0] / ahead + window.K[0, 2]),
        float(window.K[1, 1] * z[1] / ahead + window.K[1, 2]),
    )
    return new, clamp_centre(moved, window.size_wh)


def _level_rotation(ray_view: Vector, ray_camera: Vector) -> Rotation:
    """R_camera_view, turned about the upright and then the level axis only, that maps ray to ray."""
    x, y, z = ray_view
    away = np.sqrt(max(y * y + z * z - ray_camera[1] ** 2, 1e-12))
    pitch = np.arctan2(ray_camera[1], away) - np.arctan2(y, z)
    yaw = np.arctan2(ray_camera[0], ray_camera[2]) - np.arctan2(x, away)
    ex, ey = np.eye(3)[:2]
    return rotation_about(ey, float(yaw)) @ rotation_about(ex, -float(pitch))


def clamp_centre(centre: tuple[float, float], size_wh: tuple[int, int]) -> tuple[float, float]:
    """Keep the middle of the view inside the picture."""
    width, height = size_wh
    return (
        float(np.clip(centre[0], 0, width - 1)),
        float(np.clip(centre[1], 0, height - 1)),
    )
