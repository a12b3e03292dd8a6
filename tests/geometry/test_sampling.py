from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.sampling import diameter, farthest_points, surface_points
from asdfviz.geometry.transforms import apply, rotation_about, transform_from

# An L-shaped sheet of two triangles, one three times as large as the other.
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


def test_farthest_points_of_a_line_are_its_ends_then_the_middle() -> None:
    line = np.stack([np.linspace(0, 1, 101), np.zeros(101), np.zeros(101)], axis=1)
    found = farthest_points(line, 3)
    assert sorted(found[:2, 0]) == [0.0, 1.0]
    assert found[2, 0] == pytest.approx(0.5)


def test_each_is_the_farthest_from_those_before() -> None:
    cloud = np.random.default_rng(0).normal(size=(300, 3))
    found = farthest_points(cloud, 17)
    assert len(np.unique(found, axis=0)) == 17
    for count in range(1, 17):
        distances = np.linalg.norm(cloud[:, None] - found[None, :count], axis=2).min(axis=1)
        nearest = np.linalg.norm(found[count] - found[:count], axis=1).min()
        assert nearest == pytest.approx(distances.max())


def test_fewer_points_than_wanted_give_them_all() -> None:
    assert len(farthest_points(VERTICES, 17)) == 4


def test_farthest_points_move_with_the_shape() -> None:
    cloud = np.random.default_rng(1).normal(size=(200, 3))
    T = transform_from(rotation_about(np.array([1.0, 2, 3]), 0.8), np.array([0.1, 2.0, -1.0]))
    np.testing.assert_allclose(
        farthest_points(apply(T, cloud), 8), apply(T, farthest_points(cloud, 8)), atol=1e-9
    )


def test_surface_points_lie_on_the_surface_evenly() -> None:
    found = surface_points(VERTICES, FACES, 8000)
    on_first = np.abs(found[:, 2]) < 1e-12
    on_second = np.abs(found[:, 0]) < 1e-12
    assert (on_first | on_second).all()
    assert on_first.mean() == pytest.approx(0.25, abs=0.02)
    np.testing.assert_allclose(
        found[on_first & ~on_second].mean(axis=0), [1 / 3, 1 / 3, 0], atol=0.02
    )
    assert (found >= 0).all()
    assert (found[on_first, 0] + found[on_first, 1] <= 1 + 1e-12).all()


def test_surface_points_repeat_with_the_seed() -> None:
    one, two = (surface_points(VERTICES, FACES, 50, seed=s) for s in (3, 4))
    np.testing.assert_array_equal(one, surface_points(VERTICES, FACES, 50, seed=3))
    assert np.abs(one - two).max() > 0.01


@pytest.mark.parametrize("seed", range(5))
def test_diameter_against_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = rng.normal(size=(400, 3)) * rng.uniform(0.02, 0.1, 3)
    exact = np.linalg.norm(cloud[:, None] - cloud[None], axis=2).max()
    assert exact * 0.999 <= diameter(cloud) <= exact + 1e-12


def test_diameter_of_a_box_is_its_diagonal() -> None:
    corners = np.array([[i, j, k] for i in (0, 0.3) for j in (0, 0.2) for k in (0, 0.1)])
    assert diameter(corners) == pytest.approx(0.14**0.5)
