from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from asdfviz.datatypes import Mesh
from asdfviz.errors import RenderError
from asdfviz.geometry.camera import scaled_intrinsics
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.render import gl_thread
from asdfviz.render.raycast import intersect
from asdfviz.render.renderer import Renderer


def at(x: float, y: float, z: float, *, turn: float = 0.0) -> np.ndarray:
    R = rotation_about(np.array([0.3, 1.0, 0.2]), turn)
    return transform_from(R, np.array([x, y, z]))


def test_nothing_to_draw_is_empty(renderer: Renderer, K: np.ndarray) -> None:
    depth, ids = renderer.depth_and_ids([], [], K)
    assert depth.shape == (120, 160)
    assert (depth == 0).all()
    assert (ids == -1).all()


def test_front_face_of_a_box_is_where_it_should_be(
    renderer: Renderer, K: np.ndarray, box: Mesh
) -> None:
    depth, ids = renderer.depth_and_ids([box], [at(0, 0, 0.4)], K)
    # The face at z = 0.38 spans these pixels; centres inside it belong to it.
    left, right = K[0, 2] - 0.05 / 0.38 * K[0, 0], K[0, 2] + 0.05 / 0.38 * K[0, 0]
    top, bottom = K[1, 2] - 0.03 / 0.38 * K[1, 1], K[1, 2] + 0.03 / 0.38 * K[1, 1]
    v, u = np.mgrid[0:120, 0:160]
    inside = (u > left) & (u < right) & (v > top) & (v < bottom)
    np.testing.assert_array_equal(ids >= 0, inside)
    np.testing.assert_allclose(depth[inside], 0.38, atol=2e-5)
    assert (depth[~inside] == 0).all()


@pytest.mark.parametrize("turn", [0.3, 1.1, 2.6])
def test_depth_of_a_turned_box_equals_the_ray_to_each_pixel(
    renderer: Renderer, K: np.ndarray, box: Mesh, turn: float
) -> None:
    T = at(0.02, -0.01, 0.35, turn=turn)
    depth, _ = renderer.depth_and_ids([box], [T], K)
    for v in range(5, 120, 11):
        for u in range(5, 160, 13):
            ray = np.array([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0])
            distance = intersect(np.zeros(3), ray, box, T)
            expected = 0.0 if distance is None else distance / np.linalg.norm(ray)
            assert depth[v, u] == pytest.approx(expected, abs=5e-5), (u, v)


def test_principal_point_is_exact(renderer: Renderer, box: Mesh) -> None:
    """The middle of a silhouette moves with cx, cy and lies where a fine picture has it."""
    T = at(0, 0, 0.9, turn=0.4)
    offsets = []
    for shift in np.arange(0, 1, 0.05):
        K = np.array([[400.0, 0, 79.5 + shift], [0, 400.0, 59.5 + shift], [0, 0, 1]])
        _, ids = renderer.depth_and_ids([box], [T], K)
        offsets.append(_middle(ids) - (79.5 + shift, 59.5 + shift))
    assert np.ptp(offsets, axis=0).max() < 0.2
    # 1/8 of a pixel is the fine picture's; an error of half a pixel would stay half a pixel here.
    K = scaled_intrinsics(np.array([[400.0, 0, 79.5], [0, 400.0, 59.5], [0, 0, 1]]), 8.0, 8.0)
    with Renderer(1280, 960) as fine:
        _, ids = fine.depth_and_ids([box], [T], K)
    expected = (_middle(ids) - K[:2, 2]) / 8
    np.testing.assert_allclose(np.mean(offsets, axis=0), expected, atol=0.1)


def _middle(ids: np.ndarray) -> np.ndarray:
    v, u = np.nonzero(ids >= 0)
    return np.array([u.mean(), v.mean()])


def test_the_nearer_mesh_hides_the_other(renderer: Renderer, K: np.ndarray, box: Mesh) -> None:
    meshes, Ts = [box, box, box], [at(0, 0, 0.6), at(0.03, 0, 0.4), at(-0.05, 0, 0.8)]
    depth, ids = renderer.depth_and_ids(meshes, Ts, K)
    alone = [renderer.depth_and_ids([box], [T], K)[0] for T in Ts]
    nearest = np.where(np.stack(alone) > 0, np.stack(alone), np.inf)
    expected = np.where(np.isfinite(nearest.min(axis=0)), nearest.argmin(axis=0), -1)
    np.testing.assert_array_equal(ids, expected)
    assert set(np.unique(ids)) == {-1, 0, 1, 2}
    np.testing.assert_array_equal(depth[ids == 1], alone[1][ids == 1])


def test_ids_count_beyond_one_byte(renderer: Renderer, K: np.ndarray, box: Mesh) -> None:
    far = [at(0, 0, 5.0)] * 299
    _, ids = renderer.depth_and_ids([box] * 300, [*far, at(0, 0, 0.4)], K)
    assert ids[56, 83] == 299


def test_a_mesh_is_not_confused_with_one_that_took_its_place(
    renderer: Renderer, K: np.ndarray, box: Mesh
) -> None:
    for scale in (1.0, 0.5, 2.0):
        # A new object each time: memory, and with it the id, is reused.
        scaled = Mesh(box.vertices * scale, box.faces)
        depth, _ = renderer.depth_and_ids([scaled], [at(0, 0, 0.4)], K)
        assert depth[56, 83] == pytest.approx(0.4 - 0.02 * scale, abs=2e-5)
        del scaled


@pytest.mark.parametrize("size", [(161, 119), (33, 17), (3, 5)])
def test_odd_sizes(open_renderer, box: Mesh, size: tuple[int, int]) -> None:
    width, height = size
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    with open_renderer(width, height) as opened:
        depth, ids = opened.depth_and_ids([box], [at(0, 0, 0.1)], K)
        picture = opened.color([box], [at(0, 0, 0.1)], [np.array([200, 20, 20])], K)
    assert depth.shape == ids.shape == picture.shape[:2] == (height, width)
    assert depth[height // 2, width // 2] == pytest.approx(0.08, abs=2e-5)


def test_color_is_the_parts_own_hue(renderer: Renderer, K: np.ndarray, box: Mesh) -> None:
    colors = [np.array([210, 30, 30], dtype=np.uint8), np.array([30, 30, 210], dtype=np.uint8)]
    Ts = [at(-0.06, 0, 0.5), at(0.07, 0, 0.5)]
    picture = renderer.color([box, box], Ts, colors, K, antialias=False)
    _, ids = renderer.depth_and_ids([box, box], Ts, K)
    red, blue = (picture[ids == i].mean(axis=0) for i in (0, 1))
    assert red[0] > 3 * red[2]
    assert blue[2] > 3 * blue[0]
    assert (picture[ids == -1] == 0).all()
    assert (picture[ids >= 0].max(axis=1) > 0).all()


def test_antialiasing_softens_edges_only(renderer: Renderer, K: np.ndarray, box: Mesh) -> None:
    T, white = [at(0, 0, 0.4, turn=0.5)], [np.array([255, 255, 255], dtype=np.uint8)]
    hard = renderer.color([box], T, white, K, antialias=False).astype(int)
    soft = renderer.color([box], T, white, K).astype(int)
    _, ids = renderer.depth_and_ids([box], T, K)
    changed = np.abs(hard - soft).max(axis=2) > 3
    assert changed.any()
    assert changed.mean() < 0.06
    assert not changed[ids < 0].all()


def test_two_threads_and_two_renderers_get_their_own_pictures(
    renderer: Renderer, K: np.ndarray, box: Mesh, open_renderer
) -> None:
    other = open_renderer(80, 60)
    K_other = scaled_intrinsics(K, 0.5, 0.5)
    expected = {
        z: (renderer.depth_and_ids([box], [at(0, 0, z)], K)[0],
            other.depth_and_ids([box], [at(0, 0, z)], K_other)[0])
        for z in (0.3, 0.5)
    }  # fmt: skip
    wrong: list[str] = []

    def draw(z: float) -> None:
        for _ in range(25):
            for opened, intrinsics, i in ((renderer, K, 0), (other, K_other, 1)):
                depth, _ids = opened.depth_and_ids([box], [at(0, 0, z)], intrinsics)
                if not np.array_equal(depth, expected[z][i]):
                    wrong.append(f"z = {z}")

    threads = [threading.Thread(target=draw, args=(z,)) for z in expected]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    other.close()
    assert wrong == []
    # Closing one must leave the other's context alone.
    np.testing.assert_array_equal(
        renderer.depth_and_ids([box], [at(0, 0, 0.3)], K)[0], expected[0.3][0]
    )


def test_a_closed_renderer_says_so(open_renderer, box: Mesh, K: np.ndarray) -> None:
    opened = open_renderer(32, 32)
    opened.close()
    opened.close()
    with pytest.raises(RenderError, match="closed"):
        opened.depth_and_ids([box], [at(0, 0, 0.4)], K)


@pytest.mark.parametrize("size", [(0, 10), (10, -1)])
def test_a_size_without_pixels_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(RenderError, match="pixels"):
        Renderer(*size)


def test_an_error_in_the_render_thread_reaches_the_caller(renderer: Renderer, box: Mesh) -> None:
    with pytest.raises(ValueError, match="zip"):
        renderer.depth_and_ids([box], [], np.eye(3))


def test_missing_egl_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> object:
        raise ImportError(f"Unable to load EGL library for {name}")

    monkeypatch.setattr(gl_thread.importlib, "import_module", missing)
    with pytest.raises(RenderError, match="apt-get install libegl1 libgl1-mesa-dri"):
        gl_thread.load_pyrender()


def test_a_forked_process_is_refused_instead_of_hanging(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fork copies the object but not its thread: waiting for it would never end."""
    thread = gl_thread.RenderThread()
    assert thread.call(lambda: 3) == 3
    child = os.getpid() + 1
    monkeypatch.setattr(gl_thread.os, "getpid", lambda: child)
    with pytest.raises(RenderError, match="spawn"):
        thread.call(lambda: 3)
