"""A narrow part whose depth is smeared full: its colours still say where it is."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.shapes import Mask, Rgb
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
