"""Cuts planned inputs out of pictures that lie on a torch device: a GPU waits for no warp on a CPU.

Inputs are those of `asdfviz.train.patches.cut_input` to a grey level or two; the grain differs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from torch import Tensor

from asdfviz.geometry.shapes import Rgb
from asdfviz.train.patches import LUMA, InputPlan

AT_ONCE = 16
"""Inputs whose pixels are made together: a gigabyte of the device's memory at 640x384."""
BLUR_TAPS = 4
"""Pixels to each side that the widest blur of `ColorConfig` reaches."""


@dataclass(frozen=True, slots=True, eq=False)
class PatchTable:
    """The patches of a batch as arrays, in the order of its inputs."""

    width: int
    """Of every input, pixels."""
    height: int
    inputs: Int64[np.ndarray, "p"]
    """Which input of the batch each patch belongs to; never falls."""
    pictures: Int64[np.ndarray, "p"]
    """Keys of the pictures that they are cut out of."""
    windows: Int64[np.ndarray, "p 4"]
    """x, y, width and height in the input."""
    figures: Float[np.ndarray, "p 16"]
    """The first two rows of the map from the window's pixels to the picture's, colour of what it does
    not cover, gamma, gains, saturation, blur and noise."""

    @classmethod
    def of(cls, inputs: Sequence[InputPlan], keys: Sequence[int]) -> PatchTable:
        """Of inputs of one size.

        Args:
            inputs: the batch.
            keys: of the pictures that they were planned with.
        """
        patches = [(i, patch) for i, plan in enumerate(inputs) for patch in plan.patches]
        back = np.linalg.inv(np.array([p.H for _, p in patches]))[:, :2].reshape(-1, 6)
        rest = [
            (*p.fill, c.gamma, *c.gains, c.saturation, c.blur, c.noise)
            for _, p in patches
            for c in (p.colors,)
        ]
        return cls(
            width=inputs[0].width,
            height=inputs[0].height,
            inputs=np.array([i for i, _ in patches], np.int64),
            pictures=np.array([keys[p.image] for _, p in patches], np.int64),
            windows=np.array([(p.x, p.y, p.width, p.height) for _, p in patches], np.int64),
            figures=np.concatenate([back, np.array(rest)], axis=1).astype(np.float32),
        )


class PicturePool:
    """Pictures on a device, by keys."""

    def __init__(self, device: str) -> None:
        """Begin without pictures."""
        self._device = device
        self._pixels = torch.zeros((0, 3), dtype=torch.uint8, device=device)
        self._used = 0
        self._places: dict[int, tuple[int, int, int]] = {}
        """First pixel, width and height of each picture."""
        self._free: dict[int, list[int]] = {}
        """First pixels of the places that are free, by their size."""

    def add(self, key: int, rgb: Rgb) -> None:
        """Take in a picture."""
        height, width = rgb.shape[:2]
        count = height * width
        free = self._free.get(count)
        first = free.pop() if free else self._grown(count)
        pixels = torch.as_tensor(np.ascontiguousarray(rgb)).view(-1, 3)
        self._pixels[first : first + count] = pixels.to(self._device)
        self._places[key] = (first, width, height)

    def drop(self, key: int) -> None:
        """Forget a picture; the next of its size takes its place."""
        first, width, height = self._places.pop(key)
        self._free.setdefault(width * height, []).append(first)

    def _grown(self, count: int) -> int:
        first, self._used = self._used, self._used + count
        if self._used > len(self._pixels):
            more = max(self._used, len(self._pixels) * 3 // 2) - len(self._pixels)
            self._pixels = torch.cat([self._pixels, self._pixels.new_zeros((more, 3))])
        return first

    def cut(self, table: PatchTable) -> UInt8[Tensor, "b h w 3"]:
        """Return the pixels of the inputs.

        Raises:
            KeyError: a picture is not here.
        """
        places = np.array([self._places[key] for key in table.pictures.tolist()], np.int64)
        count = int(table.inputs[-1]) + 1
        size = (count, table.height, table.width, 3)
        out = torch.empty(size, dtype=torch.uint8, device=self._device)
        edges = np.searchsorted(table.inputs, [*range(0, count, AT_ONCE), count])
        for a, b in itertools.pairwise(edges.tolist()):
            self._fill(out.view(-1, 3), table, places, slice(a, b))
        return out

    def _fill(
        self, out: UInt8[Tensor, "n 3"], table: PatchTable, places: np.ndarray, part: slice
    ) -> None:
        windows = table.windows[part]
        areas = windows[:, 2] * windows[:, 3]
        first = table.inputs[part] * table.height + windows[:, 1]
        rows = [areas.cumsum() - areas, first * table.width + windows[:, 0], *windows.T[2:]]
        numbers = torch.as_tensor(np.stack([*rows, *places[part].T])).to(self._device)
        figures = torch.as_tensor(table.figures[part].T.copy()).to(self._device)
        patch = torch.repeat_interleave(
            torch.arange(len(areas), device=self._device),
            torch.as_tensor(areas).to(self._device),
            output_size=int(areas.sum()),
        )
        start, target, width, height = (numbers[i][patch] for i in range(4))
        local = torch.arange(len(patch), device=self._device) - start
        v, u = local // width, local % width
        seen = _bilinear(self._pixels, u, v, numbers[4:], figures, patch)
        seen = _recolored(seen, figures[9:14, :, None], patch)
        blurred = (figures[14] > 0)[patch].nonzero()[:, 0]
        if len(blurred):
            at = (blurred, start[blurred], u[blurred], v[blurred], width[blurred], height[blurred])
            seen[blurred] = _blurred(seen, figures[14][patch[blurred]], *at)
        seen += torch.randn_like(seen) * figures[15][patch][:, None]
        out[target + v * table.width + u] = seen.round_().clamp_(0, 255).to(torch.uint8)


def _bilinear(
    pixels: UInt8[Tensor, "n 3"],
    u: Int64[Tensor, "m"],
    v: Int64[Tensor, "m"],
    places: Int64[Tensor, "3 p"],
    figures: Float[Tensor, "16 p"],
    patch: Int64[Tensor, "m"],
) -> Float[Tensor, "m 3"]:
    xx, xy, x0, yx, yy, y0 = (figures[i][patch] for i in range(6))
    x, y = xx * u + xy * v + x0, yx * u + yy * v + y0
    left, top = x.floor(), y.floor()
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    first, width, height = (places[i][patch] for i in range(3))
    fill = figures[6:9].T.contiguous()[patch]
    seen = torch.zeros_like(fill)
    for dy, dx in itertools.product((0, 1), (0, 1)):
        column, row = left.long() + dx, top.long() + dy
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        index = torch.where(inside, first + row * width + column, first)
        value = torch.where(inside[:, None], pixels[index].float(), fill)
        seen += value * (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
    return seen.round_()


def _recolored(
    seen: Float[Tensor, "m 3"], figures: Float[Tensor, "5 p 1"], patch: Int64[Tensor, "m"]
) -> Float[Tensor, "m 3"]:
    gamma, saturation = figures[0][patch], figures[4][patch]
    gains = figures[1:4, :, 0].T.contiguous()[patch]
    seen = ((seen / 255).pow_(gamma) * gains * 255 + 0.5).clamp_(0, 255).floor_()
    grey = seen @ torch.tensor(LUMA, device=seen.device)[:, None]
    return (seen * saturation + grey * (1 - saturation)).round_().clamp_(0, 255)


def _blurred(
    seen: Float[Tensor, "m 3"],
    sigma: Float[Tensor, "k"],
    index: Int64[Tensor, "k"],
    start: Int64[Tensor, "k"],
    u: Int64[Tensor, "k"],
    v: Int64[Tensor, "k"],
    width: Int64[Tensor, "k"],
    height: Int64[Tensor, "k"],
) -> Float[Tensor, "k 3"]:
    """Blurred within the window, mirrored at its edges as OpenCV does."""
    reached = range(-BLUR_TAPS, BLUR_TAPS + 1)
    taps = torch.tensor(list(reached), device=seen.device)
    reach = (6 * sigma + 1).round().long() // 2  # half of OpenCV's size for bytes, made odd
    weights = torch.exp(-0.5 * (taps / sigma[:, None]) ** 2) * (taps.abs() <= reach[:, None])
    weights = weights / weights.sum(1, keepdim=True)
    across = torch.zeros_like(seen)
    for i, tap in enumerate(reached):
        across[index] += weights[:, i, None] * seen[start + v * width + _mirrored(u + tap, width)]
    total = torch.zeros_like(seen[index])
    for i, tap in enumerate(reached):
        total += weights[:, i, None] * across[start + _mirrored(v + tap, height) * width + u]
    return total.round_()


def _mirrored(place: Int64[Tensor, "k"], size: Int64[Tensor, "k"]) -> Int64[Tensor, "k"]:
    last = size - 1
    return (last - (last - place.abs()).abs()).clamp_min_(0)
