from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, Detection, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import box_middle
from asdfviz.geometry.shapes import Box
from asdfviz.methods.named_nearby import NamedNearby, NearbyConfig
from asdfviz.methods.thing_names import NamesConfig, ThingNames

CAMERA = Camera(np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]), 320, 240)
NOWHERE_FLAT = np.random.default_rng(0).uniform(0.46, 0.54, (240, 320)).astype(np.float32)
FRAME = Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), NOWHERE_FLAT, CAMERA)
"""30 mm are about 18 px; there is no table."""


@dataclass
class Block:
    """A block that moves over the picture, and a network that names it the surer the better it is cut out."""

    at: np.ndarray = field(default_factory=lambda: np.array([100.0, 100.0]))
    plain: float = 1.0
    """How sure the network is of it at most."""
    name: str = "toy/block"

    def named(self, name: str, box: Box) -> float:
        off = float(np.linalg.norm(box_middle(box) - self.at))
        return self.plain * max(1 - off / 20, 0.0) * (name == self.name)


@pytest.fixture
def block() -> Block:
    return Block()


@pytest.fixture
def looker(namer: Callable, block: Block) -> Any:
    return namer(block.named)


@pytest.fixture
def nearby(assembly: Assembly, looker: Any) -> Callable[..., NamedNearby]:
    def make(**options: Any) -> NamedNearby:
        names = ThingNames(assembly, looker, config=NamesConfig())
        return NamedNearby(assembly, names, config=NearbyConfig(**options))

    return make


def step(
    nearby: NamedNearby, found: Mapping[str, Detection], frame: Frame = FRAME
) -> list[Detection]:
    """A frame in which the detector finds parts; what is found besides is kept with them."""
    nearby.begin()
    more = nearby.boxes(frame, found)
    nearby.keep({**found, **{d.label: d for d in more}}, frame)
    return more


def test_a_part_that_no_box_is_about_is_followed(
    nearby: Callable[..., NamedNearby], block: Block, box_at: Callable
) -> None:
    looking = nearby()
    assert step(looking, {"block": box_at("block", 90, 90)}) == []
    for _ in range(6):
        block.at = block.at + np.array([9.0, -5.0])
        (found,) = step(looking, {})
        assert found.label == "block"
        assert found.score > 0.4, "half of what the network says, as for any box"
        np.testing.assert_allclose(box_middle(found.box_xyxy), block.at, atol=3)


def test_what_is_not_named_surely_is_nothing(
    nearby: Callable[..., NamedNearby], block: Block, box_at: Callable
) -> None:
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)})
    block.plain = 0.45
    assert step(looking, {}) == []


def test_a_hand_reaches_so_far_and_no_farther(
    nearby: Callable[..., NamedNearby], block: Block, box_at: Callable
) -> None:
    block.at = np.array([160.0, 100.0])
    for reach, count in ((0.01, 0), (0.1, 1)):
        looking = nearby(reach=reach, most=1000)
        step(looking, {"block": box_at("block", 90, 90)})
        assert len(step(looking, {})) == count


def test_a_weak_box_far_away_does_not_end_the_search(
    nearby: Callable[..., NamedNearby], box_at: Callable
) -> None:
    far = {"block": box_at("block", 250, 20, score=0.3)}
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)})
    for _ in range(3):
        (found,) = step(looking, far)
        np.testing.assert_allclose(box_middle(found.box_xyxy), [100, 100], atol=3)
    sure = {"block": box_at("block", 250, 20, score=0.6)}
    assert step(looking, sure) == []


def test_a_box_that_is_hardly_the_parts_is_doubted_where_it_was_too(
    nearby: Callable[..., NamedNearby], box_at: Callable
) -> None:
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)})
    assert len(step(looking, {"block": box_at("block", 95, 95, score=0.1)})) == 1
    assert step(looking, {"block": box_at("block", 95, 95, score=0.3)}) == []


def test_what_is_in_another_parts_box_is_that_one(
    nearby: Callable[..., NamedNearby], box_at: Callable
) -> None:
    looking = nearby(taken=0.0)
    step(looking, {"block": box_at("block", 90, 90)})
    large = replace(box_at("base", 0), box_xyxy=np.array([50.0, 50, 150, 150]))
    assert step(looking, {"base": large}) == []


def test_it_is_forgotten_in_time(nearby: Callable[..., NamedNearby], box_at: Callable) -> None:
    looking = nearby(remembered=2)
    step(looking, {"block": box_at("block", 90, 90)})
    for _ in range(2):
        looking.begin()
    assert len(looking.boxes(FRAME, {})) == 1
    looking.begin()
    assert looking.boxes(FRAME, {}) == []


def test_nothing_is_found_without_depth_or_a_network_for_names(
    nearby: Callable[..., NamedNearby], looker: Any, box_at: Callable
) -> None:
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)})
    assert step(looking, {}, replace(FRAME, depth=None)) == []
    looker.tells_names = False
    looker.asked.clear()
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)})
    assert step(looking, {}) == []


def test_of_identical_parts_none_is_looked_for(
    nearby: Callable[..., NamedNearby], assembly: Assembly, block: Block, box_at: Callable
) -> None:
    assert assembly.parts["pin"].detector_class == assembly.parts["pin-copy"].detector_class
    block.name = "toy/pin"
    looking = nearby()
    step(looking, {"pin": box_at("pin", 90, 90)})
    assert step(looking, {}) == []


def test_bare_table_is_no_part_whatever_it_is_called(
    nearby: Callable[..., NamedNearby], box_at: Callable
) -> None:
    depth = np.full((240, 320), 0.5, np.float32)
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)}, replace(FRAME, depth=depth))
    assert step(looking, {}, replace(FRAME, depth=depth)) == []
    depth = depth.copy()
    depth[92:108, 92:108] = 0.48
    assert len(step(looking, {}, replace(FRAME, depth=depth))) == 1
    depth[92:108, 92:108] = 0.0
    looking = nearby()
    step(looking, {"block": box_at("block", 90, 90)}, replace(FRAME, depth=depth))
    assert len(step(looking, {}, replace(FRAME, depth=depth))) == 1, "nobody knows"


def test_looks_are_counted(
    nearby: Callable[..., NamedNearby], block: Block, looker: Any, box_at: Callable
) -> None:
    looking = nearby(most=10)
    step(looking, {"block": box_at("block", 90, 90), "base": box_at("base", 200, 200)})
    block.at = np.array([20.0, 20.0])
    looker.asked.clear()
    step(looking, {})
    assert sum(looker.asked) <= 2 + 10
    looker.asked.clear()
    step(nearby(enabled=False), {})
    assert not looker.asked


@pytest.mark.parametrize(
    "wrong",
    [{"step": 0.0}, {"reach": -0.1}, {"reach": float("nan")}, {"promising": 0.6}, {"least": 1.5}],
)
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"names\.nearby"):
        NearbyConfig(**wrong)
