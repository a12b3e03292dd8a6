from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Mesh
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.track import raster

K = np.array([[100.0, 0.0, 49.5], [0.0, 100.0, 39.5], [0.0, 0.0, 1.0]])


def plane(z: float, size: float) -> Mesh:
    corners = np.array([[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def test_depth_of_a_tilted_plane_is_exact() -> None:
    tilt = transform_from(rotation_about(np.array([1.0, 0.0, 0.0]), 0.5), np.array([0.0, 0.0, 1.0]))
    inverse_depth, ids = raster.new_buffers(100, 80)
    raster.draw(plane(0.0, 0.2), tilt, K=K, inverse_depth=inverse_depth, ids=ids, number=4)
    v, u = np.nonzero(ids == 4)
    assert len(v) > 500
    # The plane's points satisfy n . x = n . c with n the turned z axis and c its middle.
    rays = np.stack([(u - 49.5) / 100, (v - 39.5) / 100, np.ones(len(u))], axis=1)
    n = tilt[:3, 2]
    expected = (rays @ n) / (n @ tilt[:3, 3])
    np.testing.assert_allclose(inverse_depth[v, u], expected, rtol=1e-5)
    assert (inverse_depth[ids < 0] == 0).all()


def test_pixels_are_those_whose_centre_is_inside() -> None:
    inverse_depth, ids = raster.new_buffers(100, 80)
    raster.draw(plane(1.0, 0.1001), np.eye(4), K=K, inverse_depth=inverse_depth, ids=ids, number=0)
    v, u = np.nonzero(ids == 0)
    assert (u.min(), u.max(), v.min(), v.max()) == (40, 59, 30, 49)
    assert len(u) == 400


def test_the_nearer_mesh_hides_the_other_in_either_order() -> None:
    for order in ((0, 1), (1, 0)):
        inverse_depth, ids = raster.new_buffers(100, 80)
        for number in order:
            mesh = plane(1.0 + number, 0.15)
            raster.draw(mesh, np.eye(4), K=K, inverse_depth=inverse_depth, ids=ids, number=number)
        assert ids[39, 49] == 0


def test_meshes_behind_the_camera_and_off_the_image_draw_nothing() -> None:
    for offset in ([0.0, 0.0, -2.0], [50.0, 0.0, 1.0], [0.0, -50.0, 1.0]):
        inverse_depth, ids = raster.new_buffers(100, 80)
        T = transform_from(np.eye(3), np.array(offset))
        raster.draw(plane(0.0, 0.2), T, K=K, inverse_depth=inverse_depth, ids=ids, number=0)
        assert (ids == -1).all()


def test_without_a_number_the_ids_are_the_triangles() -> None:
    inverse_depth, ids = raster.new_buffers(100, 80)
    raster.draw(plane(1.0, 0.2), np.eye(4), K=K, inverse_depth=inverse_depth, ids=ids)
    assert set(np.unique(ids)) == {-1, 0, 1}
