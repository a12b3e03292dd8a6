"""Parts that were seen on their way, turned one way or another, before their place hid them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Joint, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.state.last_turns import LastTurns, LastTurnsConfig

Place = Callable[[Mapping[str, Transform]], dict[str, PoseEstimate]]
K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
HALF = rotation_about(np.array([0.0, 0.0, 1.0]), np.pi)


def at(x: float, *, turned: bool = False) -> Transform:
    return transform_from(HALF if turned else np.eye(3), np.array([x, 0.0, 0.0]))


@pytest.fixture
def slider(assembly: Assembly) -> Assembly:
    """The error 4 has the block in its place turned by half, which no joint allows."""
    poses = {"base": np.eye(4), "block": at(0.1, turned=True)}
    states = (*assembly.states[:4], replace(assembly.states[4], T_base_part=poses, joints={}))
    return replace(assembly, states=states)


def follow(
    turns: LastTurns, place: Place, *shown: Transform | None, score: float = 0.9, px: float = 0.0
) -> Scores | None:
    """Show the block at these places, one in a frame, None: not at all; what the last one says."""

    def nominal(name: str, state: State) -> Transform:
        return state.T_base_part[name]

    said = None
    for T in shown:
        poses = place({"base": np.eye(4)} if T is None else {"base": np.eye(4), "block": T})
        poses = {name: replace(pose, score=score) for name, pose in poses.items()}
        said = turns.step(poses["base"], poses, K=K, place=nominal, shown_px=lambda _, __: px)
    return said


def test_as_it_came_so_it_is_in_its_place(slider: Assembly, place: Place) -> None:
    for turned, right, wrong in ((False, 1, 4), (True, 4, 1)):
        turns = LastTurns(slider, config=LastTurnsConfig())
        said = follow(turns, place, at(0.2, turned=turned), at(0.15, turned=turned), None)
        assert said is not None
        assert said.sum() == pytest.approx(1.0)
        assert said[right] > 20 * said[wrong]
        assert said[0] == pytest.approx(said[right])  # whether it is in at all does not show


@pytest.mark.parametrize(
    ("shown", "options", "told"),
    [
        ((0.15, 0.15, 0.15), {}, {}),  # it is seen: others say where it is
        ((0.15, None), {}, {}),  # one frame may be wrong
        ((0.15, 0.15, 0.5, None), {}, {}),  # it was taken away
        ((0.3, 0.3, None), {}, {}),  # it has a long way before it
        ((0.15, 0.15, None), {"enabled": False}, {}),
        ((0.15, 0.15, None), {}, {"score": 0.3}),
        ((0.15, 0.15, None), {}, {"px": 400.0}),  # its place shows it
    ],
)
def test_else_it_says_nothing(
    slider: Assembly,
    place: Place,
    shown: tuple[float | None, ...],
    options: dict[str, Any],
    told: dict[str, float],
) -> None:
    turns = LastTurns(slider, config=LastTurnsConfig(**options))
    assert follow(turns, place, *(x if x is None else at(x) for x in shown), **told) is None


def test_what_turns_about_a_ball_is_turned_against_what_it_hangs_on(
    slider: Assembly, place: Place
) -> None:
    ball = Joint("ball", np.array([1.0, 0.0, 0.0]), np.zeros(3), turn=(-np.pi, np.pi))
    states = tuple(replace(s, joints={"block": ball} if s.index else {}) for s in slider.states)
    turns = LastTurns(replace(slider, states=states), config=LastTurnsConfig())
    said = follow(turns, place, at(0.15, turned=True), at(0.12, turned=True), None)
    assert said is not None
    assert said[4] > 20 * said[1]


def test_a_part_that_is_never_turned_otherwise_is_left_alone(
    assembly: Assembly, place: Place
) -> None:
    turns = LastTurns(assembly, config=LastTurnsConfig())
    assert follow(turns, place, at(0.15), at(0.15), None) is None


@pytest.mark.parametrize(
    "wrong", [{"sure": 2.0}, {"frames": 1}, {"near": 0.0}, {"sigma": np.nan}, {"most": -1.0}]
)
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=next(iter(wrong))):
        LastTurnsConfig(**wrong)
