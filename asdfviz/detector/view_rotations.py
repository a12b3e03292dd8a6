"""Rotations of many crops' cameras at once."""

from __future__ import annotations

import torch
from jaxtyping import Float32
from torch import Tensor


def about_z(angle: Float32[Tensor, "b"]) -> Float32[Tensor, "b 3 3"]:
    """Rotations about the optical axis."""
    c, s, o = torch.cos(angle), torch.sin(angle), torch.zeros_like(angle)
    rows = torch.stack([c, -s, o, s, c, o, o, o, o + 1], dim=1)
    return rows.view(-1, 3, 3)


def towards(flat: Float32[Tensor, "b 2"]) -> Float32[Tensor, "b 3 3"]:
    """Smallest rotations of the optical axis onto rays (x, y, 1), as `rotation_to_ray`."""
    ray = torch.cat([flat, torch.ones_like(flat[:, :1])], dim=1)
    ray = ray / (ray * ray).sum(1, keepdim=True).sqrt()
    x, y, z = ray.T
    k = 1 / (1 + z)
    rows = [1 - k * x * x, -k * x * y, x, -k * x * y, 1 - k * y * y, y, -x, -y, z]
    return torch.stack(rows, dim=1).view(-1, 3, 3)
