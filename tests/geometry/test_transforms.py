from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.transforms import (
    apply,
    inverse,
    is_rigid,
    orthonormalized,
    rotation_about,
    rotation_angle,
    transform_from,
)


def random_transforms(count: int, seed: int = 0) -> list[np.ndarray]:
    """Identity, near-identity, half turns and generic ones."""
    rng = np.random.default_rng(seed)
    angles = [0.0, 1e-9, 1e-4, np.pi, np.pi - 1e-6, *rng.uniform(-np.pi, np.pi, count)]
    return [
        transform_from(rotation_about(rng.normal(size=3), float(a)), rng.normal(size=3))
        for a in angles
    ]


@pytest.mark.parametrize("T_a_b", random_transforms(8))
def test_laws(T_a_b: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    points_b, T_b_c = rng.normal(size=(5, 3)), random_transforms(1, seed=2)[-1]
    np.testing.assert_allclose(inverse(T_a_b) @ T_a_b, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(T_a_b @ inverse(T_a_b), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(inverse(T_a_b)), T_a_b, atol=1e-12)
    np.testing.assert_allclose(inverse(T_a_b @ T_b_c), inverse(T_b_c) @ inverse(T_a_b), atol=1e-12)
    np.testing.assert_allclose(apply(inverse(T_a_b), apply(T_a_b, points_b)), points_b, atol=1e-12)
    np.testing.assert_allclose(
        apply(T_a_b @ T_b_c, points_b), apply(T_a_b, apply(T_b_c, points_b)), atol=1e-12
    )
    assert is_rigid(T_a_b, tolerance=1e-9)


def test_no_points() -> None:
    assert apply(random_transforms(1)[-1], np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-5, 0.3, 2.0, np.pi - 1e-5, np.pi - 1e-8, np.pi])
def test_rotation_angle_is_exact_at_both_ends(angle: float) -> None:
    for axis in np.random.default_rng(3).normal(size=(5, 3)):
        assert rotation_angle(rotation_about(axis, angle)) == pytest.approx(angle, abs=2e-8)


def test_a_quarter_turn_follows_the_right_hand() -> None:
    R = rotation_about(np.array([0.0, 0.0, 5.0]), np.pi / 2)
    np.testing.assert_allclose(R @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    "broken",
    [
        pytest.param(np.diag([1.0, 1.0, -1.0, 1.0]), id="mirror"),
        pytest.param(np.diag([2.0, 1.0, 1.0, 1.0]), id="scaled"),
        pytest.param(np.full((4, 4), np.nan), id="NaN"),
        pytest.param(np.vstack([np.eye(4)[:3], [[0.1, 0, 0, 1]]]), id="last row"),
        pytest.param(np.zeros((4, 4)), id="zero"),
        pytest.param(np.eye(4) + 1e300 * np.eye(4, k=3), id="beyond all measure"),
    ],
)
def test_what_is_not_rigid(broken: np.ndarray) -> None:
    assert not is_rigid(broken)


def test_orthonormalized_undoes_the_rounding_of_text() -> None:
    for T in random_transforms(5):
        rounded = np.round(T, 3)
        fixed = orthonormalized(rounded)
        assert is_rigid(fixed, tolerance=1e-12)
        np.testing.assert_allclose(fixed, T, atol=2e-3)
        np.testing.assert_array_equal(fixed[:3, 3], rounded[:3, 3])


def test_inputs_are_not_changed() -> None:
    T = random_transforms(1)[-1]
    T.flags.writeable = False
    assert inverse(T) is not T
    assert orthonormalized(T) is not T
    assert apply(T, np.ones((2, 3))).shape == (2, 3)
