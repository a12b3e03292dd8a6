"""Training crops as data: made from scenes, photographed, kept in files."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64, UInt8
from torch import Tensor
from torch.nn.functional import conv2d, pad

from asdfviz.data.atomic import write_bytes
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.synth.tensors import to_tensor
from asdfviz.train.crop_render import render_crops
from asdfviz.train.crop_scenes import CropConfig, CropDrawer, CropScene

LEAST_VISIBLE = 0.2
"""Crops that show less of the part teach nothing."""
BATCH = 64
"""Crops rendered at once."""
SIGMAS = (0.4, 0.6, 0.9, 1.3, 1.9, 2.8, 4.0)
"""Blurs in stored pixels, each for the crops whose own is nearest below it."""


@dataclass(frozen=True, slots=True, eq=False)
class Crops:
    """Many crops, on the CPU or a GPU."""

    pictures: UInt8[Tensor, "n 4 h w"]
    """RGB, and 255 where the part is visible."""
    labels: Int64[Tensor, "n"]
    """Class."""
    states: Int64[Tensor, "n"]
    """The place of what is shown among the network's states; -1 for a part."""
    names: Int64[Tensor, "n"]
    """The class that is shown, or the number of classes for nothing that is known; -1 for a group."""
    T_crop_part: Float32[Tensor, "n 4 4"]
    focal: Float32[Tensor, "n"]
    """Pixels; the principal point is the middle."""
    outlined: Bool[Tensor, "n"]
    """Whether it is known where the part is visible."""

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def joined(cls, several: Sequence[Crops]) -> Crops:
        """All of several."""
        return cls(*(torch.cat([getattr(c, f.name) for c in several]) for f in fields(cls)))

    def taken(self, rows: Int64[Tensor, "k"]) -> Crops:
        """Some rows."""
        return Crops(*(getattr(self, f.name)[rows] for f in fields(self)))

    def groups(self) -> Crops:
        """Those that show groups."""
        return self.taken((self.states >= 0).nonzero()[:, 0])

    def to(self, device: str) -> Crops:
        """The same on a device."""
        return Crops(*(getattr(self, f.name).to(device) for f in fields(self)))

    def save(self, path: Path) -> None:
        """Write a .npz atomically, not compressed."""
        buffer = io.BytesIO()
        np.savez(buffer, **{f.name: getattr(self, f.name).cpu().numpy() for f in fields(self)})
        write_bytes(path, buffer.getvalue())

    @classmethod
    def load(cls, path: Path) -> Crops:
        """Read what `save` wrote.

        Raises:
            InputError: missing, cut short or something else.
        """
        try:
            with path.open("rb") as raw, np.load(raw) as file:
                return cls(*(torch.as_tensor(file[f.name]) for f in fields(cls)))
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"'{path}' does not hold training crops: {error}") from error


class CropMaker:
    """Makes crops of all parts and groups of several assemblies."""

    def __init__(
        self,
        assemblies: Sequence[Assembly],
        *,
        config: CropConfig | None = None,
        device: str = "cpu",
    ) -> None:
        self._drawer = CropDrawer(assemblies, config=config or CropConfig(), device=device)
        self.classes = self._drawer.classes
        self.labels = self._drawer.labels

    def make(
        self, count: int, *, rng: np.random.Generator, labels: Sequence[int] | None = None
    ) -> Crops:
        """So many crops; their classes as `CropConfig` says, or drawn evenly from `labels`."""
        made: list[Crops] = []
        while (missing := count - sum(len(c) for c in made)) > 0:
            batch = min(missing, BATCH)
            drawn = self._drawer.labels(rng, batch)
            wanted = drawn if labels is None else rng.choice(np.asarray(labels), size=batch)
            scenes = [self._drawer.draw(rng, int(label)) for label in wanted]
            rendered = render_crops(scenes, self._drawer.bank, rng=rng)
            shown = rendered.visible.sum((1, 2)) / rendered.silhouette.sum((1, 2)).clamp(min=1)
            rows = (shown >= LEAST_VISIBLE).nonzero()[:, 0]
            rgb = photographed(rendered.radiance, scenes, rng=rng)
            seen = rendered.visible.to(torch.uint8)[:, None] * 255
            device = rgb.device
            whole = Crops(
                torch.cat([rgb, seen], dim=1),
                torch.tensor([s.label for s in scenes], device=device),
                torch.tensor([s.state for s in scenes], device=device),
                torch.tensor([s.name for s in scenes], device=device),
                to_tensor(np.stack([s.T_crop_part for s in scenes]).astype(np.float32), device),
                torch.tensor([s.focal for s in scenes], dtype=torch.float32, device=device),
                torch.ones(len(scenes), dtype=torch.bool, device=device),
            )
            made.append(whole.taken(rows))
        return Crops.joined(made)


def photographed(
    radiance: Float32[Tensor, "3 b h w"], scenes: Sequence[CropScene], *, rng: np.random.Generator
) -> UInt8[Tensor, "b 3 h w"]:
    """Exposure, white balance, blur by lens and by few pixels, noise, tone."""
    device, count = radiance.device, len(scenes)

    def each(low: float, high: float, channels: int = 1) -> Tensor:
        values = rng.uniform(low, high, (count, channels, 1, 1)).astype(np.float32)
        return to_tensor(values, device)

    image = radiance.transpose(0, 1)
    gray = image.mean(1, keepdim=True)
    level = gray.flatten(1)[:, ::16].quantile(0.8, dim=1).view(-1, 1, 1, 1).clamp(min=1e-3)
    image = image * (each(0.2, 0.6) / level) * each(0.92, 1.08, 3)
    coarse = np.array([0.5 / min(s.detail, 1.0) - 0.4 for s in scenes])
    sigmas = np.hypot(rng.uniform(0.3, 0.9, count), np.clip(coarse, 0, 3.5))
    # Noise belongs to the frame's pixels: where the crop is coarse, the blur takes it along.
    boost = to_tensor(np.maximum(1.5 * sigmas, 1.0).astype(np.float32), device).view(-1, 1, 1, 1)
    noise = to_tensor(rng.standard_normal(image.shape, dtype=np.float32), device)
    deviation = each(0.001, 0.012) * boost * (0.3 + image.clamp(min=0)).sqrt()
    image = _blurred(image + noise * deviation, sigmas)
    image = torch.where(image < 0.55, image, 0.55 + 0.45 * torch.tanh((image - 0.55) / 0.45))
    gray = image.mean(1, keepdim=True)
    image = (gray + (image - gray) * each(0.8, 1.3)).clamp(0, 1) ** (1 / 2.2)
    image = (0.5 + (image - 0.5) * each(0.85, 1.25)).clamp(0, 1)
    return (image * 255 + 0.5).to(torch.uint8)


def _blurred(image: Tensor, sigmas: np.ndarray) -> Tensor:
    """Gaussian blur, each picture by the nearest of a few widths."""
    nearest = np.abs(np.log(np.asarray(SIGMAS)[None] / sigmas[:, None])).argmin(axis=1)
    result = torch.empty_like(image)
    for place, sigma in enumerate(SIGMAS):
        rows = torch.as_tensor(np.nonzero(nearest == place)[0], device=image.device)
        if not len(rows):
            continue
        radius = int(np.ceil(2.5 * sigma))
        kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
        taps = to_tensor((kernel / kernel.sum()).astype(np.float32), image.device)
        flat = pad(image[rows].flatten(0, 1)[:, None], (radius,) * 4, mode="replicate")
        flat = conv2d(conv2d(flat, taps.view(1, 1, 1, -1)), taps.view(1, 1, -1, 1))
        result[rows] = flat.view(len(rows), *image.shape[1:])
    return result
