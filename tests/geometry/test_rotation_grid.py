from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.rotation_grid import (
    Equivalents,
    angles_of,
    even_rotations,
    highest_mode,
    multiplied,
    quaternion_of,
    rotation_of,
    rotation_to_ray,
)
from asdfviz.geometry.rotation_modes import modes
from asdfviz.geometry.symmetry import Axis, Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from

Z = np.array([0.0, 0.0, 1.0])


def random_quaternions(count: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


@pytest.mark.parametrize(("count", "largest_deg"), [(300, 42), (1200, 27), (2304, 21)])
def test_every_rotation_has_a_near_one_in_the_grid(count: int, largest_deg: float) -> None:
    grid = even_rotations(count)
    assert np.allclose(np.linalg.norm(grid, axis=1), 1)
    nearest = angles_of(np.abs(random_quaternions(2000) @ grid.T).max(axis=1))
    assert np.degrees(nearest.max()) < largest_deg
    between = np.abs(grid @ grid.T)
    np.fill_diagonal(between, 0)
    gaps = np.degrees(angles_of(between.max(axis=1)))
    assert gaps.min() > 0.5 * np.median(gaps)


def test_products_are_those_of_matrices() -> None:
    a, b = random_quaternions(5, 1), random_quaternions(5, 2)
    for left, right, both in zip(a, b, multiplied(a, b), strict=True):
        assert np.allclose(rotation_of(left) @ rotation_of(right), rotation_of(both))
        assert np.abs(quaternion_of(rotation_of(both)) @ both) == pytest.approx(1)


def half_turn_about_x() -> np.ndarray:
    return transform_from(rotation_about(np.array([1.0, 0, 0]), np.pi), np.zeros(3))


@pytest.mark.parametrize(
    "symmetries",
    [
        Symmetries(),
        Symmetries(discrete=(half_turn_about_x(),)),
        Symmetries(continuous=(Axis(Z, np.zeros(3)),)),
        Symmetries(discrete=(half_turn_about_x(),), continuous=(Axis(Z, np.zeros(3)),)),
    ],
    ids=["none", "discrete", "continuous", "both"],
)
def test_closeness_agrees_with_the_nearest_symmetric_pose(symmetries: Symmetries) -> None:
    equivalents = Equivalents.of(symmetries)
    true, others = random_quaternions(1, 3)[0], random_quaternions(20, 4)
    angles = angles_of(equivalents.closeness(true, others))
    T_true = transform_from(rotation_of(true), np.zeros(3))
    for other, angle in zip(others, angles, strict=True):
        T_other = transform_from(rotation_of(other), np.zeros(3))
        nearest = nearest_symmetric(T_true, T_other, symmetries)
        assert angle == pytest.approx(rotation_angle(nearest[:3, :3].T @ T_other[:3, :3]), abs=1e-6)


def test_two_free_axes_leave_hardly_any_difference() -> None:
    ball = Symmetries(continuous=(Axis(Z, np.zeros(3)), Axis(np.array([1.0, 0, 0]), np.zeros(3))))
    angles = angles_of(
        Equivalents.of(ball).closeness(np.array([0.0, 0, 0, 1]), random_quaternions(50))
    )
    assert np.degrees(angles.max()) < 12


def test_the_turn_to_a_ray_is_the_smallest_one() -> None:
    ray = np.array([0.3, -0.2, 1.0])
    R = rotation_to_ray(ray)
    assert np.allclose(R @ Z, ray / np.linalg.norm(ray))
    assert rotation_angle(R) == pytest.approx(np.arccos(1 / np.linalg.norm(ray)))
    assert np.allclose(rotation_to_ray(Z), np.eye(3))


def test_peaks_are_apart_and_finer_than_the_grid() -> None:
    grid = even_rotations(2304)
    first, second = random_quaternions(2, 11)
    angle = [2 * np.arccos(np.clip(np.abs(grid @ q), 0, 1)) for q in (first, second)]
    density = 0.7 * np.exp(-((angle[0] / 0.22) ** 2)) + 0.3 * np.exp(-((angle[1] / 0.22) ** 2))
    peaks, weights = modes(density / density.sum(), grid, count=2, reach=0.5)
    for peak, true in zip(peaks, (first, second), strict=True):
        assert np.degrees(2 * np.arccos(min(1.0, abs(peak @ true)))) < 4
    assert weights[0] > 1.5 * weights[1]
    assert weights.sum() == pytest.approx(1, abs=0.15)
    alone = highest_mode(density / density.sum(), grid, reach=0.5)
    assert alone == pytest.approx(peaks[:1], abs=1e-9)


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 40.0, 120.0, 179.9999, 180.0])
def test_matrices_and_quaternions_are_the_same_rotations(degrees: float) -> None:
    axis = np.array([0.48, -0.6, 0.64])
    half = np.deg2rad(degrees) / 2
    expected = np.append(axis * np.sin(half), np.cos(half))
    R = rotation_about(axis, np.deg2rad(degrees))
    found = quaternion_of(R)
    assert abs(found @ expected) == pytest.approx(1.0, abs=1e-12)
    assert rotation_of(3.0 * found) == pytest.approx(R, abs=1e-12)
