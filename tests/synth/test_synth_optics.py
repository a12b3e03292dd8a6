"""What the colour module adds: fringes, soft highlights, halo, thin colour."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.synth.optics import developed, fringed, rolled_off


def _edge(left: float, right: float) -> np.ndarray:
    image = np.full((40, 64, 3), left, np.float32)
    image[:, 32:] = right
    return image


def test_fringe_moves_red_out_and_blue_in() -> None:
    image = np.zeros((101, 101, 3), np.float32)
    image[88:93, 88:93] = 1.0
    out = fringed(image, 3.0)
    middle = [
        float((out[:, :, c].sum(0) * np.arange(101)).sum() / out[:, :, c].sum()) for c in range(3)
    ]
    assert middle[0] > middle[1] + 1 > middle[2] + 2
    assert np.allclose(out[:, :, 1], image[:, :, 1])


def test_sharpening_overshoots_at_edges_only() -> None:
    out = developed(_edge(0.3, 0.6), sharpening=0.8, halo_px=1.2, thin_px=0.0)
    assert out[20, 32].max() > 0.63
    assert out[20, 31].min() < 0.27
    assert np.allclose(out[20, 5], 0.3, atol=1e-4)


def test_colour_is_blurred_and_brightness_is_not() -> None:
    image = _edge(0.4, 0.4)
    image[:, 32:] = [0.7, 0.3, 0.1785]
    weights = np.array([0.299, 0.587, 0.114], np.float32)
    out = developed(image, sharpening=0.0, halo_px=1.2, thin_px=2.0)
    assert np.allclose(out @ weights, image @ weights, atol=2e-2)
    assert abs(out[20, 34, 0] - image[20, 34, 0]) > 0.02


def test_highlights_roll_off_and_the_rest_stays() -> None:
    gray = np.linspace(-0.2, 3, 321, dtype=np.float32)
    image = np.repeat(gray[None, :, None], 3, axis=2)
    before = image.copy()
    seen = rolled_off(image, 0.6)[0, :, 0]
    assert (image == before).all()
    assert (seen[gray <= 0.6] == gray[gray <= 0.6]).all()
    # A fifth more than full scale still is no pure white; twice as much light is.
    assert np.interp(1.2, gray, seen) < 250 / 255 < np.interp(2.1, gray, seen)
    assert seen.max() <= 1


@pytest.mark.parametrize(
    "color", [(1.0, 1.0, 1.0), (1.0, 0.7, 0.5), (0.1, 0.2, 1.0), (1.0, 0.0, 0.0)]
)
@pytest.mark.parametrize("knee", [0.5, 0.8])
def test_more_light_never_looks_darker_and_nothing_jumps(
    color: tuple[float, float, float], knee: float
) -> None:
    light = np.linspace(0, 2, 2001, dtype=np.float32)
    seen = rolled_off(light[None, :, None] * np.array(color, np.float32), knee)[0]
    steps = np.diff(seen, axis=0)
    assert steps.min() >= -1e-6
    assert steps.max() < 1.01 * np.diff(light).max()


def test_bright_colours_keep_much_of_their_hue() -> None:
    skin = np.broadcast_to(np.array([1.1, 0.8, 0.6], np.float32), (2, 2, 3))
    red, _, blue = rolled_off(skin, 0.65)[0, 0]
    assert 1.4 < red / blue < 1.1 / 0.6
