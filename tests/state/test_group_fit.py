"""Scenes of analytic boxes: a base plate, and a block on it that one state has and the other not."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.errors import MethodError
from asdfviz.state.group_fit import (
    Drawn,
    GroupFitConfig,
    Measured,
    Move,
    Said,
    best_spoken,
    nearer_by,
    probabilities,
    spoken,
    trusted,
)

SHAPE = (60, 70)
GROUND, PLATE, BLOCK = 0.60, 0.58, 0.55
CONFIG = GroupFitConfig()
CELL = 0.002
PLATE_AT = (slice(15, 45), slice(15, 55))
BLOCK_AT = (slice(22, 36), slice(25, 41))


def scene(*, with_block: bool) -> Drawn:
    depth = np.full(SHAPE, np.inf)
    ids = np.full(SHAPE, -1, np.int32)
    depth[PLATE_AT], ids[PLATE_AT] = PLATE, 0
    if with_block:
        depth[BLOCK_AT], ids[BLOCK_AT] = BLOCK, 1
    return Drawn((1 / depth).astype(np.float32), ids)


def seen(
    scene: Drawn, *, noise: float = 0.0, colors: bool = False, nearer: float = 0.0
) -> tuple[np.ndarray, Measured]:
    """The scene's depth on the ground, and it as measured; with colours every cell shows its own part."""
    rng = np.random.default_rng(3)
    depth = np.where(scene.ids < 0, GROUND, 1 / np.maximum(scene.inverse_depth, 1e-6) - nearer)
    depth = (depth + noise * rng.normal(size=SHAPE)).astype(np.float32)
    ratios = np.zeros((3, *SHAPE), np.float32)
    if colors:
        shown = np.where(scene.ids < 0, 2, scene.ids)
        ratios = np.where(shown[None] == np.arange(3)[:, None, None], 2.5, -2.5).astype(np.float32)
    ground = np.full(SHAPE, 1 / GROUND, np.float32)
    return depth, Measured(depth, ratios, ground, np.zeros(ratios.shape, bool))


def without_and_with(measured: Measured, **options) -> np.ndarray:
    values = [
        best_spoken(scene(with_block=b), measured, nearer=0.0, config=CONFIG, **STEPS)[0].value
        for b in (False, True)
    ]
    return probabilities([trusted(CELL, config=CONFIG) * value for value in values])


STEPS = {"steps": ((1.0, 0.0),), "rounds": 2}


@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize("is_there", [False, True])
def test_the_state_that_explains_the_readings_is_found(is_there: bool, noise: float) -> None:
    _, measured = seen(scene(with_block=is_there), noise=noise)
    assert without_and_with(measured)[int(is_there)] > 0.99


@pytest.mark.parametrize("hidden_by", ["hand", "no depth"])
def test_what_is_hidden_or_not_measured_says_nothing(hidden_by: str) -> None:
    depth, measured = seen(scene(with_block=True))
    depth[18:42, 20:48] = 0.45 if hidden_by == "hand" else 0.0
    assert without_and_with(measured) == pytest.approx([0.5, 0.5], abs=0.02)


def test_half_hidden_is_enough() -> None:
    depth, measured = seen(scene(with_block=False))
    depth[:, :33] = 0.4
    assert without_and_with(measured)[0] > 0.95


def test_a_block_too_flat_for_depth_is_told_by_its_colour() -> None:
    def flat(*, with_block: bool) -> Drawn:
        one = scene(with_block=with_block)
        depth = np.where(one.ids == 1, PLATE - 0.002, 1 / np.maximum(one.inverse_depth, 1e-6))
        return Drawn((1 / depth).astype(np.float32) * (one.ids >= 0), one.ids)

    for is_there in (False, True):
        for colors in (False, True):
            _, measured = seen(flat(with_block=is_there), noise=0.003, colors=colors)
            values = [
                trusted(CELL, config=CONFIG)
                * spoken(flat(with_block=b), measured, nearer=0.0, config=CONFIG).value
                for b in (False, True)
            ]
            sure = probabilities(values)[int(is_there)]
            assert (sure > 0.99) if colors else (0.05 < sure < 0.95)


def test_a_scene_a_little_aside_and_nearer_is_still_the_state() -> None:
    true = scene(with_block=True)
    aside = Drawn(
        np.ascontiguousarray(np.roll(true.inverse_depth, (1, -2), (0, 1))),
        np.ascontiguousarray(np.roll(true.ids, (1, -2), (0, 1))),
    )
    depth, measured = seen(aside, noise=0.002, nearer=0.004)
    nearer = nearer_by(true.inverse_depth, depth, config=CONFIG)
    assert nearer == pytest.approx(0.004, abs=0.001)
    said, move = best_spoken(true, measured, nearer=nearer, config=CONFIG, **STEPS)
    assert move == Move(-2.0, 1.0)
    assert said.agreeing > 0.98 * said.visible
    without, _ = best_spoken(
        scene(with_block=False), measured, nearer=nearer, config=CONFIG, **STEPS
    )
    assert said.value > without.value + 100


def test_a_turned_scene_is_turned_back() -> None:
    true = scene(with_block=True)
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]]
    x, y = right - (SHAPE[1] - 1) / 2, down - (SHAPE[0] - 1) / 2
    c, s = np.cos(0.1), np.sin(0.1)
    columns = np.rint(c * x + s * y + (SHAPE[1] - 1) / 2).astype(int).clip(0, SHAPE[1] - 1)
    rows = np.rint(c * y - s * x + (SHAPE[0] - 1) / 2).astype(int).clip(0, SHAPE[0] - 1)
    turned = Drawn(true.inverse_depth[rows, columns], true.ids[rows, columns])
    _, measured = seen(turned)
    _, move = best_spoken(true, measured, nearer=0.0, config=CONFIG, steps=((1.0, 0.05),), rounds=3)
    assert move == Move(0.0, 0.0, 0.1)


def test_the_counts_tell_how_much_is_seen() -> None:
    depth, measured = seen(scene(with_block=True))
    depth[:, :35] = 0.4
    said = spoken(scene(with_block=True), measured, nearer=0.0, config=CONFIG)
    assert (said.drawn, said.visible, said.agreeing) == (1200, 600, 600)
    assert (said.base_drawn, said.base_visible, said.base_agreeing) == (976, 516, 516)
    assert said.is_seen(visible=0.4, agreeing=0.9)
    assert not said.is_seen(visible=0.6, agreeing=0.9)
    depth[PLATE_AT] = np.where(scene(with_block=True).ids[PLATE_AT] == 0, 0.66, depth[PLATE_AT])
    through = spoken(scene(with_block=True), measured, nearer=0.0, config=CONFIG)
    assert not through.is_seen(visible=0.1, agreeing=0.01)  # the block is there, the base is not
    nothing = spoken(
        scene(with_block=True), Measured(depth * 0, *_rest(measured)), nearer=0.0, config=CONFIG
    )
    assert not nothing.is_seen(visible=0.0, agreeing=0.0)


def _rest(measured: Measured) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return measured.ratios, measured.ground, measured.swallowed


def test_behind_black_plastic_that_is_seen_nothing_is_read() -> None:
    """The block is there, but what is read lies behind it; by its colour it may have swallowed the light."""
    with_block, without = scene(with_block=True), scene(with_block=False)
    depth, measured = seen(without)
    assert (depth[BLOCK_AT] > BLOCK).all()
    against = spoken(with_block, measured, nearer=0.0, config=CONFIG)
    measured.swallowed[1][BLOCK_AT] = True
    silent = spoken(with_block, measured, nearer=0.0, config=CONFIG)
    assert against.value < silent.value
    block = int(np.count_nonzero(with_block.ids == 1))
    assert silent.drawn - silent.visible == block
    assert silent.agreeing == silent.visible


def test_a_base_that_its_group_hides_is_only_known_to_be_where_it_was() -> None:
    hidden = Said(9.0, 400, 300, 280, base_drawn=40, base_visible=2, base_agreeing=1)
    assert not hidden.is_seen(visible=0.2, agreeing=0.5)
    assert hidden.is_seen(visible=0.2, agreeing=0.5, rests=True)
    # What shows of it must agree all the same.
    elsewhere = Said(9.0, 400, 300, 280, base_drawn=40, base_visible=2, base_agreeing=0)
    assert not elsewhere.is_seen(visible=0.2, agreeing=0.5, rests=True)


@pytest.mark.parametrize(
    "wrong", [{"sigma": 0.0}, {"patch": np.nan}, {"least_visible": 1.2}, {"near": -0.1}]
)
def test_options_out_of_range_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match=rf"group_fit\.{next(iter(wrong))} is .*, use"):
        GroupFitConfig(**wrong)  # pyright: ignore[reportArgumentType]
