from __future__ import annotations

import numpy as np
import pytest

from asdfviz.state.colors import color_features
from asdfviz.state.ground import GroundConfig, ground_around

SHAPE = (60, 80)


def tilted(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Depth of a tilted plane, exact and as measured."""
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]]
    exact = 1.0 / (1.8 + 0.002 * right - 0.003 * down)
    return exact, (exact + rng.normal(size=SHAPE) * 0.001).astype(np.float32)


def test_the_plane_is_found_beside_a_hand_and_under_the_group() -> None:
    rng = np.random.default_rng(0)
    exact, depth = tilted(rng)
    depth[10:30, :20] -= 0.12  # a hand
    around = np.ones(SHAPE, bool)
    around[20:45, 30:60] = False
    depth[20:45, 30:60] -= 0.03  # the group
    rgb = np.full((*SHAPE, 3), (40, 160, 60), np.uint8)
    rgb[10:30, :20] = (220, 170, 140)
    found = ground_around(depth, color_features(rgb), around, config=GroundConfig())
    assert found is not None
    assert np.abs(1 / found.inverse_depth - exact).max() < 0.001
    assert found.look is not None
    assert found.look.middle == pytest.approx(color_features(rgb[0, 70]), abs=1e-4)


def test_clutter_and_too_little_depth_are_no_ground() -> None:
    rng = np.random.default_rng(1)
    features = color_features(np.zeros((*SHAPE, 3), np.uint8))
    clutter = (0.5 + 0.1 * rng.random(SHAPE)).astype(np.float32)
    around = np.ones(SHAPE, bool)
    assert ground_around(clutter, features, around, config=GroundConfig()) is None
    _, depth = tilted(rng)
    depth[5:] = 0
    depth[:, 10:] = 0
    assert ground_around(depth, features, around, config=GroundConfig()) is None
