"""A held part whose colours were learnt on another thing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.held_colors import HeldConfig
from asdfviz.methods.part_tracks import PartTracks
from asdfviz.methods.refinding import RefindConfig
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.track.presets import PROPOSED

pytestmark = pytest.mark.usefixtures("small_models", "shapes_unchecked")

BLOCK = transform_from(np.eye(3), np.array([-0.15, -0.05, 0.6]))
ORANGE, GREEN = (220, 120, 20), (40, 190, 90)


def _frame(toy, index: int, color: tuple[int, int, int], *, nearer: float = 0.0) -> Frame:
    """The block in a colour; something flat before it, if that is nearer than nothing."""
    depth = toy.depth({"block": BLOCK})
    rgb = np.where((depth < 0.7)[:, :, None], color, (110, 115, 120))
    noise = np.random.default_rng(index).normal(size=rgb.shape) * 3
    shown = np.clip(rgb + noise, 0, 255).astype(np.uint8)
    return replace(toy.frame(index), rgb=shown, depth=(depth - nearer).astype(np.float32))


def _scores(
    toy, *, joined: bool, nearer: float = 0.0, config: HeldConfig | None = None
) -> list[float]:
    """Of a block that was followed on something green, and then is orange, frame by frame."""
    parts = PartTracks(
        toy.assembly,
        toy.frame(0).camera,
        tracker=PROPOSED,
        refind=RefindConfig(held=config or HeldConfig()),
        turns=TurnConfig(),
    )
    parts.begin(_frame(toy, 0, GREEN), {"block": BLOCK})
    for index in range(1, 4):
        parts.settle(_frame(toy, index, GREEN), frozenset())
    held = frozenset({"block"}) if joined else frozenset[str]()
    scores: list[float] = []
    for index in range(4, 12):
        frame = _frame(toy, index, ORANGE, nearer=nearer)
        said = parts.settle(frame, held)
        scores.append(said["block"].score if "block" in said else 0.0)
    return scores


def test_its_colors_are_learnt_anew_once_depth_has_it_there_for_some_frames(toy) -> None:
    scores = _scores(toy, joined=True)
    wait = HeldConfig().frames
    assert max(scores[:wait]) < 0.5
    assert min(scores[wait + 1 :]) > 0.8


def test_what_the_state_does_not_hold_keeps_its_colors(toy) -> None:
    assert max(_scores(toy, joined=False)) < 0.5


def test_where_depth_has_something_else_nothing_is_learnt(toy) -> None:
    assert max(_scores(toy, joined=True, nearer=0.015)) < 0.5


def test_whoever_asks_for_more_frames_waits_longer(toy) -> None:
    assert max(_scores(toy, joined=True, config=HeldConfig(frames=20))) < 0.5


@pytest.mark.parametrize("wrong", [{"seen": 0.0}, {"seen": 1.5}, {"unlike": -0.1}, {"frames": 0}])
def test_options_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match=r"refind\.held"):
        HeldConfig(**wrong)  # pyright: ignore[reportArgumentType]
