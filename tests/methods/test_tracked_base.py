"""The tracked base near where the votes have it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.track_memory import Track
from asdfviz.methods.tracked_base import TrackedBase


def at(x: float) -> Transform:
    return transform_from(np.eye(3), np.array([x, 0.0, 0.6]))


class Votes(BaseVotes):
    """For a place, or none; near is within 3 cm."""

    def __init__(self, place: Transform | None) -> None:
        self._place = place
        self.kept: list[PoseEstimate | None] = []

    @property
    def place(self) -> Transform | None:
        return self._place

    @property
    def may_be(self) -> Callable[[Transform], bool] | None:
        place = self._place
        return None if place is None else lambda T: bool(np.abs(T - place).max() < 0.03)

    def keep(self, base: PoseEstimate | None) -> None:
        self.kept.append(base)


def tracked(place: Transform | None) -> TrackedBase:
    return TrackedBase("base", Votes(place))


@pytest.mark.parametrize("away", [0.0, 0.02, 0.05])
def test_a_base_that_strayed_goes_on_from_its_place(away: float) -> None:
    tracks = {"base": Track(at(0.01)), "block": Track(at(0.2))}
    sure = {"base": 0.9, "block": 0.8}
    poses = {"base": at(away), "block": at(0.4)}
    tracked(at(0.0)).call_back(tracks, poses, sure)
    strayed = away > 0.03
    assert sure == {"base": 0.0 if strayed else 0.9, "block": 0.8}
    np.testing.assert_array_equal(tracks["base"].T_now, at(0.0 if strayed else 0.01))
    np.testing.assert_array_equal(tracks["block"].T_now, at(0.2))


@pytest.mark.parametrize("base", [TrackedBase("base", None), tracked(None)])
def test_without_votes_it_may_be_anywhere(base: TrackedBase) -> None:
    tracks, sure = {"base": Track(at(0.0))}, {"base": 0.9}
    base.call_back(tracks, {"base": at(5.0)}, sure)
    assert base.may_be("base", at(5.0))
    assert sure == {"base": 0.9}
    assert not base.place


def test_only_the_base_is_kept_near_its_place() -> None:
    base = tracked(at(0.0))
    assert base.may_be("base", at(0.02))
    assert not base.may_be("base", at(0.05))
    assert base.may_be("block", at(0.05))
    np.testing.assert_array_equal(base.place["base"], at(0.0))


def test_two_held_parts_make_it_sure_and_one_does_not() -> None:
    base = tracked(at(0.0))
    alone = {"base": 0.1, "block": 0.8, "pin": 0.6}
    base.as_held(alone, {"block"})
    assert alone["base"] == 0.1
    both = dict(alone)
    base.as_held(both, {"block", "pin"})
    assert both["base"] == pytest.approx(0.7)
    surer = {**alone, "base": 0.9}
    base.as_held(surer, {"block", "pin"})
    assert surer["base"] == 0.9


def test_the_votes_are_told_where_it_is() -> None:
    votes = Votes(at(0.0))
    found = PoseEstimate("base", at(0.01), 0.9, "tracked")
    TrackedBase("base", votes).keep(found)
    assert votes.kept == [found]
