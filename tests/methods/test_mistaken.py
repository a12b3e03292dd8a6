"""The toy's block on the right, and something like it on the left that was there all along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, transform_from
from asdfviz.methods.leaps import LeapsConfig
from asdfviz.methods.mistaken import LAIN, PATIENCE, SURE, Mistaken
from asdfviz.methods.own_colors import OwnColorsConfig
from asdfviz.methods.still_there import StillThereConfig


def at(x: float) -> Transform:
    return transform_from(np.eye(3), np.array([x, 0.0, 0.6]))


RIGHT, LEFT = at(0.1), at(-0.15)
RED, WHITE = (190, 30, 30), (200, 200, 205)


def block(T_camera_part: Transform, score: float = 0.9) -> dict[str, PoseEstimate]:
    return {"block": PoseEstimate("block", T_camera_part, score, "refined")}


def begun(toy, own: OwnColorsConfig | None = None) -> Mistaken:
    return Mistaken(
        toy.assembly,
        config=StillThereConfig(),
        own=own or OwnColorsConfig(),
        leaps=LeapsConfig(),
    )


@pytest.fixture
def mistaken(toy) -> Mistaken:
    """It saw the block on the right, while the other thing was on the left."""
    made = begun(toy)
    see(made, toy.photo(0, [RIGHT, LEFT]), block(RIGHT))
    return made


def see(made: Mistaken, frame: Frame, poses: dict[str, PoseEstimate], frames: int = LAIN) -> None:
    for _ in range(frames):
        made.see(frame, poses)


def test_what_lay_there_all_along_is_something_else(toy, mistaken: Mistaken) -> None:
    gone = toy.photo(5, [LEFT])
    assert mistaken.found(gone, block(LEFT), None) == {"block"}
    assert mistaken.found(gone, block(RIGHT), None) == frozenset()


def test_what_looks_more_like_the_part_than_what_lay_there_may_be_it(toy) -> None:
    made, shot = begun(toy), toy.photo(0, [RIGHT, LEFT])
    for _ in range(LAIN):
        made.see(shot, block(RIGHT), {"block": 0.6})
    gone = toy.photo(5, [LEFT])
    better = StillThereConfig().better
    for score, others in ((0.6 + 0.9 * better, {"block"}), (0.6 + 1.1 * better, set())):
        assert made.found(gone, block(LEFT), None, scores={"block": score}) == others


def test_what_came_there_may_be_the_part(toy, mistaken: Mistaken) -> None:
    assert mistaken.found(toy.photo(5, [RIGHT, LEFT, at(-0.05)]), block(at(-0.05)), None) == set()


def test_where_a_state_has_the_part_is_left_alone(toy, mistaken: Mistaken) -> None:
    gone = toy.photo(5, [LEFT])
    T_camera_base = LEFT @ inverse(toy.assembly.states[1].T_base_part["block"])
    assert mistaken.found(gone, block(LEFT), T_camera_base) == frozenset()
    beside = transform_from(np.eye(3), np.array([0.0, 0.1, 0.0])) @ T_camera_base
    assert mistaken.found(gone, block(LEFT), beside) == {"block"}


def test_only_what_was_sure_is_remembered(toy) -> None:
    unsure = begun(toy)
    see(unsure, toy.photo(0, [RIGHT, LEFT]), block(RIGHT, score=SURE - 0.1))
    assert unsure.found(toy.photo(5, [LEFT]), block(LEFT), None) == frozenset()
    see(unsure, toy.photo(0, [RIGHT, LEFT]), block(RIGHT), frames=LAIN - 1)
    assert unsure.found(toy.photo(5, [LEFT]), block(LEFT), None) == frozenset()


def test_where_a_twin_was_the_twin_may_be(toy) -> None:
    made = begun(toy)
    pins = {"pin": RIGHT, "pin-copy": LEFT}
    seen = {n: PoseEstimate(n, T, 1.0, "refined") for n, T in pins.items()}
    see(made, toy.photo(0, [RIGHT, LEFT]), seen)
    swapped = {"pin": PoseEstimate("pin", LEFT, 0.9, "refined")}
    assert made.found(toy.photo(5, [LEFT]), swapped, None) == frozenset()


def test_twins_go_by_their_new_names(toy) -> None:
    made = begun(toy)
    seen = {"pin": PoseEstimate("pin", RIGHT, 1.0, "refined")}
    see(made, toy.photo(0, [RIGHT, LEFT]), seen)
    made.rename({"pin": "pin-copy", "pin-copy": "pin"})
    both = {n: PoseEstimate(n, LEFT, 0.9, "refined") for n in ("pin", "pin-copy")}
    assert made.found(toy.photo(5, [LEFT]), both, None) == {"pin-copy"}


def painted(toy, things: list[tuple[Transform, tuple[int, int, int]]]) -> Frame:
    """Blocks of some colours on a grey table."""
    depths = [toy.depth({"block": T}) for T, _ in things]
    rgb = np.full((*depths[0].shape, 3), 110, np.uint8)
    for depth, (_, color) in zip(depths, things, strict=True):
        rgb[depth < 0.7] = color
    return replace(toy.frame(0), rgb=rgb, depth=np.minimum.reduce(depths))


def test_what_came_there_with_another_tint_is_something_else(toy) -> None:
    made = begun(toy)
    see(made, painted(toy, [(RIGHT, RED)]), block(RIGHT))
    assert made.found(painted(toy, [(LEFT, WHITE)]), block(LEFT), None) == {"block"}
    assert made.found(painted(toy, [(LEFT, RED)]), block(LEFT), None) == frozenset()
    T_camera_base = LEFT @ inverse(toy.assembly.states[1].T_base_part["block"])
    assert made.found(painted(toy, [(LEFT, WHITE)]), block(LEFT), T_camera_base) == {"block"}
    blind = begun(toy, own=OwnColorsConfig(enabled=False))
    see(blind, painted(toy, [(RIGHT, RED)]), block(RIGHT))
    assert blind.found(painted(toy, [(LEFT, WHITE)]), block(LEFT), None) == frozenset()


def test_a_tint_that_nobody_sees_again_was_a_wrong_one(toy) -> None:
    made = begun(toy)
    see(made, painted(toy, [(RIGHT, WHITE)]), block(RIGHT))
    shot, refused = painted(toy, [(LEFT, RED)]), 0
    for _ in range(PATIENCE + 5):
        refused += made.found(shot, block(LEFT), None) == {"block"}
        made.see(shot, {})
    assert refused == PATIENCE + 1


def test_a_tint_that_is_seen_now_and_then_stays_known(toy) -> None:
    made = begun(toy)
    mine, other = painted(toy, [(RIGHT, RED)]), painted(toy, [(LEFT, WHITE)])
    see(made, mine, block(RIGHT))
    for k in range(3 * PATIENCE):
        if k % PATIENCE == PATIENCE - 1:
            assert made.found(mine, block(RIGHT), None) == frozenset()
            made.see(mine, block(RIGHT))
        else:
            assert made.found(other, block(LEFT), None) == {"block"}
            made.see(other, {})


def test_what_leapt_is_doubted_and_the_group_by_where_it_was_itself(toy) -> None:
    made, group = begun(toy), toy.poses(joined=False)["base"]

    def frame(index: int) -> Frame:
        return toy.frame(index, {"block": RIGHT})

    def base(x: float, score: float) -> PoseEstimate:
        shift = transform_from(np.eye(3), np.array([x, 0.0, 0.0]))
        return PoseEstimate("base", shift @ group, score, "group")

    assert made.doubted(frame(0), block(RIGHT))["block"].score == 0.9
    assert made.doubted(frame(1), block(LEFT, 0.7))["block"].score < 0.5
    made.doubted(frame(1), {"base": base(0.3, 0.9)})
    for index, (x, score, is_believed) in enumerate([(0.0, 0.8, True), (0.3, 0.7, False)]):
        told = made.doubted_base(frame(1 + index), base(x, score))
        assert told is not None
        assert (told.score == score) is is_believed
    assert made.doubted_base(frame(3), None) is None
