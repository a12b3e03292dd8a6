"""Two sets matched one to one."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from jaxtyping import Float64
from scipy import optimize  # pyright: ignore[reportMissingTypeStubs]  scipy has none


def cheapest_pairs(cost: Float64[np.ndarray, "rows columns"]) -> list[tuple[int, int]]:
    """The pairs (row, column), each at most once and as many as there can be, of the least total cost."""
    rows, columns = cast(Any, optimize).linear_sum_assignment(cost)
    return [(int(row), int(column)) for row, column in zip(rows, columns, strict=True)]
