"""Grounds in torch: where rays meet the textured planes, and how those look there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from torch import Tensor
from torch.nn.functional import grid_sample

from asdfviz.synth.description import Ground, Scene
from asdfviz.synth.photo_grounds import photo_looks
from asdfviz.synth.tensors import to_tensor, unit
from asdfviz.synth.textures import (
    BLURS_PX,
    MACRO_SIZE,
    MICRO_PIXELS,
    MICRO_SIZE,
    macro_map,
    micro_map,
)

FAR = 12.0
"""Depth given to rays that hit nothing, metres."""


def ground_depth(
    scenes: Sequence[Scene], rays: Float32[Tensor, "b h w 3"], centers: Float32[Tensor, "b 3"]
) -> tuple[Float32[Tensor, "b h w"], Int64[Tensor, "b h w"]]:
    """Depth of the first ground that each ray meets and its place in the scene; FAR and -1 for none."""
    depth = torch.full_like(rays[..., 0], FAR)
    which = torch.full_like(depth, -1, dtype=torch.int64)
    for i, scene in enumerate(scenes):
        down = torch.where(rays[i, :, :, 2].abs() < 1e-4, -1e-4, rays[i, :, :, 2])
        for k, ground in enumerate(scene.grounds):
            reach = (ground.height - centers[i, 2]) / down
            x, y = (centers[i, axis] + rays[i, :, :, axis] * reach for axis in (0, 1))
            mask = ground_mask(ground, x, y) & (reach > 0) & (reach < depth[i])
            depth[i] = torch.where(mask, reach, depth[i])
            which[i] = torch.where(mask, k, which[i])
    return depth, which


def ground_mask(
    ground: Ground, x: Float32[Tensor, "h w"], y: Float32[Tensor, "h w"]
) -> Bool[Tensor, "h w"]:
    """Whether points (x, y) of a ground's plane belong to it."""
    mask = torch.ones_like(x, dtype=torch.bool)
    for a, b, c in ground.edges.tolist():
        mask &= a * x + b * y <= c
    if ground.circle is not None:
        cx, cy, radius = ground.circle
        mask &= (x - cx) ** 2 + (y - cy) ** 2 <= radius**2
    return mask


def ground_looks(
    ground: Ground, x: Float32[Tensor, "p"], y: Float32[Tensor, "p"], footprint: float
) -> tuple[Float32[Tensor, "p 3"], Float32[Tensor, "p 3"]]:
    """Albedo and normal at points of a ground's plane; `footprint` is a pixel's size there, metres."""
    u, v = _on_maps(ground, x, y)
    if ground.photo is not None:
        up = torch.zeros(len(x), 3, device=x.device)
        up[:, 2] = 1
        return photo_looks(ground.photo, u, v, footprint), up
    weights = _texels(ground, u, v, footprint)
    colors = to_tensor(ground.colors, x.device, dtype=torch.float32)
    w1, w2 = weights[0, :, None], weights[1, :, None]
    color = (colors[0] * (1 - w1) + colors[1] * w1) * (1 - w2) + colors[2] * w2
    c, s = float(np.cos(ground.angle)), float(np.sin(ground.angle))
    slope_x = (c * weights[3] - s * weights[4]) * ground.bump
    slope_y = (s * weights[3] + c * weights[4]) * ground.bump
    normal = unit(torch.stack([-slope_x, -slope_y, torch.ones_like(x)], dim=1))
    return (color * weights[2, :, None]).clamp(0.002, 0.95), normal


def _on_maps(
    ground: Ground, x: Float32[Tensor, "p"], y: Float32[Tensor, "p"]
) -> tuple[Float32[Tensor, "p"], Float32[Tensor, "p"]]:
    """Where points of the plane lie on the ground's maps, or its photo, metres."""
    c, s = float(np.cos(ground.angle)), float(np.sin(ground.angle))
    return c * x + s * y + ground.offset[0], -s * x + c * y + ground.offset[1]


def _texels(
    ground: Ground, u: Float32[Tensor, "p"], v: Float32[Tensor, "p"], footprint: float
) -> Float32[Tensor, "5 p"]:
    """Both maps, combined, at points (u, v) of them."""
    device = str(u.device)
    size = MACRO_SIZE * ground.scale
    large = macro_map(*ground.macro, device)
    grid = torch.stack([u, v], dim=1)[None, None] * (2 / size)
    coarse = grid_sample(
        large[None], grid, mode="bilinear", padding_mode="reflection", align_corners=False
    )[0, :, 0]
    blur_px = 0.6 * footprint / (MICRO_SIZE / MICRO_PIXELS)
    level = int(np.searchsorted(BLURS_PX, blur_px * 0.75))
    small = micro_map(*ground.micro, min(level, len(BLURS_PX) - 1), device)
    wrapped = torch.stack([u, v], dim=1)[None, None] / MICRO_SIZE
    wrapped = (wrapped - wrapped.floor()) * 2 - 1
    # The repeating map is padded by one texel so that interpolation crosses its border smoothly.
    padded = torch.nn.functional.pad(small[None], (1, 1, 1, 1), mode="circular")
    wrapped = wrapped * (MICRO_PIXELS / (MICRO_PIXELS + 2))
    fine = grid_sample(padded, wrapped, mode="bilinear", align_corners=False)[0, :, 0]
    return torch.stack(
        [
            (coarse[0] + fine[0]).clamp(0, 1),
            (coarse[1] + fine[1]).clamp(0, 1),
            coarse[2] * fine[2],
            coarse[3] / ground.scale + fine[3],
            coarse[4] / ground.scale + fine[4],
        ]
    )
