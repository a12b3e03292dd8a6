from __future__ import annotations

import numpy as np
import pytest

from asdfviz.synth.sensor import (
    RgbSensor,
    blur_moving,
    motion_kernel,
    photograph,
    random_rgb_sensor,
)

HEIGHT, WIDTH = 180, 320


def test_exposure_brings_the_picture_to_its_level_whatever_the_light() -> None:
    radiance = np.random.default_rng(0).uniform(0.2, 1.0, (HEIGHT, WIDTH, 3)).astype(np.float32)
    sensor = RgbSensor(noise=0.0)
    dim, glaring = (
        photograph(radiance * np.float32(k), sensor=sensor, rng=np.random.default_rng(1))
        for k in (0.1, 30)
    )
    assert np.abs(dim.astype(int) - glaring.astype(int)).max() <= 1
    assert 100 < dim.mean() < 190


PART = np.s_[70:105, 145:170]


def white_part(table: float) -> np.ndarray:
    """Radiance of a small white part, lit from one side, on a table."""
    radiance = np.full((HEIGHT, WIDTH, 3), table, np.float32)
    radiance[PART] = np.linspace(0.4, 0.8, 35, dtype=np.float32)[:, None, None]
    return radiance


def burnt(radiance: np.ndarray, seed: int) -> float:
    """Share of the part's pixels that are pure white, as a drawn camera takes it."""
    rng = np.random.default_rng(seed)
    seen = photograph(radiance, sensor=random_rgb_sensor(rng), rng=rng)[PART]
    return float((seen.min(axis=2) >= 250).mean())


@pytest.mark.parametrize("table", [0.03, 0.12, 0.3])
def test_a_small_white_part_on_a_dark_table_keeps_its_shading(table: float) -> None:
    shares = np.array([burnt(white_part(table), seed) for seed in range(30)])
    assert (shares > 0.2).mean() < 0.1


def test_a_camera_over_exposes_now_and_then() -> None:
    drawn = [random_rgb_sensor(np.random.default_rng(k)).exposure for k in range(1000)]
    failed = np.flatnonzero(np.array(drawn) > 0.6)
    assert 0.02 < len(failed) / len(drawn) < 0.06
    assert np.mean([burnt(white_part(0.12), int(k)) for k in failed[:5]]) > 0.2


def test_motion_blur_keeps_light_and_the_still_part() -> None:
    assert abs(motion_kernel(7.0, -3.0).sum() - 1) < 1e-6
    radiance = np.full((60, 80, 3), 0.2, np.float32)
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    radiance[mask] = 1.0
    blurred = blur_moving(radiance, mask, (12.0, 0.0))
    assert np.allclose(blurred[5], 0.2)
    assert np.allclose(blurred[30, 40], 1.0, atol=1e-4)
    assert 0.3 < blurred[30, 30, 0] < 0.9
    assert np.allclose(blurred[30, 24:30, 0], 1.2 - blurred[30, 35:29:-1, 0], atol=0.12)


def test_noise_is_weak_in_the_dark_and_flare_lifts_black() -> None:
    radiance = np.full((HEIGHT, WIDTH, 3), 0.4, np.float32)
    radiance[:, :160] = 0.002
    plain, flared = (
        photograph(radiance, sensor=RgbSensor(flare=f, vignette=0.0), rng=np.random.default_rng(0))
        for f in (0.0, 0.08)
    )
    dark, light = plain[:, 20:140].astype(float), plain[:, 180:300].astype(float)
    assert dark.std() < 2.5 * light.std()
    assert flared[:, 20:140].mean() > dark.mean() + 10


def test_corners_may_lose_red_and_blue_beside_green() -> None:
    radiance = np.full((HEIGHT, WIDTH, 3), 0.3, np.float32)
    plain, shaded = (
        photograph(
            radiance,
            sensor=RgbSensor(vignette=0.0, noise=0.0, flare=0.0, shading=shading),
            rng=np.random.default_rng(0),
        ).astype(float)
        for shading in ((0.0, 0.0), (-0.1, 0.3))
    )
    assert np.ptp(plain, axis=(0, 1)).max() <= 1
    red, green, blue = (shaded[:4, :4] - shaded[HEIGHT // 2, WIDTH // 2]).mean(axis=(0, 1))
    assert red > 3
    assert abs(green) <= 1
    assert blue < -10


def test_light_glows_into_the_dark_beside_it_and_no_farther() -> None:
    radiance = np.full((40, 1280, 3), 0.02, np.float32)
    radiance[:, :640] = 0.6
    sharp, glowing = (
        photograph(
            radiance,
            sensor=RgbSensor(noise=0.0, vignette=0.0, flare=0.0, glow=glow),
            rng=np.random.default_rng(1),
        )[20, :, 1].astype(int)
        for glow in (0.0, 0.05)
    )
    beside, away = 643, 680
    assert glowing[beside] >= sharp[beside] + 2
    assert abs(glowing[away] - sharp[away]) <= 1
