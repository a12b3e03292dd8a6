"""Small systems are solved, and those that have no solution are told."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.cholesky import factorise, solve, substitute


@pytest.mark.parametrize("unknowns", [1, 4, 6, 11])
def test_a_system_has_numpys_solution(unknowns: int) -> None:
    rng = np.random.default_rng(unknowns)
    J, b = rng.normal(size=(3 * unknowns, unknowns)), rng.normal(size=unknowns)
    A, x = J.T @ J, np.zeros(unknowns)
    L = A.copy()
    assert factorise(L)
    assert substitute(L, b, x)
    assert x == pytest.approx(np.linalg.solve(A, b), rel=1e-9)
    again = np.zeros(unknowns)
    assert solve(A.copy(), b, again)
    assert np.array_equal(again, x)


@pytest.mark.parametrize("A", [[[1.0, 2.0], [2.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]]])
def test_a_matrix_that_is_not_positive_definite_is_told(A: list[list[float]]) -> None:
    assert not factorise(np.array(A))
    assert not solve(np.array(A), np.ones(2), np.zeros(2))


def test_what_is_no_number_is_told() -> None:
    L, x = np.eye(2), np.zeros(2)
    assert factorise(L)
    assert not substitute(L, np.array([np.nan, 1.0]), x)
