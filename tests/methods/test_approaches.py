"""What comes near to where the toy's two pins are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, State
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.approaches import Approaches, Place
from asdfviz.methods.loose_config import LooseConfig

BASE = transform_from(np.eye(3), np.array([0.0, 0.0, 0.55]))
HOLES = [transform_from(np.eye(3), np.array([x, 0.0, 0.03])) for x in (-0.07, 0.07)]
PINS = ("pin", "pin-copy")


def watching(assembly: Assembly, *, again: int = 1) -> Approaches:
    """States: no pin is in, one is, both are; nothing is known but that both were seen to lie."""
    joined = [dict(zip(PINS[:k], HOLES, strict=False)) for k in range(3)]
    states = tuple(State(k, f"s{k}", {"base": np.eye(4), **pins}) for k, pins in enumerate(joined))
    return Approaches(
        replace(assembly, states=states), PINS, config=LooseConfig(steady=3, again=again)
    )


@pytest.fixture
def approaches(assembly: Assembly) -> Approaches:
    """One frame with something there is enough."""
    return watching(assembly)


def over(frame: Frame, hole: int, depth: float, *, half: float = 0.05) -> Frame:
    """With something of that depth over a hole."""
    assert frame.depth is not None
    place = (BASE @ HOLES[hole])[:3, 3]
    u, v = project(place[None], frame.camera.K)[0].round().astype(int)
    readings, size = frame.depth.copy(), round(half * frame.camera.K[0, 0] / place[2])
    readings[v - size : v + size, u - size : u + size] = depth
    return replace(frame, depth=readings)


def nominal(name: str, state: State) -> Transform:
    return state.T_base_part[name]


def step(
    approaches: Approaches,
    frame: Frame,
    *,
    loose: int,
    resting: int = 0,
    found: int = 0,
    way: float = 0.0,
    unsure: bool = False,
    moving: Sequence[Vector] = (),
    place: Place = nominal,
) -> list[object]:
    approaches.step(
        BASE,
        frame,
        place,
        lying=loose,
        resting=resting,
        found=found,
        moving=moving,
        way=way,
        unsure=unsure,
    )
    return [approaches.frames(0), approaches.frames(1)]


def test_what_lay_loose_is_not_joined_until_something_comes_to_its_place(approaches, toy) -> None:
    table = toy.frame(0, {})
    assert step(approaches, table, loose=2) == [1, 1]
    step(approaches, table, loose=2)
    assert step(approaches, table, loose=2) == [None, None]
    assert step(approaches, table, loose=1) == [None, None]
    # The first pin is the last that is joined, in the second hole.
    # But it goes on lying there, whatever comes.
    assert step(approaches, over(table, 1, 0.5), loose=1) == [None, None]
    assert step(approaches, over(table, 0, 0.5), loose=1) == [None, 0]
    assert step(approaches, table, loose=1) == [None, 1]
    assert step(approaches, over(table, 1, 0.5), loose=0) == [0, 2]
    assert step(approaches, table, loose=0) == [1, 3]


@pytest.mark.parametrize(("beside", "came"), [(0.12, True), (0.14, False)])
def test_a_part_that_is_seen_near_its_place_has_come_there(
    approaches, toy, *, beside: float, came: bool
) -> None:
    table, there = toy.frame(0, {}), (BASE @ HOLES[0])[:3, 3]
    for _ in range(3):
        step(approaches, table, loose=2)
    seen = there - np.array([beside, 0.0, 0.0])
    assert (step(approaches, table, loose=1, moving=[seen])[1] is not None) is came


def test_places_are_where_joints_have_them(approaches, toy) -> None:
    """A vise on its ball is turned: what comes to where it was meant to be comes to nothing."""
    table = toy.frame(0, {})

    def turned(name: str, state: State) -> Transform:
        return transform_from(np.eye(3), np.array([0.0, 0.15, 0.0])) @ state.T_base_part[name]

    for _ in range(3):
        step(approaches, table, loose=2, place=turned)
    assert step(approaches, over(table, 0, 0.5), loose=1, place=turned)[1] is None
    hand = over(table, 0, 0.5, half=0.2)
    assert step(approaches, hand, loose=1, place=turned)[1] == 0


def test_nothing_is_waited_for_longer_than_it_may_have_been_missed(approaches, toy) -> None:
    table = toy.frame(0, {})
    for _ in range(3):
        step(approaches, table, loose=2)
    told = [step(approaches, table, loose=1)[1] for _ in range(LooseConfig().patience + 2)]
    assert told == [None] * LooseConfig().patience + [0, 1]


def test_a_hand_that_was_there_when_the_part_was_taken_brought_something_else(
    approaches, toy
) -> None:
    """It has to be gone from there before one comes that may have brought the part."""
    table = toy.frame(0, {})
    hand = over(table, 0, 0.5)
    for frame in [table] * 3 + [hand] * 2:
        step(approaches, frame, loose=2)
    assert step(approaches, hand, loose=1)[1] is None
    assert step(approaches, over(table, 0, 0.45), loose=1)[1] is None
    assert step(approaches, table, loose=1)[1] is None
    assert step(approaches, hand, loose=1)[1] == 0


@pytest.mark.parametrize(("depth", "came"), [(0.74, False), (0.8, False), (0.73, True)])
def test_only_what_is_nearer_by_more_than_depth_errs_has_come(
    approaches, toy, *, depth: float, came: bool
) -> None:
    table = toy.frame(0, {})
    for _ in range(3):
        step(approaches, table, loose=2)
    assert (step(approaches, over(table, 0, depth), loose=1)[1] is not None) is came


def test_what_came_sooner_than_a_hand_brings_the_part_did_not_bring_it(approaches, toy) -> None:
    table = replace(toy.frame(0, {}), time=10.0)
    for _ in range(3):
        step(approaches, table, loose=2, way=0.3)
    for time, came in ((10.2, False), (10.39, False), (10.41, True)):
        hand = replace(over(table, 0, 0.5), time=time)
        assert (step(approaches, hand, loose=1)[1] is not None) is came


def test_what_stays_there_belongs_to_the_place(approaches, toy) -> None:
    """A jaw that was put over it: what comes next has to be nearer than that."""
    table = toy.frame(0, {})
    jaw = over(table, 0, 0.7)
    for frame in [table] * 3 + [jaw] * 20:
        step(approaches, frame, loose=2)
    assert step(approaches, jaw, loose=1)[1] is None
    assert step(approaches, over(table, 0, 0.6), loose=1)[1] == 0


def test_where_depth_or_places_are_not_known_something_may_have_come(approaches, toy) -> None:
    table = toy.frame(0, {})
    for _ in range(3):
        step(approaches, table, loose=2)
    assert step(approaches, table, loose=1, unsure=True) == [None, 0]
    for _ in range(3):
        step(approaches, table, loose=2)
    blind = over(table, 1, 0.0, half=0.12)
    assert step(approaches, blind, loose=0) == [0, None]


def test_what_came_has_left_once_no_more_than_a_rest_of_it_is_there(approaches, toy) -> None:
    table = toy.frame(0, {})
    hand, other = over(table, 0, 0.5), over(table, 0, 0.5, half=0.03)

    def left(frames: Sequence[Frame], *, loose: int = 1, found: int = 1) -> list[int]:
        told: list[int] = []
        for frame in frames:
            step(approaches, frame, loose=loose, found=found)
            told.append(approaches.left(1))
        return told

    assert left([table] * 3, loose=2) == [0, 0, 0]
    assert left([table, hand, hand, other, table]) == [0, 0, 0, 0, 1]
    # It is back before it was surely gone; what comes after that brings something else.
    assert left([hand, table, table, table, hand, hand]) == [0, 1, 2, 3, 4, 5]
    # The part is seen in it again.
    assert left([hand], found=2) == [0]
    assert left([table, table]) == [1, 2]
    assert left([table], loose=2) == [0]
    assert left([hand, hand, table, table]) == [0, 0, 0, 0]


def test_of_a_camera_that_moves_nothing_is_seen_to_leave(approaches, toy) -> None:
    table = toy.frame(0, {})
    for _ in range(3):
        step(approaches, table, loose=2)
    for frame in [over(table, 0, 0.5)] * 4 + [table] * 3:
        step(approaches, frame, loose=1, unsure=True)
    assert approaches.left(1) == 0


@pytest.mark.parametrize(("depth", "brings"), [(0.43, True), (0.35, False), (0.0, False)])
def test_what_only_passes_far_before_a_place_brings_nothing_there(
    approaches, toy, *, depth: float, brings: bool
) -> None:
    table = toy.frame(0, {})
    arm = over(table, 0, depth, half=0.12)
    for frame in [table] * 3:
        step(approaches, frame, loose=2)
    for frame in [arm] * 4 + [table] * 3:
        step(approaches, frame, loose=1)
    assert (approaches.left(1) == 3) is brings


def test_what_came_before_the_part_could_be_there_did_not_bring_it(approaches, toy) -> None:
    """Nor does it once the part could be: it has to leave, and come again."""
    table = toy.frame(0, {})
    hand = over(table, 0, 0.5)
    for _ in range(3):
        step(approaches, table, loose=2, way=0.3)
    for frame, time in [(hand, 0.2), *[(hand, 1.0)] * 4, *[(table, 1.0)] * 3]:
        step(approaches, replace(frame, time=time), loose=1)
    assert approaches.left(1) == 0
    for frame in [hand] * 3 + [table]:
        step(approaches, replace(frame, time=2.0), loose=1)
    assert approaches.left(1) == 1


def test_one_frame_in_which_depth_errs_is_nothing_that_came(assembly: Assembly, toy) -> None:
    approaches, table = watching(assembly, again=2), toy.frame(0, {})
    hand = over(table, 0, 0.5)
    for _ in range(3):
        step(approaches, table, loose=2)
    told = [step(approaches, frame, loose=1)[1] for frame in (hand, table, hand, hand, table)]
    assert told == [None, None, None, 0, 1]


def test_while_something_passes_before_a_place_no_time_goes_by_there(approaches, toy) -> None:
    table = toy.frame(0, {})
    arm = over(table, 0, 0.35, half=0.12)
    for _ in range(3):
        step(approaches, table, loose=2)
    assert step(approaches, arm, loose=1)[1] is None
    shown = (over(table, 0, 0.5), table, arm, arm, table)
    assert [step(approaches, frame, loose=1)[1] for frame in shown] == [0, 1, 1, 1, 2]


def test_what_came_while_the_part_was_seen_to_lie_brought_something_else(approaches, toy) -> None:
    """And from then on it takes a while to be brought."""
    table = replace(toy.frame(0, {}), time=1.0)
    hand = over(table, 0, 0.5)
    for _ in range(3):
        step(approaches, table, loose=2)
    for _ in range(3):
        step(approaches, hand, loose=1, resting=2, found=2, way=0.3)
    later = (hand, 1.3), (table, 1.4), (hand, 1.39), (table, 1.5), (table, 1.6)
    for frame, time in later:
        step(approaches, replace(frame, time=time), loose=1, found=1)
    assert approaches.left(1) == 0
    for frame in (hand, hand, hand, table):
        step(approaches, replace(frame, time=2.0), loose=1, found=1)
    assert approaches.left(1) == 1


def test_what_could_be_seen_to_come_is_what_nothing_has_covered_for_good(
    assembly: Assembly, toy
) -> None:
    """A hand that shows on a twelfth of it shows on a sixth of the half that is left."""

    def came(covered: float) -> bool:
        approaches, table = watching(assembly), toy.frame(0, {})
        assert table.depth is not None
        u, v = project((BASE @ HOLES[0])[None, :3, 3], table.camera.K)[0].round().astype(int)
        size = round(0.08 * table.camera.K[0, 0] / 0.58)
        jaw = table.depth.copy()
        jaw[v - size : v - size + round(2 * size * covered), u - size : u + size] = 0.5
        hand = jaw.copy()
        hand[v + size - round(size / 5) : v + size, u - size : u + size] = 0.5
        for _ in range(3):
            step(approaches, table, loose=2)
        for _ in range(2):
            step(approaches, replace(table, depth=jaw), loose=2)
        return step(approaches, replace(table, depth=hand), loose=1)[1] is not None

    assert came(0.6)
    assert not came(0.0)


@pytest.mark.parametrize(("beside", "left"), [(0.12, 1), (0.2, 0)])
def test_who_is_there_while_the_part_is_seen_elsewhere_brings_something_else(
    approaches, toy, *, beside: float, left: int
) -> None:
    """As long as it was not there for long enough since."""
    table, hand = toy.frame(0, {}), over(toy.frame(0, {}), 0, 0.5)
    seen = (BASE @ HOLES[0])[:3, 3] - np.array([beside, 0.0, 0.0])
    for _ in range(3):
        step(approaches, table, loose=2)
    step(approaches, table, loose=1)
    for _ in range(3):
        step(approaches, hand, loose=1, found=2, moving=[seen])
    for frame in (hand, hand, table):
        step(approaches, frame, loose=1)
    assert approaches.left(1) == left
