"""Errors of single poses against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.evaluate.pose_errors import (
    add,
    add_s,
    add_s_at_least,
    adi,
    box_overlap,
    e_r,
    e_t,
    error_model,
    pose_error,
)
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from, turn_about

Z = np.array([0.0, 0, 1])


def turned(degrees: float, axis: np.ndarray = Z, t: tuple[float, ...] = (0, 0, 0.5)) -> np.ndarray:
    return transform_from(rotation_about(axis, np.deg2rad(degrees)), np.array(t, float))


def test_equal_poses_have_no_error(assembly: Assembly) -> None:
    for part in assembly.parts.values():
        error = pose_error(turned(30), turned(30), error_model(part))
        assert (error.add_s, error.e_t) == pytest.approx((0, 0), abs=1e-12)
        assert (error.e_r, error.e_r_sym) == pytest.approx((0, 0), abs=1e-7)


def test_add_of_a_shift_is_its_length() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    T_camera_estimate, T_camera_truth = turned(0, t=(0.003, 0.004, 0.5)), turned(0)
    assert add(T_camera_estimate, T_camera_truth, points) == pytest.approx(0.005)
    assert e_t(T_camera_estimate, T_camera_truth) == pytest.approx(0.005)


def test_add_of_a_half_turn_is_twice_the_distance_from_the_axis() -> None:
    points = np.array([[0.01, 0, 0], [0, 0.03, 0.2], [0, 0, 0.7]])
    assert add(turned(180), turned(0), points) == pytest.approx((0.02 + 0.06 + 0) / 3)


def test_adi_asks_the_estimate_for_the_truths_points() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0]])
    # Truth at 0 and 1, estimate at 0.9 and 1.9: nearest are 0.9 away (from 0) and 0.1 (from 1).
    assert adi(turned(0, t=(0.9, 0, 0)), turned(0, t=(0, 0, 0)), points) == pytest.approx(0.5)


def test_adi_equals_a_search_over_all_pairs() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(40, 3)) * 0.03
    T_camera_estimate = turned(37, axis=rng.normal(size=3), t=(0.01, 0.0, 0.51))
    T_camera_truth = turned(-20, axis=rng.normal(size=3))
    estimate = points @ T_camera_estimate[:3, :3].T + T_camera_estimate[:3, 3]
    truth = points @ T_camera_truth[:3, :3].T + T_camera_truth[:3, 3]
    gaps = np.linalg.norm(truth[:, None] - estimate[None], axis=2)
    found = adi(T_camera_estimate, T_camera_truth, points)
    assert found == pytest.approx(gaps.min(axis=1).mean(), rel=1e-9)
    assert found != pytest.approx(gaps.min(axis=0).mean(), rel=1e-3)  # the other way round


def random_pose(rng: np.random.Generator) -> np.ndarray:
    """A rotation from a random matrix, by QR, before the camera."""
    R, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    R = R * np.sign(np.diag(upper))
    return transform_from(R * np.linalg.det(R), rng.uniform([-0.2, -0.2, 0.4], [0.2, 0.2, 1.2]))


@pytest.mark.parametrize("seed", range(8))
def test_errors_of_random_poses_are_those_of_the_formulas(seed: int) -> None:
    """As Hinterstoisser et al. 2012 and Hodan et al. 2016 write them, point by point."""
    rng = np.random.default_rng(seed)
    T, P, points = random_pose(rng), random_pose(rng), rng.normal(0, 0.05, size=(40, 3))
    at = [[M[:3, :3] @ x + M[:3, 3] for x in points] for M in (P, T)]
    distances = [math.dist(a, b) for a, b in zip(*at, strict=True)]
    assert add(P, T, points) == pytest.approx(sum(distances) / 40, abs=1e-6)
    nearest = [min(math.dist(a, b) for a in at[0]) for b in at[1]]
    assert adi(P, T, points) == pytest.approx(sum(nearest) / 40, abs=1e-6)
    assert e_t(P, T) == pytest.approx(math.dist(P[:3, 3], T[:3, 3]), abs=1e-6)
    # The angle of a rotation by its eigenvalues exp(+-i angle), not by its trace.
    turns = np.angle(np.linalg.eigvals(P[:3, :3] @ np.linalg.inv(T[:3, :3])))
    assert e_r(P, T) == pytest.approx(float(np.abs(turns).max()), abs=1e-6)


@pytest.mark.parametrize("degrees", [0.001, 1.0, 90.0, 179.0, 180.0])
def test_rotation_error_is_the_angle(degrees: float) -> None:
    axis = np.array([1.0, 2, -1])
    assert np.rad2deg(e_r(turned(degrees, axis), turned(0))) == pytest.approx(degrees, abs=1e-6)


def test_a_turn_about_a_free_axis_is_no_error(assembly: Assembly) -> None:
    error = pose_error(turned(123.4), turned(0), error_model(assembly.parts["rod"]))
    assert np.rad2deg(error.e_r) == pytest.approx(123.4)
    assert np.rad2deg(error.e_r_sym) == pytest.approx(0, abs=1e-5)
    # The sampled surface is not turned with it: what stays is the spacing of the samples.
    assert error.add_s < 0.0007


def test_a_tilt_of_a_free_axis_stays_an_error(assembly: Assembly) -> None:
    T_camera_estimate = turned(10, np.array([1.0, 0, 0])) @ turned(77, t=(0, 0, 0))
    error = pose_error(T_camera_estimate, turned(0), error_model(assembly.parts["rod"]))
    assert np.rad2deg(error.e_r_sym) == pytest.approx(10, abs=1e-6)


@pytest.mark.parametrize(("degrees", "shift"), [(180.0, 0.0), (70.0, 0.003)])
def test_a_turn_about_an_axis_beside_the_origin_is_no_shift(
    assembly: Assembly, degrees: float, shift: float
) -> None:
    beside = np.array([0.04, 0, 0])
    rod = assembly.parts["rod"]
    mesh = replace(rod.mesh, vertices=rod.mesh.vertices + beside)
    symmetries = Symmetries(continuous=(Axis(Z, beside),))
    model = error_model(replace(rod, mesh=mesh, symmetries=symmetries))
    T_camera_truth = turned(25, np.array([1.0, 2, -1]))
    T_camera_estimate = T_camera_truth @ turn_about(Z, beside, np.deg2rad(degrees))
    T_camera_estimate[0, 3] += shift
    error = pose_error(T_camera_estimate, T_camera_truth, model)
    assert error.e_t_sym == pytest.approx(shift, abs=1e-9)
    assert error.e_r_sym == pytest.approx(0, abs=1e-7)
    if shift == 0:
        assert error.e_t == pytest.approx(0.08)  # across the axis: twice 40 mm


@pytest.mark.parametrize(("degrees", "expected"), [(180, 0), (170, 10), (90, 90), (20, 20)])
def test_a_half_turn_symmetry(assembly: Assembly, degrees: float, expected: float) -> None:
    error = pose_error(turned(degrees), turned(0), error_model(assembly.parts["block"]))
    assert np.rad2deg(error.e_r_sym) == pytest.approx(expected, abs=1e-5)


def test_an_unsymmetric_part_is_measured_by_add(assembly: Assembly) -> None:
    model = error_model(assembly.parts["plate"])
    error = pose_error(turned(180), turned(0), model)
    assert error.add_s == pytest.approx(add(turned(180), turned(0), model.points))
    assert error.add_s > 0.03


def test_the_sample_is_always_the_same(assembly: Assembly) -> None:
    part = assembly.parts["block"]
    np.testing.assert_array_equal(error_model(part).points, error_model(part).points)


def test_boxes_overlap_as_the_picture_shows_them() -> None:
    square = np.array([[-0.02, -0.02, 0], [0.02, -0.02, 0], [0.02, 0.02, 0], [-0.02, 0.02, 0]])
    here = turned(0)
    assert box_overlap(here, here, square) == pytest.approx(1)
    assert box_overlap(turned(90), here, square) == pytest.approx(1)
    aside = turned(0, t=(0.02, 0, 0.5))
    assert box_overlap(aside, here, square) == pytest.approx(1 / 3)
    assert box_overlap(turned(0, t=(0, 0, 1.0)), here, square) == pytest.approx(1 / 4)
    assert box_overlap(turned(0, t=(0.1, 0, 0.5)), here, square) == 0
    assert box_overlap(turned(0, t=(0, 0, -0.5)), here, square) == 0


@pytest.mark.parametrize("kind", ["plate", "rod"])
def test_the_quick_bound_is_never_above_the_error(assembly: Assembly, kind: str) -> None:
    model = error_model(assembly.parts[kind], count=300)
    rng = np.random.default_rng(4)
    bounds: list[float] = []
    for _ in range(60):
        T_camera_a, T_camera_b = (
            transform_from(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), shift)
            for shift in (np.zeros(3), rng.uniform(0, 0.3) * rng.normal(size=3))
        )
        bounds.append(add_s_at_least(T_camera_a, T_camera_b, model))
        assert bounds[-1] <= add_s(T_camera_a, T_camera_b, model) + 1e-12
    assert max(bounds) > 0.1
