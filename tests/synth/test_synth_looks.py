"""What makes the surfaces look real: folds, pale corners, smooth hands, a lens soft in its corners."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from jaxtyping import Float64

from asdfviz.geometry.shapes import Points
from asdfviz.synth.implicit import mesh_implicit
from asdfviz.synth.patterns import MACRO
from asdfviz.synth.sensor import RgbSensor, metered, photograph
from asdfviz.synth.shading import interreflected


def test_folds_of_the_drape_are_steps_of_slope_along_whole_lines() -> None:
    height = MACRO["drape"](np.random.default_rng(3), 512)[:, :, 3]
    slope = np.gradient(height, 1 / 512, axis=1)
    # Folds run along the rows' normal: what they share over a hundred rows stands out of the rest.
    shared = slope[200:300].mean(axis=0)
    step = np.abs(shared[6:] - shared[:-6])
    assert step.max() > 0.1
    assert step.max() > 5 * np.median(step)


def test_the_drape_strays_slowly_in_hue_and_tone() -> None:
    drape = MACRO["drape"](np.random.default_rng(4), 256)
    hue = cv2.GaussianBlur(drape[:, :, 0], (0, 0), 6)
    assert hue.std() > 0.08
    assert 0.02 < drape[:, :, 2].std() < 0.12


@pytest.mark.parametrize("visible", [0.2, 0.5, 0.8])
def test_pale_corners_lose_less_light_than_dark_ones(visible: float) -> None:
    seen = torch.full((1, 1, 1, 1), visible)
    black, white = (interreflected(seen, torch.full((1, 1, 1, 3), a)).mean() for a in (0.02, 0.9))
    assert float(black) == pytest.approx(visible, abs=0.12)
    assert visible + 0.08 < float(white) <= 1.0


def test_meshes_of_implicit_surfaces_lie_on_them() -> None:
    def ball(points: Points) -> Float64[np.ndarray, "n"]:
        return np.linalg.norm(points, axis=1) - 0.02

    mesh = mesh_implicit(ball, np.full(3, -0.03), np.full(3, 0.03), step=0.006)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.02).max() < 1e-4


def _contrast(image: np.ndarray, row: int, column: int) -> float:
    return float(image[row - 8 : row + 8, column - 8 : column + 8].std())


def test_a_soft_lens_blurs_corners_and_keeps_the_middle() -> None:
    y, x = np.mgrid[0:180, 0:320]
    board = np.repeat((0.2 + 0.3 * ((x + y) % 4 < 2))[:, :, None], 3, axis=2).astype(np.float32)
    lens = RgbSensor(exposure=metered(board), noise=0.0, vignette=0.0)
    sharp, soft = (
        photograph(board, sensor=replace(lens, softness_px=px), rng=np.random.default_rng(0))
        for px in (0.0, 6.0)
    )
    assert _contrast(soft, 90, 160) > 0.95 * _contrast(sharp, 90, 160)
    assert _contrast(soft, 10, 10) < 0.5 * _contrast(sharp, 10, 10)


def test_metered_light_is_left_as_it_is() -> None:
    gray = np.full((90, 160, 3), 0.3, np.float32)
    sensor = RgbSensor(exposure=metered(gray), noise=0.0, vignette=0.0, flare=0.0)
    image = photograph(gray, sensor=sensor, rng=np.random.default_rng(0))
    assert image[45, 80, 0] == pytest.approx(255 * 0.3 ** (1 / 2.2), abs=1)
