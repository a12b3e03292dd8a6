"""The toy's block in a hand, and something like it elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Part, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.leaps import Leaps, LeapsConfig


def at(x: float) -> Transform:
    return transform_from(np.eye(3), np.array([x, 0.0, 0.6]))


def block(x: float, score: float, name: str = "block") -> dict[str, PoseEstimate]:
    return {name: PoseEstimate(name, at(x), score, "refined")}


@pytest.fixture
def leaps(toy) -> Leaps:
    """It saw the block at 0, surely, at 1 s."""
    made = Leaps(toy.assembly, config=LeapsConfig())
    made.step(block(0.0, 0.95), 1.0)
    return made


def score(leaps: Leaps, x: float, found: float, time: float, name: str = "block") -> float:
    return leaps.step(block(x, found, name), time)[name].score


def test_a_leap_has_to_be_surer_than_what_was_seen(leaps: Leaps) -> None:
    # Odds of 0.7 to 0.3, a fifth of them.
    assert score(leaps, 0.3, 0.7, 1.1) == pytest.approx(0.2 * 0.7 / (0.2 * 0.7 + 0.3))
    assert score(leaps, 0.3, 0.96, 1.2) == 0.96
    # It is there now, so it is the way back that is a leap.
    assert score(leaps, 0.0, 0.9, 1.3) < 0.9


def test_what_a_hand_carried_meanwhile_is_no_leap(leaps: Leaps) -> None:
    assert score(leaps, 0.09, 0.6, 1.1) == 0.6
    # What counts is how sure it was at best since it came there.
    assert score(leaps, 0.4, 0.9, 1.2) < 0.9
    assert score(leaps, 0.6, 0.7, 2.2) == 0.7


def test_what_is_doubted_is_not_remembered(leaps: Leaps) -> None:
    assert score(leaps, 0.3, 0.7, 1.1) < 0.5
    assert score(leaps, 0.3, 0.7, 1.2) < 0.5
    assert score(leaps, 0.0, 0.7, 1.3) == 0.7


def test_a_twin_may_be_where_the_other_one_was(toy) -> None:
    assembly = with_twin(toy.assembly)
    leaps = Leaps(assembly, config=LeapsConfig())
    leaps.step({**block(0.0, 0.95), **block(0.4, 0.95, "twin")}, 1.0)
    assert score(leaps, 0.4, 0.7, 1.1) == 0.7
    assert score(leaps, -0.4, 0.7, 1.1) < 0.5


def test_names_change_with_places(toy) -> None:
    leaps = Leaps(with_twin(toy.assembly), config=LeapsConfig())
    leaps.step(block(0.0, 0.95), 1.0)
    leaps.rename({"block": "twin", "twin": "block"})
    assert score(leaps, 0.4, 0.7, 1.1) == 0.7
    assert score(leaps, 0.8, 0.65, 1.1, "twin") < 0.5


def test_leaps_may_be_believed(toy) -> None:
    leaps = Leaps(toy.assembly, config=LeapsConfig(odds=1.0))
    leaps.step(block(0.0, 0.95), 1.0)
    assert score(leaps, 0.4, 0.7, 1.1) == 0.7


@pytest.mark.parametrize("wrong", [{"speed": -1.0}, {"slack": float("nan")}, {"odds": 1.5}])
def test_impossible_options_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match=next(iter(wrong))):
        LeapsConfig(**wrong)


def with_twin(assembly: Assembly) -> Assembly:
    block: Part = assembly.parts["block"]
    twin = replace(block, name="twin")
    return replace(assembly, parts={**assembly.parts, "twin": twin})
