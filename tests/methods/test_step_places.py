"""GBOT seeks parts that it lost where the assembly's next steps have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.gbot import GbotConfig
from asdfviz.methods.step_places import StepPlaces, StepPlacesConfig
from asdfviz.track.confidence import Evidence
from asdfviz.track.presets import FINE
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

WITHIN = (0.03, 45.0)
LOST = frozenset({"block"})


class FakeTracker(Tracker):
    """Parts lie where they were `left`; what is tried fits within 5 mm of where it `really` is."""

    def __init__(self, left: dict[str, Transform], really: dict[str, Transform]) -> None:
        self.left, self.really = left, really
        self.names, self.config = tuple(left), FINE

    @property
    def poses(self) -> dict[str, Transform]:
        return self.left

    def trials(
        self, frame: Frame, name: str, starts: Sequence[Transform], *, rounds: int | None = None
    ) -> list[Trial]:
        return [self._trial(name, T) for T in starts]

    def _trial(self, name: str, T: Transform) -> Trial:
        there = name in self.really and np.linalg.norm((T - self.really[name])[:3, 3]) < 0.005
        fit = 1.0 if there else 0.1
        return Trial(T, Evidence(contrast=fit, fit=fit, visible=1.0), 0.9 * fit)


@pytest.fixture
def away(toy) -> FakeTracker:
    """The block is joined, and was left where it lay."""
    left, joined = toy.poses(joined=False), toy.poses(joined=True)
    return FakeTracker({**left, "pin": left["block"]}, {"block": joined["block"]})


def estimates(poses: dict[str, Transform], *names: str) -> dict[str, PoseEstimate]:
    return {n: PoseEstimate(n, poses[n], 1.0, "tracked") for n in names}


def test_a_lost_part_is_put_where_it_is_seen_joined_for_long_enough(
    assembly: Assembly, toy, away: FakeTracker
) -> None:
    places = StepPlaces(assembly, WITHIN, config=StepPlacesConfig(frames=3))
    poses = estimates(away.poses, "base")
    found = [places.step(toy.frame(0), away, poses, LOST, 0) for _ in range(3)]
    assert found[:2] == [{}, {}]
    T = found[2]["block"].T_camera_part
    np.testing.assert_allclose(T, toy.poses(joined=True)["block"], atol=1e-9)
    # A frame in which it is not seen there begins the count anew.
    really, away.really = away.really, {}
    assert places.step(toy.frame(0), away, poses, LOST, 0) == {}
    away.really = really
    for _ in range(2):
        assert places.step(toy.frame(0), away, poses, LOST, 0) == {}
    # So does one for which it is not lost, or the base is.
    for lost, given in ((frozenset(), poses), (LOST, {})):
        places.step(toy.frame(0), away, given, lost, 0)
        for _ in range(2):
            assert places.step(toy.frame(0), away, poses, LOST, 0) == {}


def test_parts_are_sought_in_the_order_of_the_assembly(assembly: Assembly, toy) -> None:
    left: dict[str, Transform] = toy.poses(joined=False)
    joined: Transform = toy.poses(joined=True)["block"]
    names = [name for name in assembly.parts if name != "base"]
    joined_at = assembly.states[1].T_base_part["block"]
    last = State(1, "all", {"base": np.eye(4), **dict.fromkeys(names, joined_at)})
    assembly = replace(assembly, states=(assembly.states[0], last))
    left = {n: left.get(n, left["block"]) for n in assembly.parts}
    away = FakeTracker(left, dict.fromkeys(names, joined))
    places = StepPlaces(assembly, WITHIN, config=StepPlacesConfig(frames=1))
    for lost in (names, names[::-1]):
        found = places.step(toy.frame(0), away, estimates(away.poses, "base"), lost, 0)
        assert list(found) == names


@pytest.mark.parametrize(
    ("base", "lost", "done", "enabled"),
    [
        (True, LOST, 0, False),
        (False, LOST, 0, True),
        (True, LOST | {"base"}, 0, True),
        (True, frozenset({"pin"}), 0, True),  # no step joins it
        (True, LOST, 1, True),  # it is joined already
    ],
)
def test_nothing_is_sought(
    *,
    base: bool,
    lost: frozenset[str],
    done: int,
    enabled: bool,
    assembly: Assembly,
    toy,
    away: FakeTracker,
) -> None:
    places = StepPlaces(assembly, WITHIN, config=StepPlacesConfig(enabled=enabled, frames=1))
    poses = estimates(away.poses, "base") if base else {}
    assert places.step(toy.frame(0), away, poses, lost, done) == {}


def test_a_part_stays_that_fits_as_well_where_it_was_left(
    assembly: Assembly, toy, away: FakeTracker
) -> None:
    poses = estimates(away.poses, "base")
    config = StepPlacesConfig(frames=1, margin=3.0)  # no score is that much higher
    places = StepPlaces(assembly, WITHIN, config=config)
    assert places.step(toy.frame(0), away, poses, LOST, 0) == {}


def test_frames_below_one_are_refused() -> None:
    with pytest.raises(MethodError, match="passed_over is 0"):
        GbotConfig(passed_over=0)
    with pytest.raises(MethodError, match=r"places\.frames is 0"):
        StepPlacesConfig(frames=0)
