"""A narrow part whose depth is smeared full: its colours still say where it is."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.shapes import Mask, Rgb
from asdfviz.methods.color_odds import mean_odds
from asdfviz.methods.drawn_colors import divided_so

BLUE, SHADED, YELLOW, SHADOW = (40, 60, 150), (16, 24, 60), (200, 190, 30), (100, 95, 15)
NOWHERE = np.zeros((60, 60), bool)


def fork() -> Mask:
    """Two prongs and what joins them."""
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:26] = mask[20:40, 34:40] = mask[34:40, 20:40] = True
    return mask


def block() -> Mask:
    """The fork with its gap filled."""
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:40] = True
    return mask


def picture(part: Mask, *, gap: tuple[int, int, int] = SHADOW) -> Rgb:
    """The part, one side of it in the dark, on a table on which a shadow lies."""
    rgb = np.tile(np.array(YELLOW, np.uint8), (60, 60, 1))
    rgb[:, 40:] = SHADOW
    rgb[block()] = gap
    rgb[part] = BLUE
    rgb[:, 30:][part[:, 30:]] = SHADED
    noise = np.random.default_rng(1).normal(0, 4, rgb.shape)
    return np.clip(rgb + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gap", [YELLOW, SHADOW])
def test_what_is_behind_a_part_shows_in_its_gap(gap: tuple[int, int, int]) -> None:
    right, wrong = divided_so(picture(fork(), gap=gap), np.stack([fork(), block()]), NOWHERE)
    assert right > wrong + 0.5


def test_a_part_shows_where_it_is_drawn_and_where_it_is_not() -> None:
    wrong, right = divided_so(picture(block()), np.stack([fork(), block()]), NOWHERE)
    assert right > wrong + 0.5


def test_what_is_hidden_says_nothing() -> None:
    gap = block() & ~fork()
    both = divided_so(picture(fork()), np.stack([fork(), block()]), gap)
    assert both[0] == pytest.approx(both[1])


def test_where_poses_share_no_pixels_nothing_is_known() -> None:
    both = np.stack([fork(), np.roll(fork(), 30, axis=1)])
    assert not divided_so(picture(fork()), both, NOWHERE).any()
    assert not divided_so(picture(fork()), np.stack([fork(), block()]), ~NOWHERE).any()


def test_the_odds_are_those_of_two_normal_distributions() -> None:
    """By the formula, with numpy: medians, covariances, and what is added to them."""
    rng = np.random.default_rng(3)
    colors = rng.normal(4.0, 0.4, (20, 20, 3))
    common, around = np.zeros((20, 20), bool), np.zeros((20, 20), bool)
    common[:5], around[15:] = True, True
    colors[common] += (0.3, -0.2, 0.5)
    asked = rng.random((20, 20)) < 0.5
    drawn = rng.random((3, 20, 20)) < 0.6

    def likely(samples: np.ndarray) -> np.ndarray:
        middle = np.median(samples, axis=0)
        S = np.cov(samples.T) + 0.1**2 * np.eye(3) + 0.25**2 / 3
        off = colors[asked] - middle
        squares = np.einsum("ni,ij,nj->n", off, np.linalg.inv(S), off)
        return -0.5 * (squares + np.log(np.linalg.det(S)))

    odds = np.clip(likely(colors[common]) - likely(colors[around]), -3.0, 3.0)
    expected = np.where(drawn[:, asked], odds, -odds).mean(axis=1)
    found = mean_odds(colors, drawn, asked, common, around, 0.1, 0.25, 3.0)
    assert np.allclose(found, expected, atol=1e-9)
