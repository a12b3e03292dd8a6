"""What lies close keeps light off: horizons of millimetres, finer than shadow maps can be.

From each pixel near a thing a few steps are taken in the picture, in directions all round, and the
steepest surface met in each is its horizon there (Bavoil and Sainz, "Image-space horizon-based ambient
occlusion", 2008). Grooves, gaps between parts and the foot of what stands on a table are dark for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float32, Int64
from torch import Tensor
from torch.nn.functional import max_pool2d

from asdfviz.synth.gbuffer import GBuffer, Views
from asdfviz.synth.tensors import dot, unit

STEPS = (0.0009, 0.002, 0.0045, 0.01)
"""Metres across the line of sight."""
REACH = 0.018
"""The farther off, the less a step counts, down to nothing here, metres."""
HEIGHT = 0.05
"""What stands out more than this may hang free, so that light gets under it, metres."""
SLOPE = 0.12
"""Sine of what is no horizon yet: normals are bumped and worn, and surfaces made of flat faces."""
SOFT = 0.35
"""Over so much of the sine of its height a wide light sets behind a horizon."""
SHRUNK = 4
"""The pixels near things are found in a picture so many times smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class Horizons:
    """Of the pixels near things; all others see the whole sky."""

    index: Int64[Tensor, "n"]
    """Of those pixels, counted through the batch."""
    sines: Float32[Tensor, "d n"]
    """Of the horizon's height above the surface, 0 to 1, in directions evenly round the picture."""
    across: Float32[Tensor, "d b 3"]
    """Those directions in each image, world."""
    position: Float32[Tensor, "n 3"]
    """World."""
    normal: Float32[Tensor, "n 3"]
    image: Int64[Tensor, "n"]
    """In which image of the batch."""
    shape: tuple[int, int, int]

    def sky(self) -> Float32[Tensor, "b h w"]:
        """Share of light that arrives where it comes from all sides alike."""
        return self._filled(1 - self.sines.square().mean(dim=0))

    def light(self, center: Float32[Tensor, "b 3"]) -> Float32[Tensor, "b h w"]:
        """Share of an area light, given each image's centre of it, that stands above the horizon."""
        towards = unit(center[self.image] - self.position)
        total = torch.full_like(towards[:, 0], 1e-6)
        horizon = torch.zeros_like(total)
        for sines, across in zip(self.sines, self.across, strict=True):
            # A lobe about as wide as the angle between directions.
            weight = dot(across[self.image], towards)[:, 0].clamp_(min=0).square().square()
            total += weight
            horizon.addcmul_(weight, sines)
        above = dot(self.normal, towards)[:, 0] - horizon / total
        share = (above / SOFT + 0.5).clamp(0, 1)
        return self._filled(torch.where(horizon > 0, share, 1.0))

    def _filled(self, values: Float32[Tensor, "n"]) -> Float32[Tensor, "b h w"]:
        full = values.new_ones(self.shape)
        full.view(-1)[self.index] = values
        return full


def horizons(buffer: GBuffer, views: Views, *, directions: int) -> Horizons:
    """Find the horizons round all pixels that a thing shows in or is near to."""
    count, height, width = buffer.depth.shape
    focal = views.K[:, 0, 0]
    index = _near_things(buffer, focal).reshape(-1).nonzero()[:, 0]
    image = torch.div(index, height * width, rounding_mode="floor")
    row = torch.div(index, width, rounding_mode="floor")
    u, v = index - row * width, row % height
    places = buffer.position.reshape(-1, 3).T.contiguous()
    here, normals = places[:, index], buffer.normal.reshape(-1, 3)[index]
    normal, scale = normals.T.contiguous(), focal[image] / buffer.depth.reshape(-1)[index]
    angles = [0.2 + 2 * math.pi * k / directions for k in range(directions)]
    turns = torch.tensor([[math.cos(a), math.sin(a)] for a in angles], device=index.device)
    sines = torch.zeros((directions, len(index)), device=index.device)
    for step in STEPS:
        px = (step * scale).clamp_(min=1.0)
        for horizon, angle in zip(sines, angles, strict=True):
            # The pixel so far away, of the same image and inside of it.
            i: Tensor = (u + (px * math.cos(angle)).round_()).clamp_(0, width - 1).long()
            j: Tensor = (v + (px * math.sin(angle)).round_()).clamp_(0, height - 1).long()
            away = places[:, (row - v + j) * width + i] - here
            square = away.square().sum(dim=0).clamp_(min=1e-12)
            rise = (away * normal).sum(dim=0) * square.rsqrt()
            counts = (1 - square / HEIGHT**2).clamp_(min=0) * (1 - (step / REACH) ** 2)
            torch.maximum(horizon, (rise - SLOPE) / (1 - SLOPE) * counts, out=horizon)
    across = torch.einsum("di,bij->dbj", turns, views.R[:, :2])
    return Horizons(index, sines, across, here.T, normals, image, (count, height, width))


def _near_things(buffer: GBuffer, focal: Float32[Tensor, "b"]) -> Bool[Tensor, "b h w"]:
    """Pixels of things, and those nearer to them than the last step."""
    height, width = buffer.depth.shape[1:]
    owned = buffer.owner >= 0
    if not bool(owned.any()):
        return owned
    nearest = buffer.depth.masked_fill(~owned, torch.inf).amin(dim=(1, 2))
    reach = int((STEPS[-1] * focal / nearest).amax().ceil()) // SHRUNK + 1
    small = max_pool2d(owned[:, None].float(), SHRUNK, ceil_mode=True)
    side = 2 * reach + 1
    for window in ((side, 1), (1, side)):
        small = max_pool2d(small, window, stride=1, padding=tuple(w // 2 for w in window))
    large = small.repeat_interleave(SHRUNK, dim=2).repeat_interleave(SHRUNK, dim=3)
    return large[:, 0, :height, :width] > 0
