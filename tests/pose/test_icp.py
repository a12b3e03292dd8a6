from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Depth, Transform
from asdfviz.geometry.transforms import apply, rotation_about, rotation_angle, transform_from
from asdfviz.pose.icp import IcpConfig, ModelCloud, register

K = np.array([[600.0, 0, 160], [0, 600, 120], [0, 0, 1]])
SHAPE = (240, 320)
TRUE = transform_from(rotation_about(np.array([0.6, 0.8, 0.0]), 0.7), np.array([0.01, -0.01, 0.6]))
FITTING = IcpConfig(direction="scan_to_model")


def stair() -> tuple[np.ndarray, np.ndarray]:
    """An L of two boxes, 60 x 30 x 20 mm and a 20 mm tower: no symmetry."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[0], *pair] for q in quads for pair in (q[1:3], q[2:4])], np.int32)
    base = corners * [0.06, 0.03, 0.02] - [0.03, 0.015, 0.01]
    tower = corners * [0.02, 0.03, 0.03] + [-0.03, -0.015, 0.01]
    return np.concatenate([base, tower]), np.concatenate([faces, faces + 8]).astype(np.int32)


def measured(T_camera_part: Transform, *, table: float = 0.0) -> Depth:
    """Depth of the part by dense points, nearest first; a table behind if asked for."""
    vertices, faces = stair()
    points = apply(T_camera_part, surface_points(vertices, faces, 150_000, seed=3))
    pixels = np.round(points @ K.T / points[:, 2:])[:, :2].astype(int)
    depth = np.full(SHAPE, np.inf)
    np.minimum.at(depth, (pixels[:, 1], pixels[:, 0]), points[:, 2])
    depth[~np.isfinite(depth)] = table
    return depth.astype(np.float32)


@pytest.fixture(scope="module")
def model() -> ModelCloud:
    return ModelCloud(surface_points(*stair(), 3000))


def disturbed(degrees: float, shift: float) -> Transform:
    turn = transform_from(
        rotation_about(np.array([0.0, 0.6, 0.8]), np.radians(degrees)), np.zeros(3)
    )
    moved = TRUE @ turn
    moved[:3, 3] += np.array([0.6, 0.0, 0.8]) * shift
    return moved


def errors(T: Transform) -> tuple[float, float]:
    angle = rotation_angle(T[:3, :3].T @ TRUE[:3, :3])
    return float(np.degrees(angle)), float(np.linalg.norm(T[:3, 3] - TRUE[:3, 3])) * 1e3


BOX = np.array([90.0, 40.0, 240.0, 190.0])


def test_the_scan_is_drawn_to_the_model() -> None:
    model = ModelCloud(surface_points(*stair(), 3000))
    depth = measured(TRUE, table=0.75)
    found = register(disturbed(8.0, 0.008), model, box_xyxy=BOX, depth=depth, K=K, config=FITTING)
    assert found is not None
    rotation_deg, shift_mm = errors(found.T_camera_part)
    assert rotation_deg < 1.0
    assert shift_mm < 1.0
    assert found.share > 0.8
    assert found.residual < 0.002


def test_the_papers_direction_is_worse_in_rotation_but_helps_distance(model: ModelCloud) -> None:
    depth = measured(TRUE)
    start = disturbed(0.0, 0.012)
    both = [
        register(start, model, box_xyxy=BOX, depth=depth, K=K, config=config)
        for config in (IcpConfig(), FITTING)
    ]
    assert both[0] is not None
    assert both[1] is not None
    faithful, ours = errors(both[0].T_camera_part), errors(both[1].T_camera_part)
    assert faithful[1] < 12.0
    assert ours[0] < faithful[0]
    assert ours[1] < faithful[1]


def test_what_cannot_be_registered_is_left_alone(model: ModelCloud) -> None:
    depth = measured(TRUE)
    nothing = np.zeros(SHAPE, np.float32)
    outside = np.array([-50.0, -50.0, -10.0, -10.0])
    far = disturbed(0.0, 0.3)
    assert register(TRUE, model, box_xyxy=BOX, depth=nothing, K=K, config=FITTING) is None
    assert register(TRUE, model, box_xyxy=outside, depth=depth, K=K, config=FITTING) is None
    assert register(far, model, box_xyxy=BOX, depth=depth, K=K, config=FITTING) is None
    bound = replace(FITTING, largest_move=0.001)
    start = disturbed(0.0, 0.01)
    assert register(start, model, box_xyxy=BOX, depth=depth, K=K, config=bound) is None
