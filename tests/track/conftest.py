"""A box before a speckled wall, drawn with known poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from asdfviz.datatypes import Camera, Frame, Mesh
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.track import raster
from asdfviz.track.bodies import Body, centre_of_mass
from asdfviz.track.viewpoint_model import ViewpointConfig, ViewpointModel, build_viewpoint_model

SMALL_VIEWS = ViewpointConfig(subdivisions=2, points=200, image_size=400)
HALF = np.array([0.05, 0.03, 0.02])


def box_mesh(half: np.ndarray, centre: np.ndarray) -> Mesh:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    faces = [
        *([0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
    return Mesh(corners + centre, np.array(faces, np.int32))


@pytest.fixture(scope="session")
def small_views() -> ViewpointConfig:
    return SMALL_VIEWS


@pytest.fixture(scope="session")
def half() -> np.ndarray:
    """Half the box's edges, metres."""
    return HALF


@pytest.fixture(scope="session")
def box() -> Mesh:
    """A box whose middle is not the origin."""
    return box_mesh(HALF, np.array([0.01, 0.02, -0.03]))


@pytest.fixture(scope="session")
def box_model(box: Mesh) -> ViewpointModel:
    return build_viewpoint_model(box, config=SMALL_VIEWS)


@pytest.fixture(scope="session")
def box_body(box: Mesh, box_model: ViewpointModel) -> Body:
    return Body(box, box_model, np.array([200, 60, 30], np.uint8), centre_of_mass(box))


@pytest.fixture(scope="session")
def camera() -> Camera:
    K = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
    return Camera(K, 320, 240)


Draw = Callable[[Mapping[str, Body], Mapping[str, Transform], int], Frame]


@pytest.fixture(scope="session")
def draw(camera: Camera) -> Draw:
    """Draws bodies in their colours before a wall 1.2 m away, with a little noise in everything."""

    def drawn(bodies: Mapping[str, Body], poses: Mapping[str, Transform], index: int) -> Frame:
        rng = np.random.default_rng(index)
        inverse_depth, ids = raster.new_buffers(camera.width, camera.height)
        for number, (name, T) in enumerate(poses.items()):
            raster.draw(
                bodies[name].mesh,
                T,
                K=camera.K,
                inverse_depth=inverse_depth,
                ids=ids,
                number=number,
            )
        rgb = rng.integers(70, 180, (camera.height, camera.width, 3)).astype(np.float64)
        for number, name in enumerate(poses):
            rgb[ids == number] = bodies[name].color + rng.normal(
                0, 8, (int((ids == number).sum()), 3)
            )
        depth = np.where(inverse_depth > 0, 1 / np.maximum(inverse_depth, 1e-6), 1.2)
        depth += rng.normal(0, 5e-4, depth.shape)
        return Frame(
            index,
            index / 30,
            np.clip(rgb, 0, 255).astype(np.uint8),
            depth.astype(np.float32),
            camera,
        )

    return drawn


@pytest.fixture(scope="session")
def box_poses(box_model: ViewpointModel) -> list[Transform]:
    """Fifteen poses T_camera_part of the box, turning 2 degrees and moving 4 mm a frame."""
    axis = np.array([0.3, 1.0, 0.2])
    poses: list[Transform] = []
    for i in range(15):
        R = rotation_about(axis, 0.5 + np.deg2rad(2.0) * i) @ rotation_about(
            np.array([1.0, 0, 0]), 0.6
        )
        t = np.array([-0.03 + 0.003 * i, 0.01 - 0.002 * i, 0.45 + 0.002 * i])
        poses.append(transform_from(R, t - R @ box_model.centre))
    return poses


@pytest.fixture(scope="session")
def add_mm() -> Callable[[Body, Transform, Transform], float]:
    """Mean distance of the mesh's corners between two poses, mm."""

    def measured(body: Body, T: Transform, T_truth: Transform) -> float:
        moved = body.mesh.vertices @ (T - T_truth)[:3, :3].T + (T - T_truth)[:3, 3]
        return float(np.linalg.norm(moved, axis=1).mean()) * 1e3

    return measured
