"""Grounds that look like the user's own table: photos of it, laid out on the plane.

A network that has seen the bench it will work over takes less of it for parts. A photo is already lit,
so what it shows counts as the colour of the table; that is dark or pale enough to be lit once more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float32, Float64
from torch import Tensor
from torch.nn.functional import grid_sample

from asdfviz.data.images import read_rgb
from asdfviz.errors import InputError
from asdfviz.synth.description import Ground, Photo
from asdfviz.synth.looks import any_grounds, linear, theatre
from asdfviz.synth.tensors import to_tensor

LARGEST_PX = 1600
"""Of a photo's longer side; larger ones are halved first."""
LEAST_PX = 64
"""A photo that is smaller shows no table."""
ALBEDO = (0.2, 0.6)
"""Where the mean of a photo lies once it is a colour, linear; a white bench is as bright as paper."""
SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True, slots=True)
class Photos:
    """Which photos there are, and how often they are the ground."""

    files: tuple[str, ...] = ()
    """None: all grounds are drawn."""
    width: float = 0.6
    """Metres that the longer side of a photo shows."""
    share: float = 0.7
    """Share of the scenes whose table is one of the photos."""


def find_photos(
    folder: Path,
    *,
    width: float,
    share: float,
    progress: Callable[[int, int], object] | None = None,
) -> Photos:
    """The photos in a folder, each of them looked at.

    Args:
        folder: JPEG or PNG files.
        width: metres that the longer side of a photo shows.
        share: of the scenes.
        progress: told how many of the photos were looked at, and how many there are.

    Raises:
        InputError: the folder is missing or has no photo, one is too small, or a figure is impossible.
        SequenceError: a photo cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; give one with photos of your empty table")
    if not 0.02 <= width <= 20:
        raise InputError(
            f"ground_width is {width:g}, give the metres that a photo shows, 0.02 to 20"
        )
    if not 0 < share <= 1:
        raise InputError(f"ground_share is {share:g}, give one above 0 and up to 1")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES)
    if not files:
        raise InputError(f"{folder} has no .jpg or .png file; give photos of your empty table")
    for place, file in enumerate(files, start=1):
        height, wide = read_rgb(file).shape[:2]
        if min(height, wide) < LEAST_PX:
            raise InputError(
                f"{file} is {wide} x {height} pixels, give photos of {LEAST_PX} or more each way"
            )
        if progress is not None:
            progress(place, len(files))
    return Photos(tuple(str(f.resolve()) for f in files), width, share)


def recorded(config: dict[str, Any], photos: Photos) -> dict[str, Any]:
    """What a folder notes of how it is drawn: of photos their names, and nothing where there are none.

    Args:
        config: fields and values, `photos` among them.
        photos: which these are.
    """
    noted = {name: value for name, value in config.items() if name != "photos"}
    if not photos.files:
        return noted
    names = [Path(file).name for file in photos.files]
    return {**noted, "photos": {**config["photos"], "files": names}}


def choose_grounds(
    points: Float64[np.ndarray, "n 2"],
    rng: np.random.Generator,
    *,
    theatre_share: float | None,
    photos: Photos,
) -> tuple[Ground, ...]:
    """Tables and floors of a scene, from the topmost to the lowest.

    Args:
        points: where things stand on the table, metres.
        rng: throws; without photos the same ones as ever.
        theatre_share: probability of the blue drape of the paper's recordings; None: never.
        photos: of the user's table, which come before the drape.
    """
    if photos.files and rng.random() < photos.share:
        top, *below = any_grounds(points, rng)
        return (photographed(top, photos, rng), *below)
    if theatre_share is not None and rng.random() < theatre_share:
        return theatre(points, rng)
    return any_grounds(points, rng)


def photographed(ground: Ground, photos: Photos, rng: np.random.Generator) -> Ground:
    """The ground with a photo's looks: turned, shifted, a little brighter, warmer or larger."""
    file = photos.files[int(rng.integers(len(photos.files)))]
    width = photos.width * float(np.exp(rng.normal() * 0.08))
    mean = _levels(file)[-1].mean(axis=(0, 1)).astype(np.float64)
    bright = float(np.clip(mean.mean(), *ALBEDO) / max(float(mean.mean()), 1e-3))
    gain = bright * np.exp(rng.normal() * 0.15 + rng.normal(size=3) * 0.04)
    colors = np.stack([np.clip(mean * gain, 0.002, 0.95)] * 3)
    return replace(ground, photo=Photo(file, width, gain), colors=colors, roughness=0.95)


def photo_looks(
    photo: Photo, u: Float32[Tensor, "p"], v: Float32[Tensor, "p"], footprint: float
) -> Float32[Tensor, "p 3"]:
    """Albedo at points of a photo that lies on a plane; it is mirrored beyond its borders.

    Args:
        photo: what lies there.
        u: metres to the right of its middle.
        v: metres up from it.
        footprint: a pixel's size on the plane, metres.
    """
    levels = _levels(photo.file)
    high, wide = levels[0].shape[:2]
    texel = photo.width / max(high, wide)
    finest = round(float(np.log2(max(footprint / texel, 1.0))))
    image = _level(photo.file, min(finest, len(levels) - 1), str(u.device))
    # Rows of a picture go down.
    grid = torch.stack([u * (2 / (wide * texel)), -v * (2 / (high * texel))], dim=1)[None, None]
    seen = grid_sample(
        image[None], grid, mode="bilinear", padding_mode="reflection", align_corners=False
    )[0, :, 0]
    gain = to_tensor(photo.gain, u.device, dtype=torch.float32)
    return (seen.T * gain).clamp(0.002, 0.95)


@lru_cache(maxsize=8)
def _level(file: str, level: int, device: str) -> Float32[Tensor, "3 h w"]:
    """One of a photo's levels on a device: frames of a sequence show the same one."""
    return to_tensor(np.ascontiguousarray(_levels(file)[level].transpose(2, 0, 1)), device)


@lru_cache(maxsize=8)
def _levels(file: str) -> Sequence[Float32[np.ndarray, "h w 3"]]:
    """A photo in linear RGB, halved again and again."""
    image = read_rgb(Path(file))
    while max(image.shape[:2]) > LARGEST_PX:
        image = _halved(image)
    levels = [linear(image).astype(np.float32)]
    while min(levels[-1].shape[:2]) >= 8:
        levels.append(_halved(levels[-1]))
    return levels


def _halved(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    return np.asarray(
        cv2.resize(image, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    )
