from __future__ import annotations

import math

import pytest

from asdfviz.geometry.odds import log_odds, probability


@pytest.mark.parametrize("p", [0.02, 0.3, 0.5, 0.9])
def test_log_odds_and_probabilities_are_inverse(p: float) -> None:
    assert log_odds(p, least=0.01) == pytest.approx(math.log(p / (1 - p)))
    assert probability(log_odds(p, least=0.01)) == pytest.approx(p)


def test_what_is_nearly_sure_is_cut_at_both_ends() -> None:
    least = probability(-6.0)
    assert log_odds(0.0, least=least) == pytest.approx(-6.0)
    assert log_odds(1.0, least=least) == pytest.approx(6.0)
