"""The toy's two pins, which its states put in one after the other, counted where they lie."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.loose_parts import LooseParts
from asdfviz.methods.part_poses import part_shapes

BASE = transform_from(np.eye(3), np.array([0.0, 0.0, 0.55]))
SPOTS = [transform_from(np.eye(3), np.array([x, 0.08, 0.7])) for x in (-0.1, 0.1)]
HOLES = [transform_from(np.eye(3), np.array([x, 0.0, 0.03])) for x in (-0.02, 0.02)]
PINS = ("pin", "pin-copy")


class Shaken(AtRest):
    """What lies still before a camera that moves, as it is told."""

    def __init__(self, assembly: Assembly, lying: frozenset[str]) -> None:
        super().__init__(assembly, config=AtRestConfig())
        self.lying = lying

    @property
    def is_shaken(self) -> bool:
        return True

    def lies(self, name: str) -> bool:
        return name in self.lying


def with_hand(frame: Frame) -> Frame:
    """With something over the base, not over where pins lie."""
    assert frame.depth is not None
    depth, K = frame.depth.copy(), frame.camera.K
    u, v, half = int(K[0, 2]), int(K[1, 2]), int(0.09 * K[0, 0])
    depth[v - half : v + half, u - half : u + half] = 0.45
    return replace(frame, depth=depth)


def everything(name: str, state: State) -> float:
    """As if nothing hid a part."""
    return math.inf


def rest_of(assembly: Assembly) -> AtRest:
    """Before a camera that stands still."""
    return AtRest(assembly, config=AtRestConfig())


@pytest.fixture
def pinned(assembly: Assembly) -> Assembly:
    """States: no pin is in, one is, both are."""
    joined = [dict(zip(PINS[:k], HOLES, strict=False)) for k in range(3)]
    states = tuple(State(k, f"s{k}", {"base": np.eye(4), **pins}) for k, pins in enumerate(joined))
    return replace(assembly, states=states, transitions=frozenset({(0, 1), (1, 2)}))


def told_last(
    loose: LooseParts,
    shown: Iterable[tuple[Sequence[Transform], Frame, PoseEstimate | None]],
    *,
    rest: AtRest,
    score: float = 0.9,
    shows: Callable[[str, State], float] = everything,
    step_frames: float = 0.0,
) -> np.ndarray | None:
    """What it says of the last of these pins, frames and bases; a second lies between two."""
    told: np.ndarray | None = None
    for count, (pins, frame, base) in enumerate(shown):
        poses = {
            name: PoseEstimate(name, T, score, "refined")
            for name, T in zip(PINS, pins, strict=False)
        }
        told = loose.step(
            base,
            poses,
            replace(frame, time=float(count)),
            rest=rest,
            shown_px=shows,
            step_frames=step_frames,
        )
    return told


@pytest.fixture
def counted(pinned: Assembly, toy):
    """Make something that counts, shows it frames, and gives what it said of the last one."""

    def make(
        *shown: tuple[Sequence[Transform], int],
        score: float = 0.9,
        hand: bool = False,
        came: bool = True,
        rest: AtRest | None = None,
        shows: Callable[[str, State], float] = everything,
        loses_base: bool = False,
        step_frames: float = 0.0,
        **options,
    ) -> np.ndarray | None:
        rest = rest or rest_of(pinned)
        config = LooseConfig(
            **{
                "small_px": 50.0,
                "enough": 4,
                "wait": 3,
                "untouched": 0.0,
                "seen_far": 0.0,
                **options,
            }
        )
        loose = LooseParts(pinned, part_shapes(pinned, surface_points=200), config=config)
        base = PoseEstimate("base", BASE, 1.0, "refined")
        seen: list[tuple[Sequence[Transform], Frame, PoseEstimate | None]] = []
        for number, (pins, frames) in enumerate(shown):
            frame: Frame = toy.frame(0, {})
            if hand and len(pins) < 2 and frame.depth is not None:
                frame = replace(frame, depth=np.full_like(frame.depth, 0.4))
            elif came and len(pins) < 2:
                frame = with_hand(frame)
            seen += [(pins, frame, None if loses_base and number else base)] * frames
        return told_last(loose, seen, rest=rest, score=score, shows=shows, step_frames=step_frames)

    return make


def test_a_pin_that_lies_where_it_lay_is_not_joined(counted) -> None:
    assert counted((SPOTS, 3)) is None
    told = counted((SPOTS, 5), there=2.0)
    assert told is not None
    assert np.log(told[0] / told) == pytest.approx([0.0, 2.0, 4.0])
    one = counted((SPOTS, 5), (SPOTS[1:], 1))
    assert one[0] == pytest.approx(one[1])
    assert one[2] < one[1]


def test_two_pins_that_lie_close_are_not_one_that_was_seen_twice_as_often(counted) -> None:
    close = [transform_from(np.eye(3), np.array([x, 0.08, 0.7])) for x in (0.1, 0.108)]
    assert counted((close, 3)) is None
    told = counted((close, 5), there=2.0)
    assert np.log(told[0] / told) == pytest.approx([0.0, 2.0, 4.0])


def test_a_pin_that_is_gone_for_longer_than_a_hand_takes_is_joined(counted) -> None:
    just = counted((SPOTS, 5), (SPOTS[:1], 3))
    assert just[0] == pytest.approx(just[1])
    told = counted((SPOTS, 5), (SPOTS[:1], 5), gain=0.5, there=0.0)
    assert np.log(told[1] / told[0]) == pytest.approx(2 * 0.5)
    assert told[1] == pytest.approx(told[2])
    long = counted((SPOTS, 5), ([], 100), most=4.0)
    assert np.log(long[2] / long) == pytest.approx([4.0, 4.0, 0.0])


def test_what_is_gone_is_not_joined_before_something_came_to_its_place(
    counted, pinned: Assembly
) -> None:
    told = counted((SPOTS, 8), ([], 50), came=False, there=0.0, untouched=1.5)
    assert np.log(told[0] / told) == pytest.approx([0.0, 1.5, 1.5])
    # A camera that moves shows nearer things everywhere.
    shaken = Shaken(pinned, frozenset(PINS))
    told = counted((SPOTS, 8), ([], 100), came=False, rest=shaken, there=0.0)
    assert told[2] > told[1]


def test_a_hand_that_came_and_left_has_brought_what_is_gone(toy, pinned: Assembly) -> None:
    options = {"small_px": 50.0, "enough": 4, "wait": 40}
    options |= {"untouched": 0.0, "there": 0.0, "seen_far": 0.0}

    def after(
        away: int, shows: Callable[[str, State], float] = everything, **more: float
    ) -> np.ndarray | None:
        config = LooseConfig(**{**options, **more})
        loose = LooseParts(pinned, part_shapes(pinned, surface_points=200), config=config)
        base, table = PoseEstimate("base", BASE, 1.0, "refined"), toy.frame(0, {})
        shown = [(SPOTS, table, base)] * 8
        shown += [(SPOTS[:1], with_hand(table), base)] * 5 + [(SPOTS[:1], table, base)] * away
        return told_last(loose, shown, rest=rest_of(pinned), shows=shows)

    assert after(0) is None
    told = after(2, left=3.0, gain=0.5)
    assert told is not None
    assert np.log(told[1] / told) == pytest.approx([2 * 3.0 * 0.5, 0.0, 0.0])
    assert after(2, left=0.0) is None
    # One that shows where it is joined could be seen there, too.
    large = after(2, left=3.0, gain=0.5, small_px=5.0, most_shown=1.5)
    assert large is not None
    assert np.log(large[1] / large) == pytest.approx([1.5, 0.0, 0.0])
    assert after(2, left=3.0, small_px=5.0, most_shown=0.0) is None


def test_a_hand_carries_for_a_part_of_the_time_of_a_step(counted) -> None:
    def gone(frames: int, step_frames: float) -> np.ndarray | None:
        taken = (SPOTS, 5), ([], frames)
        return counted(*taken, carried=0.5, gain=0.5, there=0.0, step_frames=step_frames)

    assert gone(20, 40.0) is None
    told = gone(22, 40.0)
    assert told is not None
    assert np.log(told[2] / told) == pytest.approx([1.0, 1.0, 0.0])
    assert gone(5, 2.0) is not None  # `wait` is the least


def test_what_was_last_seen_on_its_way_has_only_the_rest_of_it_before_it(counted) -> None:
    hole, taken = BASE @ HOLES[1], SPOTS[1]
    on_its_way = [([SPOTS[0], taken + share * (hole - taken)], 1) for share in (0.25, 0.5, 0.75)]

    def gone(frames: int) -> np.ndarray | None:
        shown = (SPOTS, 5), *on_its_way, (SPOTS[:1], frames)
        return counted(*shown, carried=1.0, gain=0.5, there=0.0, step_frames=40.0)

    assert gone(10) is None
    told = gone(12)
    assert told is not None
    assert np.log(told[1] / told) == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize(("shortest", "frames"), [(0.5, 5), (0.8, 8)])
def test_what_was_last_seen_near_its_place_is_waited_for_less_long(
    counted, *, shortest: float, frames: int
) -> None:
    hole, taken = BASE @ HOLES[1], SPOTS[1]
    on_its_way = [([SPOTS[0], taken + share * (hole - taken)], 1) for share in (0.25, 0.5, 0.75)]

    def gone(frames: int) -> np.ndarray | None:
        shown = (SPOTS, 5), *on_its_way, (SPOTS[:1], frames)
        return counted(*shown, wait=10, shortest=shortest, carried=0.0, gain=0.5, there=0.0)

    assert gone(frames) is None
    told = gone(frames + 1)
    assert told is not None
    assert np.log(told[1] / told) == pytest.approx([0.5, 0.0, 0.0])


def test_a_twin_that_no_state_joins_has_no_way_to_go(pinned: Assembly, toy) -> None:
    states = tuple(
        replace(s, T_base_part={n: T for n, T in s.T_base_part.items() if n != PINS[1]})
        for s in pinned.states[:2]
    )
    spare = replace(pinned, states=states, transitions=frozenset({(0, 1)}))
    config = LooseConfig(small_px=50.0, enough=4, wait=3, carried=1.0, gain=0.5, there=0.0)
    loose = LooseParts(spare, part_shapes(spare, surface_points=200), config=config)
    base, frame, rest = PoseEstimate("base", BASE, 1.0, "refined"), toy.frame(0, {}), rest_of(spare)
    hand = with_hand(frame)
    found = {n: PoseEstimate(n, T, 0.9, "refined") for n, T in zip(PINS, SPOTS, strict=True)}
    told: list[np.ndarray | None] = []
    shots = [(found, frame)] * 5 + [({PINS[1]: found[PINS[1]]}, hand)] * 12
    for time, (poses, shot) in enumerate(shots):
        shown = replace(shot, time=float(time))
        told.append(
            loose.step(base, poses, shown, rest=rest, shown_px=everything, step_frames=10.0)
        )
    assert told[14] is None
    assert told[16] is not None
    assert np.isfinite(told[16]).all()
    assert told[16][1] > told[16][0]


def test_what_was_gone_before_a_hand_took_another_one_is_in_its_place(counted) -> None:
    def taken(first: int, second: int) -> np.ndarray | None:
        frames = (SPOTS, 5), (SPOTS[:1], first), ([], second)
        options = {"empty": 4, "gain": 0.5, "there": 0.0, "carried": 1.0}
        return counted(*frames, step_frames=100.0, **options)

    assert taken(50, 0) is None
    assert taken(50, 3) is None  # may be missed for a moment
    told = taken(50, 4)
    assert told is not None
    assert np.log(told[1] / told) == pytest.approx([2.0, 0.0, 0.0])
    assert taken(4, 20) is None  # both together: no matter which came first


@pytest.mark.parametrize("seen_empty", [3, 4])
def test_what_was_seen_to_be_gone_is_not_behind_a_hand_that_comes_later(
    pinned: Assembly, toy, *, seen_empty: int
) -> None:
    rest, shapes = rest_of(pinned), part_shapes(pinned, surface_points=200)
    loose = LooseParts(pinned, shapes, config=LooseConfig(small_px=50.0, enough=4, wait=9, empty=4))
    base, clear = PoseEstimate("base", BASE, 1.0, "refined"), toy.frame(0, {})
    hand = replace(clear, depth=np.full_like(clear.depth, 0.4))
    found = {n: PoseEstimate(n, T, 0.9, "refined") for n, T in zip(PINS, SPOTS, strict=True)}
    shots = [(found, clear)] * 5 + [({}, clear)] * seen_empty + [({}, hand)] * 50
    told = [loose.step(base, p, f, rest=rest, shown_px=everything) for p, f in shots][-1]
    assert (told is not None) is (seen_empty == 4)


@pytest.mark.parametrize("lay", [2, 3])
def test_a_pin_that_lay_for_a_moment_before_a_hand_hid_it_is_not_gone(counted, *, lay: int) -> None:
    brought = [([transform_from(np.eye(3), np.array([0.03 * k, 0.1, 0.6]))], 1) for k in range(4)]
    told = counted(*brought, (SPOTS[:1], lay), ([], 50), hand=True)
    assert (told is None) is (lay == 3)
    assert counted(*brought, (SPOTS[:1], lay), ([], 50)) is not None


def test_a_place_is_not_empty_while_something_unsure_is_found_there(pinned: Assembly, toy) -> None:
    """In the shadow of an arm a tracker is not sure of what it still follows."""
    shapes, base = (
        part_shapes(pinned, surface_points=200),
        PoseEstimate("base", BASE, 1.0, "refined"),
    )
    config = LooseConfig(small_px=50.0, enough=4, wait=3, untouched=0.0, found=0.65)
    table, hand = toy.frame(0, {}), with_hand(toy.frame(0, {}))

    def told(score: float) -> np.ndarray | None:
        loose, said = LooseParts(pinned, shapes, config=config), None
        sure = [PoseEstimate(n, T, 0.9, "refined") for n, T in zip(PINS, SPOTS, strict=True)]
        shaded = [PoseEstimate(pin.part, pin.T_camera_part, score, "refined") for pin in sure]
        shown = [(sure, table)] * 5 + [(shaded if score else [], hand)] * 30
        for number, (pins, frame) in enumerate(shown):
            poses, frame = {pin.part: pin for pin in pins}, replace(frame, time=float(number))
            said = loose.step(base, poses, frame, rest=rest_of(pinned), shown_px=everything)
        return said

    assert told(0.5) is None
    assert told(0.0) is not None


def test_while_the_base_is_hidden_it_is_taken_to_be_where_it_was(counted) -> None:
    frames = (SPOTS, 5), (SPOTS[:1], 9)
    assert counted(*frames, loses_base=True) == pytest.approx(counted(*frames))


@pytest.mark.parametrize(
    ("options", "first"),
    [({"score": 0.3}, 5), ({"small_px": 1.0}, 5), ({"hand": True}, 5), ({}, 3)],
    ids=["unsure", "large", "behind a hand", "hardly seen"],
)
def test_what_is_gone_says_nothing_if(counted, options: dict, first: int) -> None:
    assert counted((SPOTS, first), ([], 50), **options) is None


def test_a_large_pin_that_is_gone_is_joined_where_the_others_would_hide_it(counted) -> None:
    def second_is_hidden(name: str, state: State) -> float:
        return 20.0 if state.index == 2 else 400.0

    def gone(count: int, shows: Callable[[str, State], float]) -> np.ndarray | None:
        return counted((SPOTS, 5), (SPOTS[count:], 50), there=0.0, small_px=5.0, shows=shows)

    # With the first one alone in its place it would be seen there: being gone says nothing.
    assert gone(1, second_is_hidden) is None
    both = gone(2, second_is_hidden)
    assert both is not None
    assert np.log(both[2] / both) == pytest.approx([4.0, 4.0, 0.0])
    # The others would leave fewer pixels than the square of `small_px`, or more.
    assert gone(2, lambda name, state: 24.0) is not None
    assert gone(2, lambda name, state: 26.0) is None


def test_before_a_camera_that_moves_only_what_lies_still_is_loose(
    counted, pinned: Assembly
) -> None:
    lying = Shaken(pinned, frozenset(PINS))
    assert counted((SPOTS, 5), rest=lying, there=2.0) == pytest.approx(
        counted((SPOTS, 5), there=2.0)
    )
    lying.lying = frozenset()
    assert counted((SPOTS, 50), rest=lying) is None


def test_a_larger_one_that_is_gone_is_joined_where_pictures_are_blurred(
    counted, pinned: Assembly
) -> None:
    gone = ((SPOTS, 5), ([], 9))
    assert counted(*gone, small_px=1.0, blurred_px=50.0) is None
    rest = Shaken(pinned, frozenset(PINS))
    told = counted(*gone, rest=rest, small_px=1.0, blurred_px=50.0)
    assert told[2] > told[0]
    assert counted(*gone, rest=rest, small_px=50.0, blurred_px=1.0) is None


def test_a_pin_in_its_hole_is_not_loose(counted) -> None:
    assert counted(([BASE @ T for T in HOLES], 9)) is None


def test_a_pin_that_moves_lies_nowhere(counted) -> None:
    moving = [([transform_from(np.eye(3), np.array([0.03 * k, 0.1, 0.6]))], 1) for k in range(9)]
    assert counted(*moving) is None


def test_without_base_or_depth_nothing_is_said(pinned: Assembly, toy) -> None:
    loose = LooseParts(pinned, part_shapes(pinned, surface_points=200), config=LooseConfig())
    base = PoseEstimate("base", BASE, 1.0, "refined")
    assert loose.step(None, {}, toy.frame(0, {}), rest=rest_of(pinned), shown_px=everything) is None
    assert loose.step(base, {}, toy.frame(0), rest=rest_of(pinned), shown_px=everything) is None
    off = LooseParts(
        pinned, part_shapes(pinned, surface_points=200), config=LooseConfig(enabled=False)
    )
    assert off.step(base, {}, toy.frame(0, {}), rest=rest_of(pinned), shown_px=everything) is None


@pytest.mark.parametrize(
    "wrong", [{"wait": 0}, {"enough": 0}, {"gain": -1.0}, {"there": -0.1}, {"carried": -0.1}]
)
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    name, value = next(iter(wrong.items()))
    with pytest.raises(MethodError, match=rf"loose\..*{name} (is )?{value:g}"):
        LooseConfig(**wrong)


def test_what_is_half_done_may_show_what_is_hidden_in_the_end(toy, pinned: Assembly) -> None:
    parts = {name: part for name, part in pinned.parts.items() if name != "pin-copy"}
    states = (*pinned.states[:2], State(2, "half", {"base": np.eye(4), "pin": HOLES[1]}))
    assembly = replace(pinned, parts=parts, states=states)

    def shown(name: str, state: State) -> float:
        return math.inf if state.name == "half" else 0.0

    base, frame = PoseEstimate("base", BASE, 0.9, "refined"), toy.frame(0, {"base": BASE})

    def scores_after(half_done: tuple[int, ...], *, hidden: Callable[[str, State], float]) -> Any:
        shapes = part_shapes(assembly, surface_points=200)
        config = LooseConfig(small_px=2.0)
        loose = LooseParts(assembly, shapes, config=config, half_done=half_done)
        scores = None
        for k in range(32):
            lying = {"pin": PoseEstimate("pin", SPOTS[0], 0.9, "refined")} if k < 12 else {}
            shot = replace(frame if k < 12 else with_hand(frame), time=float(k))
            scores = loose.step(base, lying, shot, rest=rest_of(assembly), shown_px=hidden)
        return scores

    assert scores_after((), hidden=shown) is None
    scores = scores_after((2,), hidden=shown)
    assert scores[0] < 0.1 * scores[1]
    # Where only what is half done leaves so many loose, it alone is asked.
    assert scores_after((1, 2), hidden=shown) is None
    assert scores_after((2,), hidden=everything) is None


@pytest.mark.parametrize("is_seen_elsewhere", [True, False])
def test_where_a_part_lay_it_does_not_lie_hidden_once_all_were_found_elsewhere(
    pinned: Assembly, toy, *, is_seen_elsewhere: bool
) -> None:
    """The jaw that is put down over the place of a pin hides no pin that was seen in a hand since."""
    config = LooseConfig(small_px=50.0, enough=4, wait=3, untouched=0.0, seen_far=0.0)
    loose = LooseParts(pinned, part_shapes(pinned, surface_points=200), config=config)
    base, table = PoseEstimate("base", BASE, 1.0, "refined"), toy.frame(0, {})
    lies = SPOTS[0][:3, 3]
    u, v = (table.camera.K @ lies)[:2] / lies[2]
    covered = replace(table, depth=table.depth.copy())
    covered.depth[int(v) - 12 : int(v) + 12, int(u) - 12 : int(u) + 12] = 0.6
    carried = transform_from(np.eye(3), np.array([-0.1, -0.08, 0.62]))
    shown = [(SPOTS, table, base)] * 6
    shown += [([carried, SPOTS[1]], covered, base)] * 2 if is_seen_elsewhere else []
    shown += [(SPOTS[1:], with_hand(covered), base)] * 12
    told = told_last(loose, shown, rest=rest_of(pinned))
    speaks = told is not None and bool(told[1] > 2 * told[0])
    assert speaks is is_seen_elsewhere


@pytest.mark.parametrize(
    ("away", "score", "option", "joined"),
    [
        (0.12, 0.9, 4.0, False),
        (0.12, 0.9, 0.0, True),
        (0.03, 0.9, 4.0, True),
        (0.12, 0.7, 4.0, True),
    ],
)
def test_a_part_that_surely_is_far_from_any_place_is_not_joined_wherever_it_lay(
    counted, *, away: float, score: float, option: float, joined: bool
) -> None:
    """It is carried, and lies in no frame where it lay; nothing else has told of it yet."""
    carried = [
        ([transform_from(np.eye(3), np.array([-0.02 - away, 0.02 * k, 0.58]))], 1) for k in range(3)
    ]
    told = counted(*carried, score=score, seen_far=option, came=False)
    if joined:
        assert told is None
    else:
        assert counted(*carried[:2], score=score, seen_far=option, came=False) is None
        assert np.log(told[:2] / told[2]) == pytest.approx([4.0, 4.0])


def test_how_sure_its_pose_must_be_is_an_option(counted) -> None:
    carried = [
        ([transform_from(np.eye(3), np.array([-0.14, 0.02 * k, 0.58]))], 1) for k in range(3)
    ]
    options = {"score": 0.7, "seen_far": 4.0, "came": False}
    assert counted(*carried, **options) is None
    assert counted(*carried, **options, far_sure=0.6) is not None
