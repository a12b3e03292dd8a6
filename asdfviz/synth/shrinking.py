"""Means over areas: what a coarse pixel sees of a finer picture, exact for any ratio of the sizes.

torch's `interpolate(mode="area")` takes whole fine pixels: at one and a half times the size the windows
of neighbours overlap, and their pixels look a sixth of a pixel to either side in turn.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def area_means(images: Float[Tensor, "b h w c"], height: int, width: int) -> Tensor:
    """Shrink images to (b, height, width, c), every fine pixel counted by the share of it that is covered.

    Args:
        images: not smaller than that.
        height: pixels.
        width: pixels.
    """
    return _means(_means(images, height, dim=1), width, dim=2)


def _means(images: Float[Tensor, "b h w c"], count: int, *, dim: int) -> Tensor:
    fine = images.shape[dim]
    if fine == count:
        return images
    edges = torch.arange(count + 1, dtype=torch.float64, device=images.device) * fine / count
    first = edges[:-1].floor().long()
    taps = int((edges[1:].ceil().long() - first).max())
    shape = [1] * images.dim()
    shape[dim] = count
    total = images.new_zeros(*images.shape[:dim], count, *images.shape[dim + 1 :])
    for tap in range(taps):
        place = first + tap
        covered = torch.minimum(edges[1:], place + 1.0) - torch.maximum(edges[:-1], place.double())
        share = (covered.clamp(min=0) * count / fine).to(images.dtype).view(shape)
        total.addcmul_(share, images.index_select(dim, place.clamp(max=fine - 1)))
    return total
