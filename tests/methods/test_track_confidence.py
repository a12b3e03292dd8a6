from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate, Stage
from asdfviz.errors import MethodError
from asdfviz.methods.track_confidence import TrackConfidenceConfig, as_probabilities

CONFIG = TrackConfidenceConfig(bias=1.0, weight=2.0, held_bias=3.0, held_weight=0.5)


def told(score: float, stage: Stage = "tracked", config: TrackConfidenceConfig = CONFIG) -> float:
    pose = PoseEstimate("pin", np.eye(4), score, stage)
    return as_probabilities({"pin": pose}, config=config)["pin"].score


def odds(p: float) -> float:
    return float(np.log(p / (1 - p)))


def test_a_loose_part_is_as_sure_as_it_fits_and_a_held_one_surer() -> None:
    assert odds(told(0.5)) == pytest.approx(1.0)
    assert odds(told(0.8)) == pytest.approx(1.0 + 2.0 * odds(0.8))
    assert odds(told(0.5, "group")) == pytest.approx(3.0)
    assert odds(told(0.2, "group")) == pytest.approx(3.0 + 0.5 * odds(0.2))


def test_it_stays_a_probability_at_both_ends_and_keeps_the_order() -> None:
    for stage in ("tracked", "group"):
        scores = [told(s, stage) for s in (0.0, 0.1, 0.6, 1.0)]
        assert scores == sorted(scores)
        assert 0 < scores[0] < scores[-1] < 1


def test_switched_off_scores_stay_and_a_falling_weight_is_refused() -> None:
    assert told(0.3, config=TrackConfidenceConfig(enabled=False)) == 0.3
    with pytest.raises(MethodError, match="held_weight"):
        TrackConfidenceConfig(held_weight=-1.0)
    for name in ("bias", "weight", "held_bias", "held_weight"):
        with pytest.raises(MethodError, match=name):
            replace(CONFIG, **{name: float("nan")})
