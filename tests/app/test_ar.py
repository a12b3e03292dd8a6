"""The AR maths against OpenCV's projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from asdfviz.app import ar

K = np.array([[607.2, 0.0, 639.2], [0.0, 606.8, 364.8], [0.0, 0.0, 1.0]])
SIZE = (1280, 720)
SHIFTED = np.array([[500.0, 0.0, 420.0], [0.0, 520.0, 180.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("intrinsics", [K, SHIFTED])
def test_the_plane_puts_every_pixel_where_its_ray_goes(intrinsics: np.ndarray) -> None:
    plane = ar.image_plane(intrinsics, SIZE)
    x, y, z = plane.position
    for u, v in [(0.0, 0.0), (1279.0, 719.0), (400.25, 99.5)]:
        # A plane of w x h pixels centred on its position: pixel (u, v) lies at its share of it.
        on_plane = np.array(
            [
                x + ((u + 0.5) / SIZE[0] - 0.5) * plane.width,
                y + ((v + 0.5) / SIZE[1] - 0.5) * plane.height,
                z,
            ]
        )
        seen = cv2.projectPoints(on_plane[None], np.zeros(3), np.zeros(3), intrinsics, None)[0]
        assert seen.ravel() == pytest.approx([u, v], abs=1e-9)


@pytest.mark.parametrize("aspect", [0.7, 1.0, 16 / 9, 3.0])
@pytest.mark.parametrize("intrinsics", [K, SHIFTED])
def test_the_whole_picture_fits_and_touches_the_window(
    intrinsics: np.ndarray, aspect: float
) -> None:
    t = np.tan(ar.fit_fov(intrinsics, SIZE, aspect) / 2)
    u, v = np.array([-0.5, 1279.5]), np.array([-0.5, 719.5])
    x = np.abs((u - intrinsics[0, 2]) / intrinsics[0, 0]) / (t * aspect)
    y = np.abs((v - intrinsics[1, 2]) / intrinsics[1, 1]) / t
    assert max(x.max(), y.max()) == pytest.approx(1.0)


def test_zoom_magnifies_the_middle_by_its_factor() -> None:
    fov = ar.fit_fov(K, SIZE, 1.5)
    assert np.tan(fov / 2) / np.tan(ar.zoomed_fov(fov, 4.0) / 2) == pytest.approx(4.0)


@pytest.mark.parametrize("ndc", [(0.0, 0.0), (0.5, -0.4), (-0.8, 0.6)])
@pytest.mark.parametrize("steps", [1, 3])
def test_zooming_keeps_what_is_under_the_pointer(ndc: tuple[float, float], steps: int) -> None:
    window = ar.Window(K, SIZE, 1.6)
    centre, zoom = ar.rest_centre(K), 1.0
    before = window.pixel(centre, ndc, zoom=zoom)
    for _ in range(steps):
        zoom, centre = ar.zoom_about(window, centre, zoom=zoom, factor=1.5, ndc=ndc)
    assert zoom == pytest.approx(1.5**steps)
    assert window.pixel(centre, ndc, zoom=zoom) == pytest.approx(before, abs=0.05)


def test_zooming_out_shows_the_whole_picture_again() -> None:
    window = ar.Window(K, SIZE, 1.6)
    zoom, centre = ar.zoom_about(window, (900.0, 100.0), zoom=1.2, factor=0.5)
    assert (zoom, centre) == (1.0, (639.2, 364.8))


def test_zoom_ends_and_never_leaves_the_picture() -> None:
    window = ar.Window(K, SIZE, 1.6)
    zoom, centre = ar.zoom_about(window, (1279.0, 0.0), zoom=10.0, factor=50.0, ndc=(1.0, -1.0))
    assert zoom == ar.ZOOM_RANGE[1]
    assert 0 <= centre[0] <= 1279
    assert 0 <= centre[1] <= 719


def test_the_view_looks_through_its_pixel_without_tilting() -> None:
    R = ar.look_rotation(K, (200.0, 600.0))
    assert pytest.approx(np.eye(3), abs=1e-12) == R.T @ R
    assert R[1, 0] == pytest.approx(0.0, abs=1e-12)  # its x axis stays level
    pixel = ar.pixel_at(K, R, fov=1.0, aspect=1.5, ndc=(0.0, 0.0))
    assert pixel == pytest.approx((200.0, 600.0))


def test_the_pinned_centre_moves_by_nothing_visible() -> None:
    # Turned by 90 degrees the centre is 1.4 orbits away: in pixels, at 0.2 m and zoom 16.
    assert 1.5 * ar.ORBIT / 0.2 * 607 * 16 < 0.75
    assert 1.5 * ar.ORBIT / 0.2 * 607 < 0.1
