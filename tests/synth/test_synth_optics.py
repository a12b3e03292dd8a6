"""What the colour module adds: fringes, halo, thin colour."""

from __future__ import annotations

import numpy as np

from asdfviz.synth.optics import developed, fringed


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
