"""The toy's block on the right, something like it on the left, and a board that hides the block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.still_there import SPOTS, StillThere, StillThereConfig
from asdfviz.methods.track_memory import FOUND, YOUNG, Track, surely_placed


def at(x: float, y: float = 0.0, z: float = 0.6) -> Transform:
    return transform_from(np.eye(3), np.array([x, y, z]))


RIGHT, LEFT, BELOW = at(0.1), at(-0.15), at(-0.15, 0.12)


def all_hidden(frame: Frame, names: frozenset[str]) -> frozenset[str]:
    return names


def others(
    toy,
    frame: Frame,
    proposed: Mapping[str, Transform],
    config: StillThereConfig | None = None,
    hidden=all_hidden,
) -> frozenset[str]:
    """What is said of a frame after one in which the block was seen on the right, a twin on the left."""
    still = StillThere(toy.assembly, config=config or StillThereConfig())
    still.see(toy.photo(0, [RIGHT, LEFT]), {"block": RIGHT})
    return still.others(frame, proposed, {"block": RIGHT}, hidden)


def test_what_lay_there_all_along_is_not_the_part(toy) -> None:
    gone = toy.photo(5, [LEFT])
    assert others(toy, gone, {"block": LEFT}) == {"block"}


def test_what_was_put_there_may_be_the_part(toy) -> None:
    moved = toy.photo(5, [LEFT, BELOW])
    assert others(toy, moved, {"block": BELOW}) == frozenset()
    # Nor is anything said of its own place, or of a picture that changed as a whole.
    assert others(toy, toy.photo(5, [LEFT]), {"block": at(0.09)}) == frozenset()
    dark = replace(moved, rgb=moved.rgb // 2)
    assert others(toy, dark, {"block": LEFT}) == frozenset()
    shadowed = replace(moved, rgb=(moved.rgb * 0.9).astype(np.uint8))
    assert others(toy, shadowed, {"block": LEFT}) == {"block"}
    assert others(toy, replace(shadowed, depth=None), {"block": LEFT}) == frozenset()
    assert moved.depth is not None
    lower = replace(moved, depth=moved.depth + 0.02)
    assert others(toy, lower, {"block": LEFT}) == frozenset()


def test_nothing_is_said_of_what_is_in_sight_unknown_or_long_ago(toy) -> None:
    gone = toy.photo(5, [LEFT])
    assert others(toy, gone, {"block": LEFT}, hidden=lambda *_: frozenset()) == frozenset()
    assert others(toy, gone, {"pin": LEFT}) == frozenset()
    assert others(toy, gone, {"block": LEFT}, StillThereConfig(enabled=False)) == frozenset()


def test_frames_are_counted_whatever_their_files_are_called(toy) -> None:
    still = StillThere(toy.assembly, config=StillThereConfig(memory=3))
    still.see(toy.photo(0, [RIGHT, LEFT]), {"block": RIGHT})
    told: list[frozenset[str]] = []
    for i in range(1, 5):
        gone = replace(toy.photo(5, [LEFT]), index=1000 * i)
        told.append(still.others(gone, {"block": LEFT}, {"block": RIGHT}, all_hidden))
        still.see(gone, {})
    assert told == [{"block"}] * 3 + [frozenset()]


def test_pictures_go_by_the_new_names_of_twins(toy) -> None:
    still = StillThere(toy.assembly, config=StillThereConfig())
    still.see(toy.photo(0, [RIGHT, LEFT]), {"pin": RIGHT})
    still.rename({"pin": "pin-copy", "pin-copy": "pin"})
    gone, last = toy.photo(3, [LEFT]), {"pin": RIGHT, "pin-copy": RIGHT}
    proposed = {"pin": LEFT, "pin-copy": LEFT}
    assert still.others(gone, proposed, last, all_hidden) == {"pin-copy"}


def test_where_a_twin_lay_a_part_may_be(toy) -> None:
    """The hand took one of two pins, and the other goes on under its name until it is in its place."""
    still = StillThere(toy.assembly, config=StillThereConfig())
    both = toy.photo(0, [RIGHT, LEFT])
    still.see(both, {"pin": RIGHT, "pin-copy": LEFT})
    gone, last = toy.photo(3, [LEFT]), {"pin": RIGHT, "pin-copy": BELOW}
    assert still.others(gone, {"pin": LEFT}, last, all_hidden) == frozenset()
    # Nor one that lay there itself: it may only have been called so.
    assert still.others(gone, {"pin-copy": LEFT}, last, all_hidden) == frozenset()
    still.see(toy.photo(1, [BELOW, LEFT]), {"pin": BELOW, "pin-copy": BELOW})
    assert still.others(gone, {"pin": LEFT}, last | {"pin": RIGHT}, all_hidden) == frozenset()
    # A place that holds it is none where it lay.
    held = StillThere(toy.assembly, config=StillThereConfig())
    held.see(both, {"pin": RIGHT, "pin-copy": LEFT}, held={"pin-copy"})
    assert held.others(gone, {"pin": LEFT}, last, all_hidden) == {"pin"}


def test_of_places_where_twins_lay_those_of_a_moment_are_forgotten_first(toy) -> None:
    still = StillThere(toy.assembly, config=StillThereConfig())
    both = toy.photo(0, [RIGHT, LEFT])
    for _ in range(2):
        still.see(both, {"pin": RIGHT, "pin-copy": LEFT})
    for step in range(2 * SPOTS + 3):  # carried by
        still.see(both, {"pin": at(0.02 * step - 0.05, 0.1)})
    still.see(both, {"pin": BELOW})
    gone = toy.photo(3, [LEFT])
    assert still.others(gone, {"pin": LEFT}, {"pin": BELOW}, all_hidden) == frozenset()
    first = at(-0.05, 0.1)
    assert still.others(both, {"pin": first}, {"pin": BELOW}, all_hidden) == {"pin"}


def test_a_place_outside_the_image_shows_nothing(toy) -> None:
    assert others(toy, toy.photo(5, [LEFT]), {"block": at(-3.0)}) == frozenset()


@pytest.mark.parametrize("share", [0.0, 1.5])
def test_no_share_is_refused(share: float) -> None:
    with pytest.raises(MethodError, match=r"still_there\.share"):
        StillThereConfig(share=share)


def test_parts_are_surely_placed_that_tracker_and_detector_agreed_on() -> None:
    tracks = {name: Track(RIGHT, age=YOUNG) for name in ("sure", "young", "hidden", "unheard")}
    for track in tracks.values():
        track.support.own = FOUND
    tracks["young"].age -= 1
    tracks["hidden"].unsure = 1
    tracks["unheard"].support.own /= 2
    assert surely_placed(tracks) == ("sure",)
