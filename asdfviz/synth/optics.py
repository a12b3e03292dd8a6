"""What a colour module does to a picture beyond light and noise: fringes, highlights, sharpening."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32

Linear = Float32[np.ndarray, "h w 3"]

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""ITU-R BT.601."""


def fringed(image: Linear, shift_px: float) -> Linear:
    """Red drawn larger and blue smaller than green, by `shift_px` in the image's corners."""
    height, width = image.shape[:2]
    center = np.array([(width - 1) / 2, (height - 1) / 2])
    planes = list(cv2.split(image))
    for channel, sign in ((0, -1.0), (2, 1.0)):
        scale = 1 + sign * shift_px / float(np.hypot(*center))
        M = np.column_stack([np.eye(2) * scale, center * (1 - scale)])
        planes[channel] = cv2.warpAffine(
            planes[channel],
            M,
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return np.asarray(cv2.merge(planes), np.float32)


def rolled_off(image: Linear, knee: float) -> Linear:
    """The picture with its highlights compressed, as a camera's tone curve does it.

    What is above `knee` comes ever slower to 1: v becomes 1 - (1 - knee) exp((knee - v) / (1 - knee)),
    which goes on from the rest without a bend. Half of each pixel is compressed channel by channel,
    which makes bright colours pale; half as its brightness is, which keeps their hue, and there a
    strong channel may still pass 1.

    Args:
        image: after the gamma curve; a camera without compression would cut it off at 1.
        knee: 0 to 1, without 1.
    """
    # Most of a picture is below the knee: the exponential is taken of the rest alone.
    bright = np.maximum(np.maximum(image[:, :, 0], image[:, :, 1]), image[:, :, 2]) > knee
    result, pixels = image.copy(), image[bright]
    light = (pixels.max(axis=1, keepdims=True) + pixels.mean(axis=1, keepdims=True)) / 2
    light = np.maximum(light, knee)  # below it nothing changes
    alike = pixels * (_compressed(light, knee) / light)
    result[bright] = (_compressed(pixels, knee) + alike) / 2
    return result


def _compressed(light: Float32[np.ndarray, "n c"], knee: float) -> Float32[np.ndarray, "n c"]:
    head = 1 - knee
    above = np.maximum(light - knee, 0)
    return np.minimum(light, knee) - head * np.expm1(-above / head)


def developed(image: Linear, *, sharpening: float, halo_px: float, thin_px: float) -> Linear:
    """Sharpen the brightness, with a halo, and blur the colour, as cameras and video coding do.

    Args:
        image: after the gamma curve.
        sharpening: strength.
        halo_px: deviation of the blur that is taken off.
        thin_px: deviation of the colour's blur.
    """
    height, width = image.shape[:2]
    luma = image @ LUMA
    half = (max(1, width // 2), max(1, height // 2))
    chroma = cv2.resize(image - luma[:, :, None], half, interpolation=cv2.INTER_AREA)
    if thin_px > 0:
        chroma = cv2.GaussianBlur(chroma, (0, 0), thin_px / 2)
    chroma = cv2.resize(chroma, (width, height), interpolation=cv2.INTER_LINEAR)
    if sharpening > 0:
        luma = luma + sharpening * (luma - cv2.GaussianBlur(luma, (0, 0), halo_px))
    return np.asarray(chroma + luma[:, :, None], np.float32)


def grain(rng: np.random.Generator, height: int, width: int, *, colored: bool) -> Linear:
    """Noise of deviation 1 whose neighbours agree; `colored` adds blotches of colour.

    Its spectrum is that of two real frames' difference: a camera smooths what it delivers, so two
    thirds of it are several pixels wide.
    """
    noise = rng.standard_normal((height, width, 3), dtype=np.float32)
    if width > 512:
        fine = cv2.GaussianBlur(noise, (0, 0), 0.8)
        coarse = cv2.resize(noise[::3, ::3], (width, height), interpolation=cv2.INTER_CUBIC)
        noise = 0.4 * noise + 0.96 * fine + 0.75 * coarse
    if colored:
        # Wide blotches stray between warm and cold, hardly between green and magenta.
        for step, strength, green in ((4, 0.25, 1.0), (12, 0.33, 0.35)):
            size = (max(2, height // step), max(2, width // step), 3)
            cells = rng.standard_normal(size, dtype=np.float32)
            cells *= np.array([1.0, green, 1.0], np.float32)
            cells = np.asarray(cells - cells.mean(axis=2, keepdims=True), np.float32)
            wide = cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC)
            noise = noise + strength * wide
        # Cameras smooth colour more than brightness.
        gray = noise.mean(axis=2, keepdims=True)
        noise = gray * 1.1 + (noise - gray) * 0.82
    return np.asarray(noise, np.float32)
