"""A z-buffer in torch: triangles of many images at once, on the CPU or a GPU. The bottom of `synth`.

All triangles of a batch lie in one list; each names the image that it belongs to, so images may hold
different numbers of different meshes. Nothing here knows of cameras, meshes or materials.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float32, Int64
from torch import Tensor

NEAR = 0.02
"""Triangles that reach nearer than this (metres) are left out instead of being clipped."""
_SLACK = 1e-6
"""Pixels this far (in corner weights) outside still count, so that shared edges have no gaps."""


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """Triangles of a batch of images after projection."""

    points_px: Float32[Tensor, "n 2"]
    """Corners; an integer is a pixel's centre."""
    depth: Float32[Tensor, "n"]
    """Planar depth of the corners, metres."""
    faces: Int64[Tensor, "f 3"]
    image: Int64[Tensor, "f"]
    """The image of each triangle, 0 to b - 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Fragments:
    """The nearest surface at every pixel that a triangle covers."""

    depth: Float32[Tensor, "p"]
    """Planar depth, metres, of each covered pixel."""
    face: Int64[Tensor, "p"]
    """Index of its triangle."""
    covered: Int64[Tensor, "p"]
    """Its flat index, image by image, row by row."""


def rasterize(triangles: Projected, shape: tuple[int, int, int]) -> Fragments:
    """Find the nearest triangle at every pixel centre of every image.

    Both sides of a triangle count, for light meshes are not closed.

    Args:
        triangles: what to draw.
        shape: images, rows, columns.
    """
    buffer = _packed(triangles, shape)
    covered = (buffer >= 0).nonzero()[:, 0]
    key = buffer[covered]
    return Fragments(_depth_of(key), key & 0xFFFFFFFF, covered)


def depth_map(triangles: Projected, shape: tuple[int, int, int]) -> Float32[Tensor, "b h w"]:
    """Depth alone (see `rasterize`), infinite where nothing is."""
    buffer = _packed(triangles, shape)
    return torch.where(buffer >= 0, _depth_of(buffer), torch.inf).view(shape)


def corner_weights(
    triangles: Projected, fragments: Fragments, shape: tuple[int, int, int]
) -> Float32[Tensor, "p 3"]:
    """Weights of the triangle's corners at each covered pixel, perspective-correct."""
    _, height, width = shape
    planes, _, kept = _planes(triangles)
    place = torch.full((len(triangles.faces),), -1, dtype=torch.int64, device=kept.device)
    place[kept] = torch.arange(len(kept), device=kept.device)
    a = planes[place[fragments.face]]
    dx = (fragments.covered % width).float() - a[:, 0]
    dy = (fragments.covered // width % height).float() - a[:, 1]
    w1 = dx * a[:, 2] + dy * a[:, 3]
    w2 = dx * a[:, 4] + dy * a[:, 5]
    q0, q1, q2 = a[:, 6], a[:, 6] + a[:, 7], a[:, 6] + a[:, 8]
    weights = torch.stack([(1 - w1 - w2) * q0, w1 * q1, w2 * q2], dim=1)
    return weights / weights.sum(1, keepdim=True)


def _depth_of(key: Tensor) -> Tensor:
    return 1.0 / (key >> 32).to(torch.int32).view(torch.float32)


def _planes(triangles: Projected) -> tuple[Tensor, Tensor, Tensor]:
    """Of every triangle worth drawing: origin, gradients of two corner weights, 1/z; box y; index."""
    faces = triangles.faces
    inverse_z = 1.0 / triangles.depth.clamp(min=NEAR)
    x, y, q = triangles.points_px[:, 0][faces], triangles.points_px[:, 1][faces], inverse_z[faces]
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    near = triangles.depth[faces].amin(1) > NEAR
    y_range = torch.stack([y.amin(1).ceil(), y.amax(1).floor()], dim=1)
    kept = ((y_range[:, 0] <= y_range[:, 1]) & (area.abs() > 1e-9) & near).nonzero()[:, 0]
    x, y, q, inverse = x[kept], y[kept], q[kept], 1.0 / area[kept]
    planes = torch.stack(
        [
            x[:, 0],
            y[:, 0],
            (y[:, 2] - y[:, 0]) * inverse,
            (x[:, 0] - x[:, 2]) * inverse,
            (y[:, 0] - y[:, 1]) * inverse,
            (x[:, 1] - x[:, 0]) * inverse,
            q[:, 0],
            q[:, 1] - q[:, 0],
            q[:, 2] - q[:, 0],
        ],
        dim=1,
    )
    return planes, y_range[kept], kept


def _spread(count: Tensor) -> tuple[Tensor, Tensor]:
    """Owner and place within its owner of each element of ranges laid behind one another."""
    owner = torch.repeat_interleave(count)
    place = torch.arange(len(owner), device=count.device) - (count.cumsum(0) - count)[owner]
    return owner, place


def _packed(triangles: Projected, shape: tuple[int, int, int]) -> Int64[Tensor, "p"]:
    """For each pixel the bits of the largest 1/z and its triangle in one integer; -1 for none."""
    count, height, width = shape
    device = triangles.depth.device
    planes, y_range, kept = _planes(triangles)
    y0 = y_range[:, 0].clamp(min=0).long()
    rows = (y_range[:, 1].clamp(max=height - 1).long() - y0 + 1).clamp(min=0)
    owner, line = _spread(rows)
    a = planes[owner]
    y = y0[owner] + line
    dy = y.float() - a[:, 1]
    low, high = _row_span(a, dy, width)
    pixels = (high - low + 1).clamp(min=0).long()
    row, column = _spread(pixels)
    # 1/z along a row is linear: value at the first pixel plus column times slope.
    slope = a[:, 2] * a[:, 7] + a[:, 4] * a[:, 8]
    first = (low - a[:, 0]) * slope + dy * (a[:, 3] * a[:, 7] + a[:, 5] * a[:, 8]) + a[:, 6]
    face = kept[owner]
    start = (triangles.image[face] * height + y) * width + low.clamp(0, width).long()
    nearness = (first[row] + column * slope[row]).clamp(min=1e-6)
    # Bits of positive floats sort like the floats: one integer holds the nearness and the face.
    key = (nearness.view(torch.int32).long() << 32) | face[row]
    buffer = torch.full((count * height * width,), -1, dtype=torch.int64, device=device)
    return buffer.scatter_reduce_(0, start[row] + column, key, "amax")


def _row_span(a: Tensor, dy: Tensor, width: int) -> tuple[Tensor, Tensor]:
    """First and last pixel of a triangle on a row, where all three corner weights are positive."""
    low = torch.zeros_like(dy)
    high = torch.full_like(dy, width - 1)
    edges = (
        (a[:, 2], dy * a[:, 3]),
        (a[:, 4], dy * a[:, 5]),
        (-(a[:, 2] + a[:, 4]), 1 - dy * (a[:, 3] + a[:, 5])),
    )
    for slope, constant in edges:
        flat = slope.abs() < 1e-12
        bound = a[:, 0] - (constant + _SLACK) / torch.where(flat, 1e-12, slope)
        low = torch.where(~flat & (slope > 0), torch.maximum(low, bound), low)
        high = torch.where(~flat & (slope < 0), torch.minimum(high, bound), high)
        high = torch.where(flat & (constant < -_SLACK), -1.0, high)
    return low.ceil(), high.floor()
