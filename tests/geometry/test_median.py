"""The median of a few numbers."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.median import median


@pytest.mark.parametrize("count", [1, 2, 3, 40, 41])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_it_is_numpy_s_to_the_last_digit(count: int, kind: type) -> None:
    values = np.random.default_rng(count).normal(size=count).astype(kind)
    before = values.copy()
    assert median(values) == float(np.median(values))
    assert (values == before).all()
