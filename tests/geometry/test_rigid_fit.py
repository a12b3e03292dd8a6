"""Rigid transforms from points, some of which went elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.rigid_fit import agreement, rigid_fit, robust_fit
from asdfviz.geometry.transforms import apply, is_rigid, rotation_about, transform_from

RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-0.1, 0.1, (24, 3))
T_B_A = transform_from(rotation_about(np.array([1.0, 2, 3]), 0.4), np.array([0.02, -0.01, 0.03]))
ALIKE = np.ones(len(POINTS))


def test_points_that_moved_as_one_tell_how() -> None:
    assert rigid_fit(POINTS, apply(T_B_A, POINTS), ALIKE) == pytest.approx(T_B_A, abs=1e-12)


def test_the_fit_is_that_with_the_least_squares_left() -> None:
    there = apply(T_B_A, POINTS) + RNG.normal(0, 0.003, POINTS.shape)
    weights = RNG.uniform(0.2, 2.0, len(POINTS))

    def left(T: np.ndarray) -> float:
        return float(weights @ ((apply(T, POINTS) - there) ** 2).sum(axis=1))

    best = rigid_fit(POINTS, there, weights)
    assert is_rigid(best)
    for _ in range(50):
        R = rotation_about(RNG.normal(size=3), 0.01 * RNG.random())
        assert left(best) < left(transform_from(R, RNG.normal(0, 1e-3, 3)) @ best)


def test_points_in_a_plane_are_not_mirrored() -> None:
    flat = POINTS * [1, 1, 0]
    noisy = apply(T_B_A, flat) + RNG.normal(0, 0.002, flat.shape)
    assert is_rigid(rigid_fit(flat, noisy, ALIKE))


def test_points_that_went_elsewhere_do_not_count() -> None:
    there = apply(T_B_A, POINTS)
    there[:8] += [0.05, 0.0, 0.02]
    starts = np.stack([np.eye(4), rigid_fit(POINTS[8:16], there[8:16], ALIKE[:8])])
    T, share = robust_fit(POINTS, there, ALIKE, starts, scale=0.004)
    assert np.allclose(T, T_B_A, atol=1e-3)
    assert share == pytest.approx(16 / 24, abs=0.02)


def test_weights_decide_between_two_motions() -> None:
    there = apply(T_B_A, POINTS)
    there[:8] = POINTS[:8]
    starts = np.stack([np.eye(4), T_B_A])
    heavy = np.where(np.arange(24) < 8, 5.0, 1.0)
    assert robust_fit(POINTS, there, ALIKE, starts, scale=0.004)[0] == pytest.approx(
        T_B_A, abs=1e-3
    )
    stays, share = robust_fit(POINTS, there, heavy, starts, scale=0.004)
    assert stays == pytest.approx(np.eye(4), abs=1e-3)
    assert share == pytest.approx(40 / 56, abs=0.02)


def test_agreement_is_one_where_all_is_in_place_and_a_half_at_the_scale() -> None:
    off = transform_from(np.eye(3), np.array([0.004, 0.0, 0.0]))
    both = agreement(POINTS, POINTS, ALIKE, np.stack([np.eye(4), off]), scale=0.004)
    assert both == pytest.approx([1.0, 0.5])
