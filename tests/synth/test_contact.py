"""Close surfaces keep light off: checked on height fields seen from above."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from asdfviz.synth.contact import HEIGHT, SLOPE, STEPS, Horizons, horizons
from asdfviz.synth.gbuffer import GBuffer, Views

SIZE = 121
FOCAL = 600.0
FAR = 0.6
"""Distance of the table from the camera, metres: a pixel is a millimetre there."""


def looked_down_on(height: Tensor, *, owned: Tensor) -> tuple[GBuffer, Views]:
    """Things as high as they are over a table (metres), from above; world x, y as columns and rows."""
    R = torch.diag(torch.tensor([1.0, 1.0, -1.0]))[None]
    K = torch.tensor([[[FOCAL, 0.0, SIZE // 2], [0.0, FOCAL, SIZE // 2], [0.0, 0.0, 1.0]]])
    # A camera that looks down, over the middle.
    views = Views(K, R, torch.tensor([[0.0, 0.0, FAR]]), SIZE, SIZE)
    depth = (FAR - height)[None]
    v, u = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    place = torch.stack(
        [(u - SIZE // 2) * depth[0] / FOCAL, (v - SIZE // 2) * depth[0] / FOCAL, height], dim=-1
    )[None]
    up = torch.tensor([0.0, 0.0, 1.0]).expand(1, SIZE, SIZE, 3)
    plain = torch.zeros(1, SIZE, SIZE)
    owner = torch.where(owned, 0, -1)[None]
    return GBuffer(depth, place, up, up, up, plain, plain, owner), views


def block(height: float) -> tuple[GBuffer, Views]:
    """A block to the left of the middle, on a table."""
    heights = torch.zeros(SIZE, SIZE)
    heights[:, : SIZE // 2] = height
    return looked_down_on(heights, owned=heights > 0)


def found(seen: tuple[GBuffer, Views]) -> Horizons:
    return horizons(*seen, directions=8)


def test_where_nothing_lies_the_whole_sky_is_seen() -> None:
    empty = torch.zeros(SIZE, SIZE)
    near = found(looked_down_on(empty, owned=empty > 0))
    assert len(near.index) == 0
    torch.testing.assert_close(near.sky(), torch.ones(1, SIZE, SIZE))
    torch.testing.assert_close(
        near.light(torch.tensor([[1.0, 0.0, 0.1]])), torch.ones(1, SIZE, SIZE)
    )


def test_the_foot_of_a_wall_is_dark_and_what_is_farther_off_less() -> None:
    row = found(block(0.02)).sky()[0, SIZE // 2]
    foot = row[SIZE // 2 : SIZE // 2 + 30]
    # A wall without end hides half of the sky from its foot, and no more.
    assert 0.45 < float(foot[0]) < 0.7
    assert bool((foot[1:] >= foot[:-1] - 1e-3).all())
    assert float(row[SIZE // 2 + 12 :].min()) == 1.0


def test_what_lies_on_top_is_not_darkened_by_what_is_lower() -> None:
    row = found(block(0.02)).sky()[0, SIZE // 2]
    assert float(row[: SIZE // 2].min()) == 1.0


@pytest.mark.parametrize(("width_mm", "deep_mm"), [(3, 1.4), (5, 2.0), (9, 3.0)])
def test_a_groove_is_darker_than_its_rim_by_the_sky_that_its_walls_hide(
    width_mm: int, deep_mm: float
) -> None:
    heights = torch.full((SIZE, SIZE), 0.005)
    middle = SIZE // 2
    floor = slice(middle - width_mm // 2, middle + width_mm // 2 + 1)
    heights[:, floor] -= deep_mm * 1e-3
    sky = found(looked_down_on(heights, owned=heights > 0)).sky()[0, middle]
    assert float(sky[middle - 12]) > 0.99
    # Of an endless groove the middle sees the sine of half of its opening (cosine-weighted sky).
    half = math.atan2(width_mm / 2, deep_mm)
    assert math.sin(half) - 0.05 < float(sky[middle]) < 0.99


def test_a_light_that_stands_low_behind_a_wall_is_kept_off_and_one_before_it_not() -> None:
    near = found(block(0.02))
    behind = near.light(torch.tensor([[-1.0, 0.0, 0.5]]))[0, SIZE // 2]
    before = near.light(torch.tensor([[1.0, 0.0, 0.5]]))[0, SIZE // 2]
    foot = SIZE // 2 + 1
    assert float(behind[foot]) < 0.05
    assert float(before[foot]) == 1.0
    assert float(behind[-20:].min()) == 1.0


def test_a_hand_high_over_the_table_keeps_nothing_off() -> None:
    heights = torch.zeros(SIZE, SIZE)
    heights[:, : SIZE // 2] = 1.2 * HEIGHT
    sky = found(looked_down_on(heights, owned=heights > 0)).sky()
    torch.testing.assert_close(sky, torch.ones(1, SIZE, SIZE))


def test_a_slope_that_bumps_make_is_no_horizon() -> None:
    u = torch.arange(SIZE).float()
    gentle = (0.8 * SLOPE * 1e-3 * u).expand(SIZE, SIZE)
    sky = found(looked_down_on(gentle, owned=gentle >= 0)).sky()
    torch.testing.assert_close(sky, torch.ones(1, SIZE, SIZE))


def test_it_turns_with_the_picture() -> None:
    heights = torch.zeros(SIZE, SIZE)
    heights[:, : SIZE // 2] = 0.02
    left = found(looked_down_on(heights, owned=heights > 0))
    top = found(looked_down_on(heights.T.contiguous(), owned=heights.T > 0))
    from_left = left.light(torch.tensor([[-1.0, 0.0, 0.5]]))[0]
    from_top = top.light(torch.tensor([[0.0, -1.0, 0.5]]))[0]
    assert float((from_left - from_top.T).abs().max()) < 0.35
    assert float((from_left - from_top.T).abs().mean()) < 0.01


def test_what_counts_ends_within_its_reach() -> None:
    sky = found(block(0.02)).sky()[0, SIZE // 2]
    off = (torch.arange(SIZE) - SIZE // 2) * 1e-3
    assert float(sky[off > STEPS[-1] + 1e-3].min()) == 1.0
