from __future__ import annotations

import pytest
import torch

from asdfviz.synth.shrinking import area_means


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 1.3])
def test_every_pixel_looks_at_its_own_place(ratio: float) -> None:
    height, width = 40, 60
    fine_h, fine_w = round(height * ratio), round(width * ratio)
    u = (torch.arange(fine_w) + 0.5) * width / fine_w - 0.5
    v = (torch.arange(fine_h) + 0.5) * height / fine_h - 0.5
    places = torch.stack(torch.meshgrid(v, u, indexing="ij"), dim=-1)[None]
    v_seen, u_seen = area_means(places, height, width)[0].unbind(-1)
    # A fine pixel that two share holds one value: its middle, off for either by a little.
    near = 0.13 if ratio == 1.3 else 1e-5 if ratio != 1.5 else 0.06
    assert (u_seen - torch.arange(width)).abs().max() < near
    assert (v_seen - torch.arange(height)[:, None]).abs().max() < near


def test_light_is_neither_lost_nor_made() -> None:
    images = torch.rand(2, 54, 81, 3, generator=torch.Generator().manual_seed(3))
    for height, width in ((36, 54), (27, 27), (50, 80)):
        means = area_means(images, height, width)
        assert means.shape == (2, height, width, 3)
        assert torch.allclose(means.mean(dim=(1, 2)), images.mean(dim=(1, 2)), atol=1e-5)
        assert torch.allclose(area_means(torch.ones_like(images), height, width), torch.ones(()))
