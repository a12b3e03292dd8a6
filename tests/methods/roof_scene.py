"""A roof on a table, as a depth camera that smears and a lamp from one side show it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from asdfviz.datatypes import Camera, Frame, Mesh
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.pose.table import Table
from asdfviz.track import raster
from asdfviz.track.viewpoint_model import face_normals

CAMERA = Camera(np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]), 320, 240)
TABLE = Table(np.array([0.0, 0.0, -1.0]), 0.6)
LAMP = np.array([0.5, -0.3, -0.81])
SMEAR_PX = 1.3


def roof() -> Mesh:
    """40 mm long, 20 mm wide, 4 mm high at both ends, its ridge of 12 mm nearer to one of them."""
    profile = [[-0.02, 0.0], [0.02, 0.0], [0.02, 0.004], [0.008, 0.012], [-0.02, 0.004]]
    vertices = np.array([[x, y, z] for y in (-0.01, 0.01) for x, z in profile])
    ends = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [5, 7, 6], [5, 8, 7], [5, 9, 8]]
    sides = [
        [[i, i + 5, j], [j, i + 5, j + 5]] for i, j in zip(range(5), (1, 2, 3, 4, 0), strict=True)
    ]
    return Mesh(vertices, np.array([*ends, *(face for two in sides for face in two)], np.int32))


def lying(angle: float) -> Transform:
    """Flat on the table, turned about its normal."""
    up = np.diag([1.0, -1, -1])
    return transform_from(rotation_about(np.array([0, 0, 1.0]), angle) @ up, np.array([0, 0, 0.6]))


TRUE, TURNED = lying(0.4), lying(0.4 + np.pi)
BOTH = np.stack([TRUE, TURNED])


@dataclass(frozen=True)
class Seen:
    """What can be left out of a frame of the roof in its true pose."""

    noise: float = 0.001
    shading: float = 1.0


def frame(seen: Seen | None = None, *, seed: int = 0) -> Frame:
    seen = seen or Seen()
    rng = np.random.default_rng(seed)
    inverse, ids = raster.new_buffers(CAMERA.width, CAMERA.height)
    raster.draw(roof(), TRUE, K=CAMERA.K, inverse_depth=inverse, ids=ids)
    shows = inverse > 0
    depth = np.where(shows, 1 / np.maximum(inverse, 1e-9), 0.6)
    depth = cv2.GaussianBlur(depth, (0, 0), SMEAR_PX) + rng.normal(size=depth.shape) * seen.noise
    normals = face_normals(roof(), ids[shows], TRUE) @ TRUE[:3, :3].T
    light = np.full(shows.shape, 120.0)
    light[shows] = 90 + 60 * seen.shading * np.maximum(normals @ LAMP, 0)
    rgb = light[..., None] + rng.normal(size=(*light.shape, 3)) * 2
    return Frame(0, 0.0, np.clip(rgb, 0, 255).astype(np.uint8), depth.astype(np.float32), CAMERA)
