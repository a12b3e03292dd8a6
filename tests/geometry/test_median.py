"""The median and quantiles of a few numbers."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.median import median, nearest_quantile


@pytest.mark.parametrize("count", [1, 2, 3, 40, 41])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_it_is_numpy_s_to_the_last_digit(count: int, kind: type) -> None:
    values = np.random.default_rng(count).normal(size=count).astype(kind)
    before = values.copy()
    assert median(values) == float(np.median(values))
    assert (values == before).all()


@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 7, 40, 399])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_the_nearest_quantile_is_numpy_s(count: int, share: float) -> None:
    values = np.random.default_rng(count).normal(size=count).astype(np.float32)
    before = values.copy()
    expected = float(np.quantile(values, share, method="nearest"))
    assert nearest_quantile(values, share) == expected
    assert (values == before).all()
