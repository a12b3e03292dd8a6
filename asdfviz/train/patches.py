"""What a network input shows, patch by patch: where each is cut out of a picture, and its colours.

Plans are drawn apart from pixels, so that a GPU can cut what processes on CPU cores have planned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64, UInt8

from asdfviz.geometry.shapes import Rgb
from asdfviz.train.augment import Marks, Sample
from asdfviz.train.dataset import LabelledImage

LUMA = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in grey."""


@dataclass(frozen=True, slots=True)
class ColorConfig:
    """How strongly colours vary."""

    gain: float = 0.35
    """Brightness: factor up to 1 +- this."""
    gamma: float = 0.3
    """Log of the gamma, +-."""
    balance: float = 0.1
    """Factor of each channel, 1 +-."""
    saturation: float = 0.35
    """Distance from grey: factor 1 +-."""
    blur: float = 0.2
    """Probability of a blur (sigma up to 1.2 px)."""
    noise: float = 0.4
    """Probability of pixel noise (sigma up to 10 of 255)."""


@dataclass(frozen=True, slots=True)
class ColorChange:
    """Other light and another camera."""

    gamma: float
    gains: tuple[float, float, float]
    """Of red, green and blue, after the gamma."""
    saturation: float
    blur: float
    """Sigma, pixels; 0 for none."""
    noise: float
    """Sigma, of 255; 0 for none."""
    seed: int
    """Of the noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A window of an input, filled by an affine view of a picture."""

    image: int
    """Which of the packer's pictures."""
    H: Float64[np.ndarray, "3 3"]
    """Maps its pixels to the window's (integer = centre)."""
    x: int
    """First column of the window in the input."""
    y: int
    """First row of it."""
    width: int
    height: int
    fill: tuple[int, int, int]
    """Colour of what the picture does not cover."""
    colors: ColorChange


@dataclass(frozen=True, slots=True, eq=False)
class InputPlan:
    """A network input before it has pixels; its patches cover it, without overlap."""

    width: int
    height: int
    patches: tuple[Patch, ...]
    marks: Marks


def draw_colors(rng: np.random.Generator, config: ColorConfig) -> ColorChange:
    """Choose other light and another camera."""
    gamma = float(np.exp(rng.uniform(-config.gamma, config.gamma)))
    gains = (1 + rng.uniform(-config.gain, config.gain)) * (
        1 + rng.uniform(-config.balance, config.balance, 3)
    )
    saturation = 1 + rng.uniform(-config.saturation, config.saturation)
    blur = rng.uniform(0.3, 1.2) if rng.random() < config.blur else 0.0
    noise, seed = 0.0, 0
    if rng.random() < config.noise:
        seed, noise = int(rng.integers(2**31 - 1)), rng.uniform(1.0, 10.0)
    red, green, blue = gains.tolist()
    return ColorChange(gamma, (red, green, blue), saturation, blur, noise, seed)


def change_colors(rgb: Rgb, change: ColorChange) -> Rgb:
    """Return the picture under other light and another camera."""
    ramp = (np.arange(256) / 255.0) ** change.gamma
    table = np.clip(ramp[:, None] * np.array(change.gains) * 255 + 0.5, 0, 255).astype(np.uint8)
    out = cv2.LUT(rgb, table[None])
    mix = np.eye(3) * change.saturation + (1 - change.saturation) * np.array([LUMA] * 3)
    out = cv2.transform(out, mix)
    if change.blur > 0:
        out = cv2.GaussianBlur(out, (0, 0), change.blur)
    if change.noise > 0:
        grain = np.empty(out.shape, np.int16)
        cv2.setRNGSeed(change.seed)
        cv2.randn(grain, np.zeros(3), np.full(3, change.noise))
        out = cv2.add(out, grain, dtype=cv2.CV_8U)
    return np.asarray(out, np.uint8)


def cut_patch(rgb: Rgb, patch: Patch) -> UInt8[np.ndarray, "rows columns 3"]:
    """Return the pixels of a patch of this picture."""
    size = (patch.width, patch.height)
    seen = cv2.warpAffine(
        rgb, patch.H[:2], size, flags=cv2.INTER_LINEAR, borderValue=patch.fill
    ).astype(np.uint8, copy=False)
    return change_colors(seen, patch.colors)


def cut_input(images: Sequence[LabelledImage], plan: InputPlan) -> Sample:
    """Return a planned input with its pixels.

    Args:
        images: those that it was planned with.
        plan: what it shows.
    """
    rgb = np.zeros((plan.height, plan.width, 3), np.uint8)
    for patch in plan.patches:
        window = rgb[patch.y : patch.y + patch.height, patch.x : patch.x + patch.width]
        window[:] = cut_patch(images[patch.image].rgb, patch)
    return Sample(rgb, plan.marks)
