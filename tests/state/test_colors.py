from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.transforms import rotation_about
from asdfviz.state.colors import ColorConfig, Looks, color_features, color_ratio, look_of

UPRIGHT = np.eye(3)
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
        found.learn("cover", pixels(RED, seed=seed), around=pixels(GRAY), R_camera_part=UPRIGHT)
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
    looks.learn("pin", pixels(RED)[:5], around=pixels(GRAY), R_camera_part=UPRIGHT)
    looks.learn("pin", pixels(RED), around=pixels(GRAY), R_camera_part=UPRIGHT)
    assert looks.of("pin") is None
    for seed in range(2):
        assert looks.is_wanted("pin", UPRIGHT)
        looks.learn("pin", pixels(RED, seed=seed), around=pixels(GRAY), R_camera_part=UPRIGHT)
    assert looks.of("pin") is not None
    assert not looks.is_wanted("pin", UPRIGHT)
    assert look_of(color_features(pixels(RED)[:3])) is None


def test_a_few_frames_of_another_thing_do_not_change_a_look(looks: Looks) -> None:
    looks.learn("cover", pixels(BLUE), around=pixels(GRAY), R_camera_part=UPRIGHT)
    assert ratio(looks, "cover", pixels(RED, seed=5), ColorConfig()) > 1.0


def test_what_is_learnt_later_counts(looks: Looks) -> None:
    assert ratio(looks, "cover", pixels(BLUE), ColorConfig()) < 0
    assert looks.of("cover") is looks.of("cover")
    for seed in range(8):
        looks.learn("cover", pixels(BLUE, seed=seed), around=pixels(GRAY), R_camera_part=UPRIGHT)
    assert ratio(looks, "cover", pixels(BLUE, seed=9), ColorConfig()) > 1.0


def test_what_looks_like_the_table_beside_it_is_not_learnt() -> None:
    """A flat part whose pose is wrong: what is seen there is the table."""
    looks = Looks(config=ColorConfig())
    for seed in range(5):
        looks.learn(
            "rule",
            pixels(GRAY, seed=seed),
            around=pixels(GRAY, light=0.95, seed=9),
            R_camera_part=UPRIGHT,
        )
    assert looks.of("rule") is None


def turned(degrees: float) -> np.ndarray:
    return rotation_about(np.array([1.0, 0.0, 0.0]), np.deg2rad(degrees))


def test_a_part_that_lies_alike_is_learnt_a_few_times_alone() -> None:
    looks = Looks(config=ColorConfig(alike=3, frames=5))
    for seed in range(3):
        looks.learn("cover", pixels(RED, seed=seed), around=pixels(GRAY), R_camera_part=UPRIGHT)
    assert not looks.is_wanted("cover", UPRIGHT)
    assert not looks.is_wanted("cover", turned(20))
    assert looks.is_wanted("cover", turned(90))
    for seed in range(2):
        looks.learn("cover", pixels(RED, seed=seed), around=pixels(GRAY), R_camera_part=turned(90))
    assert not looks.is_wanted("cover", turned(45)), "there were enough frames in all"


def test_a_part_that_shone_otherwise_may_look_otherwise_again() -> None:
    """Turned to the light it was paler: another tint between, or beyond, is no longer ruled out."""
    pale, paler = (215, 120, 112), (225, 150, 145)
    once, twice = Looks(config=ColorConfig()), Looks(config=ColorConfig())
    for seed in range(4):
        for looks in (once, twice):
            looks.learn("cover", pixels(RED, seed=seed), around=pixels(GRAY), R_camera_part=UPRIGHT)
        twice.learn("cover", pixels(pale, seed=seed), around=pixels(GRAY), R_camera_part=turned(60))
    config = ColorConfig()
    assert ratio(once, "cover", pixels(paler, seed=9), config) == pytest.approx(-config.limit)
    assert ratio(twice, "cover", pixels(paler, seed=9), config) > -0.5
    assert ratio(twice, "cover", pixels(BLUE, seed=9), config) < -1.0
