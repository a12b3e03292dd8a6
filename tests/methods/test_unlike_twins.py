"""A black pin, another one, and a pale thing of the same shape that lies where the other might."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.asdf_plus import AsdfPlus
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.network import Detects
from asdfviz.methods.unlike_twins import UnlikeTwins, UnlikeTwinsConfig

pytestmark = pytest.mark.usefixtures("shapes_unchecked")

HERE = transform_from(np.eye(3), np.array([-0.1, 0.0, 0.6]))
THERE = transform_from(np.eye(3), np.array([0.1, 0.0, 0.6]))
BASE = transform_from(np.eye(3), np.array([0.0, 0.12, 0.6]))
BLACK, SHADOW, PALE = 30, 22, 150
GREEN, WARM = (16, 42, 38), (34, 29, 25)
"""About as bright as what is black."""
Shade: TypeAlias = int | tuple[int, int, int]
STARTED: dict[str, Callable[[Detects], AsdfTrack | AsdfPlus]] = {
    "asdf_track": lambda detector: AsdfTrack(AsdfTrackConfig(), detector=detector),
    "asdf_plus": lambda detector: AsdfPlus(AsdfPlusConfig(), detector=detector),
}


def frame(toy, index: int, *, here: Shade, there: Shade, at: Transform = THERE) -> Frame:
    """Both pins on a grey table, with the base."""
    depth = toy.depth({"pin": HERE, "pin-copy": at, "base": BASE})
    rgb = np.full((*depth.shape, 3), 110.0)
    middle = depth.shape[1] // 2
    for half, brightness in ((slice(0, middle), here), (slice(middle, None), there)):
        shows = toy.depth({"pin": HERE, "pin-copy": at})[:, half] < 0.7
        rgb[:, half][shows] = brightness
    rgb[toy.depth({"base": BASE}) < 0.7] = (30, 60, 200)
    rgb += np.random.default_rng(index).normal(size=rgb.shape) * 3
    rgb = np.clip(rgb, 0, 255).astype(np.uint8)
    rgb[0, 0] = index  # what the fake detector reads
    return replace(toy.frame(index), rgb=rgb, depth=depth)


@pytest.fixture
def black(assembly: Assembly) -> Assembly:
    parts = {
        name: replace(part, color=np.full(3, BLACK, np.uint8))
        for name, part in assembly.parts.items()
    }
    return replace(assembly, parts=parts)


def strangers(
    toy,
    assembly: Assembly,
    config: UnlikeTwinsConfig | None = None,
    *,
    here: Shade,
    there: Shade,
) -> frozenset[str]:
    """What is said of the other pin once this one is known."""
    shot = frame(toy, 0, here=here, there=there)
    twins = UnlikeTwins(assembly, config=config or UnlikeTwinsConfig())
    assert twins.strangers(shot, {"pin-copy": THERE}) == frozenset(), "nothing is known yet"
    twins.see(shot, {"pin": HERE})
    return looked_at(twins, shot, {"pin-copy": THERE, "base": BASE})


def looked_at(twins: UnlikeTwins, shot: Frame, poses: dict[str, Transform]) -> frozenset[str]:
    """What is said after some frames; a glimpse tells nothing."""
    told = [
        twins.strangers(replace(shot, index=i), poses)
        for i in range(1, UnlikeTwinsConfig().frames + 2)
    ]
    assert not any(told[:-1])
    return told[-1]


def test_a_pale_thing_is_no_twin_of_a_black_part(toy, black: Assembly) -> None:
    assert strangers(toy, black, here=BLACK, there=PALE) == {"pin-copy"}
    assert strangers(toy, black, here=BLACK, there=SHADOW) == frozenset()
    off = UnlikeTwinsConfig(enabled=False)
    assert strangers(toy, black, off, here=BLACK, there=PALE) == frozenset()


def test_a_thing_of_another_tint_is_no_twin_however_bright(toy, black: Assembly) -> None:
    assert strangers(toy, black, here=BLACK, there=GREEN) == {"pin-copy"}
    assert strangers(toy, black, here=BLACK, there=WARM) == frozenset(), "the light is warm there"
    blind = UnlikeTwinsConfig(tint=5.0)
    assert strangers(toy, black, blind, here=BLACK, there=GREEN) == frozenset()
    assert strangers(toy, black, here=GREEN, there=BLACK) == frozenset()


def test_one_frame_in_another_light_does_not_make_a_stranger_of_the_other(
    toy, black: Assembly
) -> None:
    cool = (25, 29, 34)
    parts = {n: replace(p, color=np.array(cool, np.uint8)) for n, p in black.parts.items()}

    def told(frames: int) -> frozenset[str]:
        twins = UnlikeTwins(replace(black, parts=parts), config=UnlikeTwinsConfig())
        for _ in range(frames):
            twins.see(frame(toy, 0, here=BLACK, there=WARM), {"pin": HERE})
        shot = frame(toy, 0, here=cool, there=WARM)
        twins.see(shot, {"pin": HERE})
        return looked_at(twins, shot, {"pin-copy": THERE})

    assert told(0) == {"pin-copy"}
    assert told(9) == frozenset()


def test_a_frame_that_errs_does_not_clear_a_thing_of_another_tint(toy, black: Assembly) -> None:
    """Where it lay in all frames together its tint is another one; whatever name it goes by."""
    twins = UnlikeTwins(black, config=UnlikeTwinsConfig())
    green, errs = (frame(toy, 0, here=BLACK, there=there) for there in (GREEN, WARM))
    twins.see(green, {"pin": HERE, "pin-copy": HERE})
    for i in range(5):
        twins.strangers(replace(green, index=i), {"pin-copy": THERE})
    assert twins.strangers(replace(errs, index=5), {"pin-copy": THERE}) == {"pin-copy"}
    assert twins.strangers(replace(green, index=6), {"pin": THERE}) == {"pin"}
    later = [twins.strangers(replace(errs, index=i), {"pin-copy": THERE}) for i in range(7, 30)]
    assert later[-1] == frozenset(), "something else was put there"


def test_the_assemblys_colour_says_which_of_both_is_the_part(toy, black: Assembly) -> None:
    assert strangers(toy, black, here=PALE, there=BLACK) == frozenset()
    grey = {n: replace(p, color=np.full(3, 70, np.uint8)) for n, p in black.parts.items()}
    undecided = replace(black, parts=grey)
    assert strangers(toy, undecided, here=BLACK, there=PALE) == frozenset()


def test_what_is_hidden_says_nothing(toy, black: Assembly) -> None:
    twins = UnlikeTwins(black, config=UnlikeTwinsConfig())
    shot = frame(toy, 0, here=BLACK, there=PALE)
    twins.see(shot, {"pin": HERE})
    assert shot.depth is not None
    hidden = replace(shot, depth=np.full_like(shot.depth, 0.3))
    assert twins.strangers(hidden, {"pin-copy": THERE}) == frozenset()
    twins.rename({"pin": "pin-copy"})
    assert looked_at(twins, shot, {"pin": THERE}) == {"pin"}
    twins.forget(frozenset({"pin-copy"}))
    assert twins.strangers(shot, {"pin": THERE}) == frozenset()


def test_glimpses_between_which_a_part_looks_right_do_not_add_up(toy, black: Assembly) -> None:
    twins, poses = UnlikeTwins(black, config=UnlikeTwinsConfig()), {"pin-copy": THERE}
    right, shiny = (frame(toy, 0, here=BLACK, there=there) for there in (BLACK, PALE))
    twins.see(right, {"pin": HERE})
    for i in range(0, 20, 2):
        assert not twins.strangers(replace(shiny, index=i), poses)
        assert not twins.strangers(replace(right, index=i + 1), poses)
    assert shiny.depth is not None
    hidden = replace(shiny, depth=np.full_like(shiny.depth, 0.3))
    for i in range(20, 20 + 2 * UnlikeTwinsConfig().frames, 2):
        assert not twins.strangers(replace(shiny, index=i), poses)
        assert not twins.strangers(replace(hidden, index=i + 1), poses)
    assert twins.strangers(replace(shiny, index=40), poses) == {"pin-copy"}


def test_a_part_that_looks_right_elsewhere_does_not_speak_for_another_thing(
    toy, black: Assembly
) -> None:
    """The tracker has the part, and the detector proposes the thing in every frame."""
    twins = UnlikeTwins(black, config=UnlikeTwinsConfig())
    shot = frame(toy, 0, here=BLACK, there=PALE)
    twins.see(shot, {"pin": HERE})
    told: list[frozenset[str]] = []
    for i in range(UnlikeTwinsConfig().frames + 1):
        told.append(twins.strangers(replace(shot, index=i), {"pin-copy": THERE}))
        assert not twins.strangers(replace(shot, index=i), {"pin-copy": HERE})
    assert told[-1] == {"pin-copy"}


def test_what_moves_may_be_held_by_a_hand(toy, black: Assembly) -> None:
    twins = UnlikeTwins(black, config=UnlikeTwinsConfig())
    for i in range(10):
        at = transform_from(np.eye(3), np.array([0.02 + 0.02 * (i % 5), 0.02 * (i // 5), 0.6]))
        shot = frame(toy, i, here=BLACK, there=PALE, at=at)
        twins.see(shot, {"pin": HERE})
        assert twins.strangers(shot, {"pin-copy": at}) == frozenset()


@pytest.mark.usefixtures("small_models")
@pytest.mark.parametrize("method_name", ["asdf_track", "asdf_plus"])
@pytest.mark.parametrize("there", [PALE, SHADOW])
def test_a_pale_twin_is_let_go(
    toy, black: Assembly, detector, method_name: str, there: int
) -> None:
    """It is found first; then the black one is, and the pale one is proposed in vain."""
    method = STARTED[method_name](detector)
    shots = [frame(toy, i, here=BLACK, there=there) for i in range(20)]
    method.reset(black, shots[0].camera, None)
    base, here = toy.detection("base", BASE), toy.detection("pin", HERE)
    copy = toy.detection("pin-copy", THERE, score=0.6)
    said = []
    for i, shot in enumerate(shots):
        detector.answers[i] = (base, copy) if i < 4 else (base, copy, here)
        said.append(set(method.step(shot).poses) & {"pin", "pin-copy"})
    assert len(said[3]) == 1
    assert len(said[-1]) == (1 if there == PALE else 2)


@pytest.mark.parametrize(
    "wrong", [{"unlike": 0.0}, {"stranger": -0.5}, {"frames": 0}, {"tint": 0.0}]
)
def test_options_out_of_range_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match="unlike_twins"):
        UnlikeTwinsConfig(**wrong)  # type: ignore[arg-type]
