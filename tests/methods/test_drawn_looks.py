"""Poses of a part on a table, as a depth camera that smears and a lamp from one side show it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from roof_scene import BOTH, CAMERA, SMEAR_PX, TABLE, Seen, frame, roof

from asdfviz.datatypes import Frame, Mesh
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.drawn_kernels import laid_over, mean_gap, normals_shown
from asdfviz.methods.drawn_looks import DrawnConfig, drawn_looks
from asdfviz.methods.drawn_smear import Smear
from asdfviz.pose.table import Table
from asdfviz.track import raster
from asdfviz.track.viewpoint_model import face_normals, face_planes


def lead(shot: Frame, *, table: Table | None = TABLE, **options: Any) -> float:
    """By how much the true pose is ahead of the turned one."""
    looks = drawn_looks(shot, roof(), BOTH, table=table, config=DrawnConfig(**options))
    assert looks is not None
    return float(looks[0] - looks[1])


@pytest.mark.parametrize("table", [TABLE, None], ids=["table", "no table"])
def test_depth_tells_a_part_end_for_end_in_every_frame(table: Table | None) -> None:
    leads = [lead(frame(seed=k), table=table, shade=0.0) for k in range(8)]
    assert min(leads) > 0.02


def test_shading_tells_it_without_depth() -> None:
    dark = replace(frame(), depth=None)
    assert lead(dark) > 0.01
    assert lead(dark, shade=0.0) == 0, "no depth says nothing"
    even = replace(frame(Seen(shading=0.0)), depth=None)
    assert abs(lead(even)) < 0.01, "nor does a surface that reflects alike everywhere"


def test_depth_that_was_smeared_fits_when_drawn_so() -> None:
    def fit(share: float) -> float:
        config, smear, shot = DrawnConfig(shade=0.0), Smear(share), frame(Seen(noise=0))
        looks = drawn_looks(shot, roof(), BOTH, table=TABLE, config=config, smear=smear)
        assert looks is not None
        return float(looks[0])

    right = SMEAR_PX / 300
    assert fit(right) > max(fit(right / 4), fit(right * 3))
    assert fit(right) > -180 * 2e-4


def test_what_hides_a_part_leaves_nothing_to_compare() -> None:
    shot = frame()
    assert shot.depth is not None
    covered = replace(shot, depth=np.full_like(shot.depth, 0.4))
    assert drawn_looks(covered, roof(), BOTH, table=TABLE, config=DrawnConfig()) is None
    outside = BOTH.copy()
    outside[:, 0, 3] = 2.0
    assert drawn_looks(shot, roof(), outside, table=TABLE, config=DrawnConfig()) is None
    half = shot.depth.copy()
    half[:, 160:] = 0.4
    assert lead(replace(shot, depth=half)) > 0, "the other half still tells"


def bar(length: float, at: Transform) -> tuple[Mesh, Transform]:
    """A rod of 8 by 8 mm about its own middle."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [t for a, b, c, d in faces for t in ([a, b, c], [a, c, d])]
    vertices = corners * np.array([length / 2, 0.004, 0.004])
    return Mesh(vertices, np.array(triangles, np.int32)), at


def test_a_part_that_others_cover_is_seen_where_they_leave_it() -> None:
    """A pin through a sleeve: that what lies over its middle is no pin speaks for one on its end alone,
    unless it is known what it is."""
    pin, through = bar(0.08, transform_from(np.eye(3), np.array([0, 0, 0.57])))
    sleeve = bar(0.04, transform_from(np.eye(3), np.array([0, 0, 0.558])))
    on_end = transform_from(
        rotation_about(np.array([0.0, 1, 0]), np.pi / 2), np.array([-0.034, 0, 0.59])
    )
    inverse, ids = raster.new_buffers(CAMERA.width, CAMERA.height)
    raster.draw(pin, through, K=CAMERA.K, inverse_depth=inverse, ids=ids)
    rgb = np.full((*inverse.shape, 3), 120.0)
    rgb[inverse > 0] = (200, 60, 60)
    bare = inverse.copy()
    raster.draw(*sleeve, K=CAMERA.K, inverse_depth=inverse, ids=ids)
    rgb[inverse > bare] = 40
    flat = np.where(inverse > 0, 1 / np.maximum(inverse, 1e-9), 0.6).astype(np.float64)
    depth = Smear().applied(flat, focal=300.0)
    rgb += np.random.default_rng(0).normal(size=rgb.shape) * 2
    shot = Frame(0, 0.0, np.clip(rgb, 0, 255).astype(np.uint8), depth, CAMERA)
    leads: list[float] = []
    for others in ((), (sleeve,)):
        both = np.stack([through, on_end])
        looks = drawn_looks(shot, pin, both, table=TABLE, config=DrawnConfig(), others=others)
        assert looks is not None
        leads.append(float(looks[0] - looks[1]))
    assert leads[0] < 0 < leads[1]


def test_what_a_pose_leaves_to_something_nearer_costs_it() -> None:
    """Else a pose is the better the less of what is seen it explains."""
    shot, depth_alone = frame(Seen(noise=0)), DrawnConfig(shade=0.0, outline=0.0)
    assert shot.depth is not None
    covered = shot.depth.copy()
    covered[:, 160:] = 0.4
    free, half = (
        drawn_looks(one, roof(), BOTH, table=TABLE, config=depth_alone)
        for one in (shot, replace(shot, depth=covered))
    )
    assert free is not None
    assert half is not None
    assert half[0] < free[0] - 0.3


@pytest.mark.parametrize("wrong", [{"outline": -1.0}, {"depth": -1.0}, {"shade": -0.1}])
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"turns\.drawn"):
        DrawnConfig(**wrong)


def test_normals_are_those_of_the_faces_in_camera_axes() -> None:
    mesh, T = roof(), np.ascontiguousarray(BOTH[0])
    inverse, ids = raster.new_buffers(CAMERA.width, CAMERA.height)
    raster.draw(mesh, T, K=CAMERA.K, inverse_depth=inverse, ids=ids)
    seen = ids >= 0
    shown = normals_shown(ids, seen, *face_planes(mesh), T)
    expected = face_normals(mesh, ids[seen], T) @ T[:3, :3].T
    assert seen.any()
    assert np.allclose(shown[seen, :3], expected, atol=1e-6)
    assert np.array_equal(shown[..., 3] > 0, seen)
    assert not shown[~seen].any()


def test_a_pose_lies_over_what_is_behind_it_and_under_what_hides_it() -> None:
    z = np.array([[0.5, 0.5, np.inf, np.inf]])
    bare = np.full((1, 4), 0.6)
    depth = np.array([[0.3, 0.5, 0.3, 0.6]])
    surface, hidden, seen, count = laid_over(z, bare, depth, 0.01)
    assert surface.tolist() == [[0.5, 0.5, 0.6, 0.6]]
    assert hidden.tolist() == [[True, False, True, False]]
    assert seen.tolist() == [[False, True, False, False]]
    assert count == 1


def test_the_gap_is_a_mean_over_readings_of_the_rim() -> None:
    depth = np.array([[0.5, 0.0, 0.5, 0.5, 0.5]])
    smeared = np.array([[0.503, 0.6, 0.8, 0.5, 0.9]], np.float32)
    rim = np.array([[True, True, True, True, False]])
    hidden = np.array([[False, False, False, True, False]])
    gap, clear = mean_gap(smeared, depth, rim, hidden, 0.01, 0.008)
    assert gap == pytest.approx((0.003 + 0.01 + 0.008) / 3, abs=1e-6)
    assert clear == 2
