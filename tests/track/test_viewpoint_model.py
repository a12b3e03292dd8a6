from __future__ import annotations

from dataclasses import fields

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Mesh
from asdfviz.errors import Stopped
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.track.viewpoint_model import (
    EDGE_COLUMN,
    ViewpointConfig,
    ViewpointModel,
    build_viewpoint_model,
    sphere_directions,
    view_transform,
)


def test_the_same_mesh_gives_the_same_model(
    box: Mesh, box_model: ViewpointModel, small_views: ViewpointConfig
) -> None:
    again = build_viewpoint_model(box, config=small_views)
    for f in fields(ViewpointModel):
        np.testing.assert_array_equal(getattr(again, f.name), getattr(box_model, f.name))


@pytest.mark.parametrize(("level", "count"), [(0, 12), (1, 42), (3, 642)])
def test_directions_are_even_unit_vectors(level: int, count: int) -> None:
    directions = sphere_directions(level)
    assert len(directions) == count
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    assert np.arccos(nearest).max() < 1.25 * np.arccos(nearest).min()


def test_default_has_642_views() -> None:
    assert len(sphere_directions(ViewpointConfig().subdivisions)) == 642


def test_points_lie_on_the_surface(
    box_model: ViewpointModel, half: np.ndarray, small_views: ViewpointConfig
) -> None:
    """Outside of a box the largest of |x| - half is the distance from its surface."""
    np.testing.assert_allclose(box_model.centre, [0.01, 0.02, -0.03])
    pixel = 2 * np.linalg.norm(half) / small_views.image_size
    for points in (box_model.contours[..., :3], box_model.surfaces[..., :3]):
        distance = (np.abs(points) - half).max(axis=-1)
        assert np.abs(distance).max() < 2 * pixel


def test_surface_normals_are_the_box_axes_and_face_the_camera(box_model: ViewpointModel) -> None:
    normals = box_model.surfaces[..., 3:6]
    np.testing.assert_allclose(np.abs(normals).max(axis=-1), 1.0, atol=1e-6)
    away = np.einsum("vni,vi->vn", normals, box_model.directions)
    assert away.max() < 0.15


def test_contour_normals_point_out_of_the_silhouette(
    box_model: ViewpointModel, half: np.ndarray
) -> None:
    out = box_model.contours[..., 3:6]
    np.testing.assert_allclose(np.linalg.norm(out, axis=-1), 1.0, atol=1e-5)
    # A box is convex and its middle inside, so every outward normal has a positive lever.
    assert (out * box_model.contours[..., :3]).sum(axis=-1).min() > 0
    # No background is met again behind a convex outline; inside, the box is crossed.
    assert box_model.contours[..., 7].min() > 1e3
    assert np.median(box_model.contours[..., 6]) > half.min()


def test_offsets_are_how_far_the_part_rises_in_front(
    box_model: ViewpointModel, half: np.ndarray
) -> None:
    assert box_model.contour_offsets.min() >= 0
    grows = np.diff(box_model.surface_offsets, axis=-1)
    assert grows.min() >= 0
    assert box_model.surface_offsets.max() < 2 * np.linalg.norm(half)


def test_the_views_around_a_pose(box_model: ViewpointModel) -> None:
    for k in (0, 17, 161):
        T = view_transform(box_model.directions[k].astype(np.float64), 0.5)
        views = box_model.views(T)
        assert views.indices[0] == k
        assert views.shares[0] > 0.99


def test_three_views_stand_for_a_direction_between_them(box_model: ViewpointModel) -> None:
    """162 views are 17 degrees apart: the nearest alone is up to 10 off, three together 2."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        R = rotation_about(rng.normal(size=3), rng.uniform(0.0, 3.0))
        T = transform_from(R, np.array([0.1, -0.05, 0.6]))
        views = box_model.views(T)
        towards = T[:3, :3].T @ T[:3, 3] / np.linalg.norm(T[:3, 3])
        assert views.indices[0] == (box_model.directions @ towards).argmax()
        mixed = views.shares @ box_model.directions[views.indices]
        cosine = mixed @ towards / np.linalg.norm(mixed)
        assert np.rad2deg(np.arccos(min(cosine, 1.0))) < 2.5
        assert views.shares.sum() == pytest.approx(1.0)


def test_progress_is_told_and_stop_is_heard(box: Mesh, small_views: ViewpointConfig) -> None:
    told: list[tuple[int, int]] = []
    with pytest.raises(Stopped):
        build_viewpoint_model(
            box,
            config=small_views,
            progress=lambda done, all_: told.append((done, all_)),
            stop=lambda: len(told) == 5,
        )
    assert told == [(k, 162) for k in range(1, 6)]


def test_surface_points_know_how_far_the_outline_is(
    box_model: ViewpointModel, half: np.ndarray, small_views: ViewpointConfig
) -> None:
    """Of a box the outline is the hull of its projected corners."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    radius = max(small_views.radius, 4 * float(np.linalg.norm(half)))
    pixel = 2 * np.linalg.norm(half) / small_views.image_size
    for direction, surface in zip(box_model.directions, box_model.surfaces, strict=True):
        T = view_transform(direction.astype(np.float64), radius)
        seen = apply(T, corners)
        hull = cv2.convexHull((seen[:, :2] / seen[:, 2:]).astype(np.float32))
        points = apply(T, surface[:, :3].astype(np.float64))
        for (x, y, z), edge in zip(points[::10], surface[::10, EDGE_COLUMN], strict=True):
            expected = cv2.pointPolygonTest(hull, (x / z, y / z), measureDist=True) * z
            # OpenCV's distances, by steps to neighbours, are a little off the straight ones.
            assert abs(edge - expected) < 1.5 * pixel + 0.05 * expected
