"""How sure a decided pose is."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.methods.kept_poses import Decision, Hypothesis, pose_confidence
from asdfviz.methods.registration import Evidence
from asdfviz.pose.confidence import ConfidenceConfig

CONFIG = ConfidenceConfig(missed=3.0, plain=0.5)


def sure(*, visible: float, score: float | None, loose: bool) -> float:
    """Of a pose that agrees with depth."""
    seen = Evidence(depth=1.0, visible=visible, agreeing=1.0, outline=0.0)
    best = Hypothesis(np.eye(4), trust=0.9, liked=0.7, evidence=seen, frames=20)
    return pose_confidence(Decision(best, 0.9), score, 0.9, loose=loose, config=CONFIG)


def test_a_loose_part_that_is_plainly_seen_and_not_detected_is_doubted() -> None:
    believed = sure(visible=0.4, score=None, loose=True)
    doubted = sure(visible=0.6, score=None, loose=True)
    odds = [p / (1 - p) for p in (believed, doubted)]
    assert np.log(odds[0] / odds[1]) == pytest.approx(3.0)
    assert doubted < 0.2 < 0.6 < believed


def test_what_is_held_or_detected_is_not() -> None:
    for score, loose in ((None, False), (0.3, True)):
        hidden, seen = (sure(visible=v, score=score, loose=loose) for v in (0.4, 0.6))
        assert seen == hidden
