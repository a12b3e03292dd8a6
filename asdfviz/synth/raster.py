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
_FAR_OFF = 1e9
"""Pixels to the side by which an edge that does not bind is moved."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Where the images of a batch lie in one flat row of pixels; they may differ in size."""

    start: Int64[Tensor, "b"]
    """Flat index of each image's first pixel."""
    width: Int64[Tensor, "b"]
    height: Int64[Tensor, "b"]
    pixels: int
    """Of all images together."""

    @classmethod
    def equal(cls, shape: tuple[int, int, int], device: torch.device) -> Cells:
        """Images of one size behind one another."""
        count, height, width = shape
        start = torch.arange(count, device=device) * (height * width)
        return cls(
            start,
            torch.full_like(start, width),
            torch.full_like(start, height),
            count * height * width,
        )

    @classmethod
    def of_sizes(cls, width: Int64[Tensor, "b"], height: Int64[Tensor, "b"]) -> Cells:
        """Images of different sizes behind one another."""
        end = (width * height).cumsum(0)
        pixels = int(end[-1]) if len(end) else 0
        return cls(end - width * height, width, height, pixels)


def rasterize(triangles: Projected, shape: tuple[int, int, int]) -> Fragments:
    """Find the nearest triangle at every pixel centre of every image.

    Both sides of a triangle count, for light meshes are not closed.

    Args:
        triangles: what to draw.
        shape: images, rows, columns.
    """
    return rasterize_cells(triangles, Cells.equal(shape, triangles.depth.device))


def rasterize_cells(triangles: Projected, cells: Cells) -> Fragments:
    """The same (see `rasterize`) for images that differ in size; each clips its own triangles."""
    buffer = _packed(triangles, cells)
    covered = (buffer >= 0).nonzero()[:, 0]
    key = buffer[covered]
    return Fragments(_depth_of(key), key & 0xFFFFFFFF, covered)


def depth_map(triangles: Projected, shape: tuple[int, int, int]) -> Float32[Tensor, "b h w"]:
    """Depth alone (see `rasterize`), infinite where nothing is."""
    buffer = _packed(triangles, Cells.equal(shape, triangles.depth.device))
    return torch.where(buffer >= 0, _depth_of(buffer), torch.inf).view(shape)


def corner_weights(
    triangles: Projected, fragments: Fragments, shape: tuple[int, int, int]
) -> Float32[Tensor, "p 3"]:
    """Weights of the triangle's corners at each covered pixel, perspective-correct."""
    _, height, width = shape
    a = _planes(triangles, fragments.face)
    dx = (fragments.covered % width).float() - a[0]
    dy = (fragments.covered // width % height).float() - a[1]
    w1, w2 = dx * a[2] + dy * a[3], dx * a[4] + dy * a[5]
    q0, q1, q2 = a[6], a[6] + a[7], a[6] + a[8]
    weights = torch.stack([(1 - w1 - w2) * q0, w1 * q1, w2 * q2], dim=1)
    return weights / weights.sum(1, keepdim=True)


def _depth_of(key: Tensor) -> Tensor:
    return 1.0 / (key >> 32).to(torch.int32).view(torch.float32)


def _corners(values: Float32[Tensor, "n"], faces: Int64[Tensor, "k 3"]) -> Float32[Tensor, "3 k"]:
    return values.index_select(0, faces.T.reshape(-1)).view(3, -1)


def _worth_drawing(triangles: Projected, cells: Cells) -> tuple[Tensor, Tensor, Tensor]:
    """Triangles whose box holds a pixel's centre of their image; the first and last row of each."""
    # NaN makes every comparison false, which leaves out what comes too near.
    seen = torch.where(triangles.depth > NEAR, triangles.points_px[:, 1], torch.nan)
    y = _corners(seen, triangles.faces)
    x = _corners(triangles.points_px[:, 0].contiguous(), triangles.faces)
    first = torch.minimum(torch.minimum(y[0], y[1]), y[2]).ceil_().clamp_(min=0)
    last = torch.maximum(torch.maximum(y[0], y[1]), y[2]).floor_()
    left = torch.minimum(torch.minimum(x[0], x[1]), x[2]).ceil_().clamp_(min=0)
    right = torch.maximum(torch.maximum(x[0], x[1]), x[2]).floor_()
    last = torch.minimum(last, (cells.height - 1).float()[triangles.image])
    right = torch.minimum(right, (cells.width - 1).float()[triangles.image])
    kept = ((first <= last) & (left <= right)).nonzero()[:, 0]
    return kept, first[kept].long(), last[kept].long()


def _planes(triangles: Projected, face: Int64[Tensor, "k"]) -> Float32[Tensor, "9 k"]:
    """Of each named triangle: origin, gradients of two corner weights, 1/z and its two steps.

    The gradients of a triangle that is seen edge-on are zero.
    """
    faces = triangles.faces[face]
    x = _corners(triangles.points_px[:, 0].contiguous(), faces)
    y = _corners(triangles.points_px[:, 1].contiguous(), faces)
    q = _corners(1.0 / triangles.depth.clamp(min=NEAR), faces)
    x1, y1, x2, y2 = x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]
    area = x1 * y2 - x2 * y1
    inverse = torch.where(area.abs() > 1e-9, 1.0 / area, 0.0)
    gradients = [y2 * inverse, -x2 * inverse, -y1 * inverse, x1 * inverse]
    return torch.stack([x[0], y[0], *gradients, q[0], q[1] - q[0], q[2] - q[0]])


def _spread(count: Tensor) -> tuple[Tensor, Tensor]:
    """Owner and place within its owner of each element of ranges laid behind one another."""
    owner = torch.repeat_interleave(count)
    start = (count.cumsum(0) - count).index_select(0, owner)
    return owner, torch.arange(len(owner), device=count.device).sub_(start)


def _packed(triangles: Projected, cells: Cells) -> Int64[Tensor, "p"]:
    """For each pixel the bits of the largest 1/z and its triangle in one integer; -1 for none."""
    kept, top, bottom = _worth_drawing(triangles, cells)
    image = triangles.image[kept]
    width = cells.width[image]
    a = _planes(triangles, kept)
    spans = _spans(a, width)
    # 1/z along a row is linear: value at the corner's column plus columns times slope.
    slope, fall = a[2] * a[7] + a[4] * a[8], a[3] * a[7] + a[5] * a[8]
    owner, line = _spread(bottom - top + 1)
    row_of = torch.cat([spans, torch.stack([a[0], a[6], slope, fall, top - a[1]])])
    rows = row_of.index_select(1, owner)
    origin, nearest, slope, fall, down = rows[-5:]
    dy = line + down
    low, high = _row_span(rows[:-5], dy)
    first = ((low - origin) * slope).add_(nearest).addcmul_(dy, fall)
    start = (cells.start[image] + top * width).index_select(0, owner)
    start += line * width.index_select(0, owner) + low.long()
    row, column = _spread((high - low + 1).clamp_(min=0).long())
    nearness = first.index_select(0, row).addcmul_(column, slope.index_select(0, row))
    # Bits of positive floats sort like the floats: one integer holds the nearness and the face.
    key = nearness.clamp_(min=1e-6).view(torch.int32).long() << 32
    key |= kept.index_select(0, owner).index_select(0, row)
    buffer = torch.full((cells.pixels,), -1, dtype=torch.int64, device=triangles.depth.device)
    return buffer.scatter_reduce_(0, start.index_select(0, row) + column, key, "amax")


def _spans(a: Float32[Tensor, "9 k"], width: Int64[Tensor, "k"]) -> Float32[Tensor, "13 k"]:
    """Where rows enter and leave each triangle: per edge x at the first corner's row, x a row,
    what is added to x so that it binds from the left only, or the right only; at last the width.

    A level edge binds nothing: the first and last row of the box do that.
    """
    edges = ((a[2], a[3], 0.0), (a[4], a[5], 0.0), (-(a[2] + a[4]), -(a[3] + a[5]), 1.0))
    columns: list[Tensor] = []
    for slope, change, constant in edges:
        level = slope.abs() < 1e-12
        inverse = torch.where(level, 0.0, 1.0 / slope)
        columns += [
            a[0] - (constant + _SLACK) * inverse,
            -change * inverse,
            torch.where((slope > 0) & ~level, 0.0, -_FAR_OFF),
            torch.where((slope < 0) & ~level, 0.0, _FAR_OFF),
        ]
    edge_on = (a[2] == 0) & (a[4] == 0)
    return torch.stack([*columns, torch.where(edge_on, -1, width - 1).float()])


def _row_span(spans: Float32[Tensor, "13 r"], dy: Tensor) -> tuple[Tensor, Tensor]:
    """First and last pixel of a triangle on a row, where all three corner weights are positive."""
    low, high = torch.zeros_like(dy), spans[12].clone()
    for edge in range(0, 12, 4):
        x = torch.addcmul(spans[edge], dy, spans[edge + 1])
        low = torch.maximum(low, x + spans[edge + 2])
        high = torch.minimum(high, x.add_(spans[edge + 3]))
    low = torch.minimum(low, spans[12] + 1)
    return low.ceil_(), high.clamp_(min=-1).floor_()
