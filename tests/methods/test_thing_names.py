from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, Detection, Frame
from asdfviz.errors import MethodError
from asdfviz.methods.thing_names import NamesConfig, ThingNames

CAMERA = Camera(np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]), 320, 240)
CLASSES = ("toy/base", "toy/block", "toy/pin")


@pytest.fixture
def looker(namer: Callable) -> Any:
    """Says that what lies left of the middle is a pin, and knows nothing else."""
    return namer(lambda name, box: (0.9 if box[0] < 160 else 0.05) * (name == "toy/pin"))


def frame_with(*blobs: tuple[int, int]) -> Frame:
    """A table at 0.6 m with things of 24 px that stand 2 cm high at (x, y)."""
    depth = np.full((240, 320), 0.6, np.float32)
    for x, y in blobs:
        depth[y : y + 24, x : x + 24] = 0.58
    return Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), depth, CAMERA)


def told(names: ThingNames, *detections: Detection) -> tuple[Detection, ...]:
    names.begin()
    return names.told(frame_with(), detections)


def test_both_networks_are_heard(assembly: Assembly, box_at: Callable, looker: Any) -> None:
    names = ThingNames(assembly, looker, config=NamesConfig(weight=0.5))
    box = replace(box_at("block", 20, score=0.4), class_scores={"pin": 0.1})
    state = box_at("toy:block", 20)
    (named, same) = told(names, box, state)
    assert same is state
    assert looker.asked_of == {CLASSES}
    assert looker.distances == pytest.approx([0.6])
    assert named.score == pytest.approx(0.2)
    assert named.class_scores == pytest.approx({"base": 0.0, "block": 0.2, "pin": 0.5})


def test_the_network_does_not_speak_against_a_part_that_it_does_not_know(
    assembly: Assembly, box_at: Callable, looker: Any
) -> None:
    looker.classes = ("toy/base", "toy/pin", "other/block")
    names = ThingNames(assembly, looker, config=NamesConfig(weight=0.5))
    box = replace(box_at("block", 220, score=0.4), class_scores={"pin": 0.1})
    (named,) = told(names, box)
    assert looker.asked_of == {("toy/base", "toy/pin")}
    assert named.score == 0.4
    assert named.class_scores == pytest.approx({"base": 0.0, "block": 0.4, "pin": 0.075})
    looker.classes = ("other/block",)
    names = ThingNames(assembly, looker, config=NamesConfig())
    assert told(names, box) == (box,)
    assert names.beyond(frame_with((30, 40)), (), {}) == ()


def test_what_lies_still_is_looked_at_now_and_then(
    assembly: Assembly, box_at: Callable, looker: Any
) -> None:
    names = ThingNames(assembly, looker, config=NamesConfig(every=4))
    for _ in range(10):
        (named,) = told(names, box_at("pin", 20))
        assert named.score == pytest.approx(0.7)
    assert len(looker.asked) == 4, "twice at first, then every fourth frame"
    told(names, box_at("pin", 60))
    assert len(looker.asked) == 5, "what moved is new"


def test_what_no_box_is_about_is_named_where_it_is_surely_a_part(
    assembly: Assembly, box_at: Callable, looker: Any
) -> None:
    names = ThingNames(assembly, looker, config=NamesConfig())
    found = {"base": box_at("base", 98, 98, score=0.9)}
    names.begin()
    more = names.beyond(frame_with((30, 40), (100, 100), (220, 40)), (), found)
    (pin,) = more
    assert (pin.label, pin.score) == ("pin", pytest.approx(0.45))
    np.testing.assert_allclose(pin.box_xyxy, [30, 40, 54, 64], atol=3)
    assert pin.keypoints_px.shape == (17, 2)
    assert names.beyond(replace(frame_with((30, 40)), depth=None), (), found) == ()


@pytest.mark.parametrize("config", [NamesConfig(enabled=False), NamesConfig()])
def test_a_network_without_names_changes_nothing(
    assembly: Assembly, box_at: Callable, looker: Any, config: NamesConfig
) -> None:
    looker.tells_names = not config.enabled
    for mute in (looker, None):
        names = ThingNames(assembly, mute, config=config)
        box = box_at("block", 20)
        assert told(names, box) == (box,)
        assert names.beyond(frame_with((30, 40)), (box,), {}) == (box,)


@pytest.mark.parametrize("wrong", [{"weight": 1.5}, {"every": 0}])
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match="weight must be"):
        NamesConfig(**wrong)
