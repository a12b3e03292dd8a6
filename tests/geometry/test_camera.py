from __future__ import annotations

import cv2
import numpy as np
import pytest

from asdfviz.geometry.camera import back_project, points_from_depth, project, scaled_intrinsics

K = np.array([[600.0, 0.0, 321.3], [0.0, 590.0, 238.9], [0.0, 0.0, 1.0]])
SKEWED = np.array([[600.0, 3.0, 321.3], [0.0, 590.0, 238.9], [0.0, 0.0, 1.0]])


def points(count: int = 50) -> np.ndarray:
    rng = np.random.default_rng(4)
    return rng.uniform([-0.3, -0.2, 0.3], [0.3, 0.2, 1.5], (count, 3))


def test_projection_is_opencvs() -> None:
    expected, _ = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), K, None)
    np.testing.assert_allclose(project(points(), K), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("intrinsics", [K, SKEWED], ids=["plain", "skewed"])
def test_back_projection_undoes_projection(intrinsics: np.ndarray) -> None:
    there = project(points(), intrinsics)
    np.testing.assert_allclose(
        back_project(there, points()[:, 2], intrinsics), points(), atol=1e-12
    )


@pytest.mark.parametrize("z", [0.0, -1.0])
def test_points_at_or_behind_the_camera_have_no_pixel(z: float) -> None:
    assert np.isnan(project(np.array([[0.1, 0.1, z]]), K)).all()


def test_no_points_no_pixels() -> None:
    assert project(np.zeros((0, 3)), K).shape == (0, 2)


def test_depth_becomes_points_and_holes_do_not() -> None:
    depth = np.zeros((480, 640), dtype=np.float32)
    assert points_from_depth(depth, K)[0].shape == (0, 3)
    depth[100, 200], depth[300, 400] = 0.5, 0.75
    found, pixels = points_from_depth(depth, K)
    np.testing.assert_array_equal(pixels, [[200, 100], [400, 300]])
    np.testing.assert_allclose(project(found, K), pixels, atol=1e-4)
    np.testing.assert_allclose(found[:, 2], [0.5, 0.75])


def test_stride_keeps_pixels_true() -> None:
    depth = np.full((48, 64), 0.6, dtype=np.float32)
    found, pixels = points_from_depth(depth, K, stride=4)
    assert len(found) == 12 * 16
    assert pixels.max(axis=0).tolist() == [60, 44]
    np.testing.assert_allclose(project(found, K), pixels, atol=1e-4)


@pytest.mark.parametrize("scale", [0.5, 2.0, 1.7])
def test_scaling_keeps_the_picture_borders_in_place(scale: float) -> None:
    """The left border is at -0.5 before and after, the right one at width - 0.5."""
    K_scaled = scaled_intrinsics(K, scale, scale)
    borders = np.array([[-0.5, -0.5], [639.5, 479.5]])
    rays = back_project(borders, np.ones(2), K)
    expected = np.array([[-0.5, -0.5], [640 * scale - 0.5, 480 * scale - 0.5]])
    np.testing.assert_allclose(project(rays, K_scaled), expected, atol=1e-9)
    np.testing.assert_allclose(scaled_intrinsics(K_scaled, 1 / scale, 1 / scale), K, atol=1e-9)
