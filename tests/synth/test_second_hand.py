"""Hands that do not carry: nothing lies where they hide it for good, nor where they are."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.grasping import hand_points, scaled
from asdfviz.synth.hands import OPEN_HAND
from asdfviz.synth.layout import Table, dress
from asdfviz.synth.penetration import depth, solid_of
from asdfviz.synth.render import render
from asdfviz.synth.second_hand import unhidden
from asdfviz.synth.sequences import condition_config, plan_sequence
from asdfviz.synth.studio import Studio

SEEN = 0.5
SEEN_OF_HELD = 0.7


@pytest.fixture(scope="module")
def clamp() -> Assets:
    return load_assets(load_assembly("corner_clamp"))


@pytest.mark.parametrize("seed", [7_100_001, 7_000_003])
def test_loose_parts_are_seen_and_free_under_hands(
    clamp: Assets, seed: int, unchecked: Callable[[], AbstractContextManager[None]]
) -> None:
    config = condition_config("hand", width=320, height=180, frames_per_state=12)
    with unchecked():
        play = plan_sequence(clamp, seed=seed, config=config)
    assert len(play.others) == 2
    first = Studio.of(play, clamp, seed=seed, config=config).scene(0.0).scene
    picture = render([first], clamp.bank, rng=np.random.default_rng(0))[0]
    for place, thing in enumerate(first.placed):
        if thing.truth:
            least = SEEN_OF_HELD if thing.name == clamp.assembly.base else SEEN
            assert int((picture.ids == place).sum()) >= least * int(picture.silhouette_px[place])
    holding, hovering = play.others
    at_hand = apply(
        scaled(holding.T_world_hand[0], holding.outfit), hand_points(holding.outfit.grasp)
    )
    for name, T in play.stage.T_world_part.items():
        solid = solid_of(clamp.assembly.parts[name].mesh)
        assert depth(apply(inverse(T), at_hand), solid) <= 0.005
    # It comes in: what it hides at last is seen before.
    ways = (
        np.stack([T[:2, 3] for T in hovering.T_world_hand]) - play.stage.stand.T_world_base[:2, 3]
    )
    distances = np.linalg.norm(ways, axis=1)
    assert distances[0] > distances[20:].max()


def test_a_hand_rather_hides_some_of_the_base_than_all_of_a_small_part() -> None:
    looking_down = np.diag([1.0, -1.0, -1.0, 1.0])
    looking_down[2, 3] = 0.6
    table = Table(np.diag([600.0, 600.0, 1.0]), looking_down, 640, 360, reach=0.4)
    rng = np.random.default_rng(0)
    base = np.column_stack(
        [rng.uniform(-0.2, 0.2, 4000), rng.uniform(-0.1, 0.1, 4000), [0.0] * 4000]
    )
    small = np.column_stack([0.3 + rng.uniform(-0.01, 0.01, (100, 2)), [0.0] * 100])
    small[:, 1] -= 0.3
    hand = dress(rng, grasp=OPEN_HAND)
    over_base, over_small, aside = (np.eye(4) for _ in range(3))
    over_base[:3, 3], over_small[:3, 3], aside[:3, 3] = (
        (0, 0, 0.1),
        (0.3, 0.03, 0.1),
        (0, -0.5, 0.1),
    )
    poses = np.stack([over_base, over_small, aside])
    grasps = np.full(3, OPEN_HAND)
    of_base, of_small, of_nothing = unhidden(
        [base, small], looking_down, table, hand, poses, grasps
    )
    whole = unhidden([np.concatenate([base, small])], looking_down, table, hand, poses, grasps)
    assert whole[0] < whole[1] < whole[2]
    assert of_small < of_base < of_nothing
