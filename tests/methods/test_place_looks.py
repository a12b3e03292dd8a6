"""What stands in the places of joined parts, with a network that says what it is told to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, Frame, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.place_looks import PlaceLooks, PlaceLooksConfig

CAMERA = Camera(np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]), 320, 240)
ALONE = np.array([1.0, 0.0])
FACING = rotation_about(np.array([1.0, 0, 0]), np.pi)
"""The base's z, on which the block stands, looks at the camera."""


@pytest.fixture
def seeing(namer: Callable) -> Callable[[float], Any]:
    """Make a network that sees the block so surely, wherever it looks."""
    return lambda block: namer(lambda name, _: block * (name == "toy/block"))


def base_at(x: float = 0.0) -> PoseEstimate:
    return PoseEstimate("base", transform_from(FACING, np.array([x, 0, 0.6])), 1.0, "refined")


def frame(depth: float | None = 0.57) -> Frame:
    measured = None if depth is None else np.full((240, 320), depth, np.float32)
    return Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), measured, CAMERA)


def looks_of(assembly: Assembly, looker: object | None, **options: float) -> PlaceLooks:
    shapes = part_shapes(assembly, surface_points=50)
    return PlaceLooks(assembly, shapes, looker, config=PlaceLooksConfig(**options))  # pyright: ignore[reportArgumentType]


def test_a_part_that_is_seen_in_its_place_speaks_for_its_state(
    assembly: Assembly, seeing: Callable
) -> None:
    for seen, speaks_for in ((0.98, 1), (0.01, 0)):
        looker = seeing(seen)
        scores = looks_of(assembly, looker).step(base_at(), {}, ALONE, frame())
        assert scores is not None
        assert scores.argmax() == speaks_for
        assert scores.sum() == pytest.approx(1)
        # The block's middle lies 30 mm along x and 30 mm nearer than the base's.
        (box,) = looker.boxes
        assert (box[:2] + box[2:]) / 2 == pytest.approx([159.5 + 300 * 0.03 / 0.57, 119.5], abs=1)
        assert looker.distances == pytest.approx([0.57])


def test_of_a_part_that_the_network_does_not_know_no_place_is_empty(
    assembly: Assembly, seeing: Callable
) -> None:
    looker = seeing(0.0)
    looker.classes = ("toy/base", "toy/pin")
    assert looks_of(assembly, looker).step(base_at(), {}, ALONE, frame()) is None
    assert not looker.asked


def test_a_part_that_may_be_hidden_says_less_than_one_that_is_seen(
    assembly: Assembly, seeing: Callable
) -> None:
    told = [
        looks_of(assembly, seeing(p)).step(base_at(), {}, ALONE, frame()) for p in (0.99, 0.001)
    ]
    seen, unseen = (float(np.log(s[1] / s[0])) for s in told if s is not None)
    assert seen > 1.5 * abs(unseen)


def test_an_empty_place_that_looks_like_the_part_is_compared_with_itself(
    assembly: Assembly, seeing: Callable
) -> None:
    looker = seeing(0.7)
    looks = looks_of(assembly, looker, jump=1.2, gain=0.7)
    later = kept = None
    first = looks.step(base_at(), {}, ALONE, frame())
    for _ in range(40):
        later = looks.step(base_at(), {}, ALONE, frame())
    assert first is not None
    assert later is not None
    assert first[1] > 0.5 > later[1], "it looked like this all the time"
    looker.says = seeing(0.97).says
    changed = looks.step(base_at(), {}, ALONE, frame())
    assert changed is not None
    assert changed[1] > 0.6
    for _ in range(40):  # joined: the place is no longer taken for empty
        kept = looks.step(base_at(), {}, np.array([0.1, 0.9]), frame())
    assert kept is not None
    assert kept[1] == pytest.approx(changed[1], abs=0.01)


def test_what_is_hidden_or_out_of_view_says_nothing(assembly: Assembly, seeing: Callable) -> None:
    looks = looks_of(assembly, seeing(0.98))
    assert looks.step(base_at(), {}, ALONE, frame(depth=0.45)) is None, "a hand in front"
    assert looks.step(base_at(0.5), {}, ALONE, frame()) is None
    assert looks.step(None, {}, ALONE, frame()) is None
    assert looks.step(base_at(), {}, ALONE, frame(depth=None)) is not None


def test_a_part_that_is_known_to_be_before_its_place_is_not_looked_for_in_it(
    assembly: Assembly, seeing: Callable
) -> None:
    looker = seeing(0.98)
    looks = looks_of(assembly, looker)
    assert looks.step(base_at(), {}, ALONE, frame(), without={"block"}) is None
    assert not looker.asked
    assert looks.step(base_at(), {}, ALONE, frame(), without={"pin"}) is not None


def test_without_names_nobody_is_asked(assembly: Assembly, seeing: Callable) -> None:
    mute = seeing(0.9)
    mute.tells_names = False
    for looker in (mute, None, object()):
        assert looks_of(assembly, looker).step(base_at(), {}, ALONE, frame()) is None
    off = looks_of(assembly, seeing(0.9), enabled=False)
    assert off.step(base_at(), {}, ALONE, frame()) is None


@pytest.mark.parametrize("wrong", [{"empty": 0.0}, {"empty": 1.0}, {"delay": 0}])
def test_options_out_of_range_are_named(assembly: Assembly, wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match="place_looks"):
        looks_of(assembly, None, **wrong)


def test_parts_that_are_joined_together_must_all_be_there(
    assembly: Assembly, seeing: Callable
) -> None:
    """A block and a pin make one step; the network sees the block alone."""
    joined = assembly.states[1]
    pin = transform_from(np.eye(3), np.array([-0.03, 0, 0.03]))
    both = replace(joined, T_base_part={**joined.T_base_part, "pin": pin})
    step = replace(assembly, states=(assembly.states[0], both))
    scores = looks_of(step, seeing(0.98)).step(base_at(), {}, ALONE, frame())
    assert scores is not None
    assert scores.argmax() == 0


def test_a_small_place_is_looked_at_with_shifts(assembly: Assembly, seeing: Callable) -> None:
    for small, count in ((0.02, 1), (0.5, 5)):
        looker = seeing(0.5)
        looks_of(assembly, looker, small=small).step(base_at(), {}, ALONE, frame())
        assert len(looker.boxes) == count
