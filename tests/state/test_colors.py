from __future__ import annotations

import numpy as np
import pytest

from asdfviz.state.colors import ColorConfig, Looks, color_features, color_ratio, look_of

RED, BLUE, GRAY = (200, 40, 30), (30, 60, 190), (120, 120, 120)


def pixels(color: tuple[int, int, int], *, light: float = 1.0, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=(60, 3)) * 3
    return np.clip(np.array(color) * light + noise, 0, 255).astype(np.uint8)


def ratio(looks: Looks, name: str, rgb: np.ndarray, config: ColorConfig) -> float:
    look = looks.of(name)
    assert look is not None
    return float(color_ratio(look, color_features(rgb)[None], config=config).mean())


@pytest.fixture
def looks() -> Looks:
    found = Looks(config=ColorConfig())
    for seed in range(3):
        found.learn("cover", pixels(RED, seed=seed), around=pixels(GRAY))
    return found


@pytest.mark.parametrize("light", [1.0, 0.7, 1.2])
def test_a_colour_is_known_again_in_other_light(looks: Looks, light: float) -> None:
    config = ColorConfig()
    assert ratio(looks, "cover", pixels(RED, light=light, seed=9), config) > 1.0
    for other in (BLUE, GRAY):
        said = ratio(looks, "cover", pixels(other, light=light), config)
        assert said == pytest.approx(-config.limit)


def test_what_was_hardly_seen_has_no_look() -> None:
    looks = Looks(config=ColorConfig(least_frames=2, frames=3))
    looks.learn("pin", pixels(RED)[:5], around=pixels(GRAY))
    looks.learn("pin", pixels(RED), around=pixels(GRAY))
    assert looks.of("pin") is None
    for seed in range(2):
        assert looks.is_wanted("pin")
        looks.learn("pin", pixels(RED, seed=seed), around=pixels(GRAY))
    assert looks.of("pin") is not None
    assert not looks.is_wanted("pin")
    assert look_of(color_features(pixels(RED)[:3])) is None


def test_a_few_frames_of_another_thing_do_not_change_a_look(looks: Looks) -> None:
    looks.learn("cover", pixels(BLUE), around=pixels(GRAY))
    assert ratio(looks, "cover", pixels(RED, seed=5), ColorConfig()) > 1.0


def test_what_is_learnt_later_counts(looks: Looks) -> None:
    assert ratio(looks, "cover", pixels(BLUE), ColorConfig()) < 0
    assert looks.of("cover") is looks.of("cover")
    for seed in range(8):
        looks.learn("cover", pixels(BLUE, seed=seed), around=pixels(GRAY))
    assert ratio(looks, "cover", pixels(BLUE, seed=9), ColorConfig()) > 1.0


def test_what_looks_like_the_table_beside_it_is_not_learnt() -> None:
    """A flat part whose pose is wrong: what is seen there is the table."""
    looks = Looks(config=ColorConfig())
    for seed in range(5):
        looks.learn("rule", pixels(GRAY, seed=seed), around=pixels(GRAY, light=0.95, seed=9))
    assert looks.of("rule") is None
