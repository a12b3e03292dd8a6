"""The camera of the paper's recordings, and how it sees at other image sizes."""

from __future__ import annotations

import math

import numpy as np

from asdfviz.datatypes import Camera
from asdfviz.geometry.camera import scaled_intrinsics

KINECT = Camera(
    np.array([[607.2491, 0.0, 639.1670], [0.0, 607.1653, 364.7615], [0.0, 0.0, 1.0]]), 1280, 720
)
"""An Azure Kinect's colour image."""
FOCAL = 607.25 / 1280
"""Its focal length, as a share of the width of its whole image."""
CENTER = (639.167 / 1280, 364.76 / 720)
"""Its principal point, as shares of width and height."""
KINECT_LENS = (0.109, -0.124, 0.067)
"""Radial distortion that the real colour images still hold."""


def whole_image(width: int, height: int) -> tuple[float, float]:
    """Width and height that the Kinect's whole image has around the middle of one of this size, pixels.

    Both have the same diagonal; where the size is not 16:9, what is higher or narrower than the
    Kinect's image sees more than it on two sides, and less on the other two.
    """
    if width * KINECT.height == height * KINECT.width:
        return float(width), float(height)
    scale = math.hypot(width, height) / math.hypot(KINECT.width, KINECT.height)
    return scale * KINECT.width, scale * KINECT.height


def camera_for(width: int, height: int, *, zoom: float = 1.0) -> Camera:
    """The paper's camera at another image size: square pixels, and the same diagonal of view at zoom 1."""
    whole = whole_image(width, height)
    K = scaled_intrinsics(KINECT.K, whole[0] / KINECT.width, whole[1] / KINECT.height)
    K[:2, 2] += (width - whole[0]) / 2, (height - whole[1]) / 2
    return Camera(K @ np.diag([zoom, zoom, 1.0]), width, height)
