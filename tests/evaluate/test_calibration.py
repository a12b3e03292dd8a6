"""Calibration and ranking against plain loops over their definitions."""

from __future__ import annotations

import random

import pytest

from asdfviz.evaluate.calibration import calibration_error, ranking_area, reliability


@pytest.mark.parametrize("seed", range(5))
def test_random_judgements(seed: int) -> None:
    rng = random.Random(seed)
    judged = [(round(rng.random(), 2), rng.random() < 0.6) for _ in range(80)]
    error = 0.0
    for m in range(15):
        inside = [(c, r) for c, r in judged if m / 15 < c <= (m + 1) / 15 or (m == c == 0)]
        if inside:
            confidence = sum(c for c, _ in inside) / len(inside)
            accuracy = sum(r for _, r in inside) / len(inside)
            error += len(inside) / 80 * abs(accuracy - confidence)
    assert calibration_error(judged) == pytest.approx(100 * error, abs=1e-9)
    good, bad = ([c for c, r in judged if r is right] for right in (True, False))
    wins = sum(1.0 if g > b else 0.5 if g == b else 0.0 for g in good for b in bad)
    assert ranking_area(judged) == pytest.approx(100 * wins / (len(good) * len(bad)), abs=1e-9)


def test_edges() -> None:
    assert calibration_error([]) is ranking_area([]) is None
    assert ranking_area([(0.4, True), (0.9, True)]) is None
    assert calibration_error([(1.0, True), (0.0, False)]) == 0
    assert calibration_error([(1.0, False)]) == 100
    assert [b.count for b in reliability([(1.0, True), (0.99, False), (0.0, False)])] == [1, 2]
