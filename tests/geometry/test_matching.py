from __future__ import annotations

import numpy as np

from asdfviz.geometry.matching import cheapest_pairs


def test_the_total_counts_and_not_the_best_pair() -> None:
    assert cheapest_pairs(np.array([[0.0, 1.0], [1.0, 5.0]])) == [(0, 1), (1, 0)]


def test_of_the_larger_set_some_stay_alone() -> None:
    assert cheapest_pairs(np.array([[3.0], [1.0], [2.0]])) == [(1, 0)]
    assert cheapest_pairs(np.zeros((0, 3))) == []
