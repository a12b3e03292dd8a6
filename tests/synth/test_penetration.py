"""How deep solids stand in one another, against boxes whose depths are known and against trimesh."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Mesh
from asdfviz.geometry.inside import inside
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.synth.penetration import depth, penetration, solid_of, surface_distance
from asdfviz.synth.primitives import box


def at(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    return transform_from(np.eye(3), np.array([x, y, z]))


def test_inside_and_distance_of_a_box_are_exact() -> None:
    size = np.array([0.1, 0.06, 0.14])
    solid = solid_of(box(tuple(size)))
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (600, 3))
    beyond = np.abs(points) - size / 2
    expected = (beyond < 0).all(axis=1)
    assert np.array_equal(inside(points, solid.interior), expected)
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    exact = np.where(expected, -beyond.max(axis=1), outside)
    assert np.abs(surface_distance(points, solid) - exact).max() < 1e-7


@pytest.mark.parametrize("overlap_mm", [-1.0, 0.5, 3.0, 8.0])
def test_two_boxes_stand_in_each_other_as_deep_as_they_overlap(overlap_mm: float) -> None:
    solid = solid_of(box((0.04, 0.04, 0.04)))
    found = penetration(solid, solid, at(0.04 - overlap_mm / 1000, 0.003, -0.002))
    assert found == pytest.approx(max(overlap_mm, 0.0) / 1000, abs=1e-4)


def test_a_rod_through_a_plate_is_seen_though_no_corner_is_inside() -> None:
    rod, plate = solid_of(box((0.01, 0.01, 0.1))), solid_of(box((0.08, 0.08, 0.008)))
    turned = transform_from(rotation_about(np.array([0.2, 1.0, 0.1]), 0.3), np.zeros(3))
    assert 0.003 < penetration(rod, plate, turned) < 0.006


def test_measuring_few_of_the_points_never_gives_more() -> None:
    solid = solid_of(box((0.05, 0.05, 0.05)))
    points = np.random.default_rng(1).uniform(-0.02, 0.02, (200, 3))
    assert 0 < depth(points, solid, most=5) <= depth(points, solid)


@pytest.mark.parametrize("name", ["base", "jaw", "bolt"])
def test_the_deepest_point_is_found_without_measuring_all(name: str) -> None:
    solid = solid_of(load_assembly("corner_clamp").parts[name].mesh)
    rng = np.random.default_rng(3)
    for count in (1, 40, 1500):
        points = rng.uniform(solid.low, solid.high, (count, 3))
        within = points[inside(points, solid.interior)]
        dense = np.array([surface_distance(point[None], solid)[0] for point in within])
        assert depth(points, solid) == pytest.approx(dense.max() if len(dense) else 0.0, abs=1e-9)
        np.testing.assert_allclose(surface_distance(within, solid), dense, atol=1e-9)


@pytest.mark.parametrize("name", ["base", "bolt"])
def test_a_depth_that_matters_is_exact_whatever_need_not_be_told(name: str) -> None:
    solid = solid_of(load_assembly("corner_clamp").parts[name].mesh)
    rng = np.random.default_rng(4)
    middle = (solid.low + solid.high) / 2
    for most in (None, 20):
        for spread in (0.4, 1.0):
            points = middle + spread * (rng.uniform(solid.low, solid.high, (300, 3)) - middle)
            exact = depth(points, solid, most=most)
            assert exact > 0
            for share in (0.1, 0.5, 0.99):
                assert depth(points, solid, most=most, least=share * exact) == exact
                assert share * exact <= depth(points, solid, most=most, enough=share * exact)
            for share in (1.0, 1.1, 3.0):
                assert depth(points, solid, most=most, least=share * exact) <= share * exact
                assert depth(points, solid, most=most, enough=share * exact) == exact


def test_a_corner_that_no_face_uses_is_not_on_the_surface() -> None:
    cube = box((0.05, 0.05, 0.05))
    stray = Mesh(np.concatenate([cube.vertices, [[0.01, 0, 0]]]), cube.faces)
    inner = np.array([[0.01, 0.0, 0.001]])
    assert depth(inner, solid_of(stray)) == pytest.approx(0.015)


def test_real_meshes_agree_with_the_volume_of_random_points() -> None:
    mesh = load_assembly("corner_clamp").parts["jaw"].mesh
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = abs(float((a * np.cross(b, c)).sum())) / 6
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = np.random.default_rng(2).uniform(low, high, (20000, 3))
    share = inside(points, solid_of(mesh).interior).mean()
    assert share * float((high - low).prod()) == pytest.approx(volume, rel=0.03)
