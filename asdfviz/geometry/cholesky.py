"""Compiled loops that solve small systems whose matrix is symmetric and positive definite.

LAPACK's solver, which numba would call, takes far longer to compile, and to call for six unknowns.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel


@kernel
@no_type_check
def factorise(A):
    """Overwrite A's lower half with its Cholesky factor; False where A is not positive definite."""
    for j in range(len(A)):
        for i in range(j, len(A)):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            if i == j and not total > 0.0:
                return False
            A[i, j] = np.sqrt(total) if i == j else total / A[j, j]
    return True


@kernel
@no_type_check
def substitute(L, b, x):
    """Fill x from L L^T x = b; False where it is no number."""
    n = len(b)
    for i in range(n):
        x[i] = b[i]
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    total = 0.0
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
        total += x[i]
    return np.isfinite(total)


@kernel
@no_type_check
def solve(A, b, x):
    """Fill x from A x = b, and A's lower half with its factor; False where there is no such x."""
    return factorise(A) and substitute(A, b, x)
