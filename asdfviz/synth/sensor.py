"""The colour camera's faults, as a cheap RGB module has them (an Azure Kinect's, 1280x720)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.shapes import Mask, Rgb
from asdfviz.synth.optics import developed, fringed, grain, rolled_off

Linear = Float32[np.ndarray, "h w 3"]
Plane = Float32[np.ndarray, "h w"]

GLOW_PX = 3.0
"""How far the lens scatters most of what it scatters, at 1280 pixels width."""


@dataclass(frozen=True, slots=True)
class RgbSensor:
    """One setting of the colour camera."""

    exposure: float = 0.42
    """Linear value that the light of the image, as metered, is brought to."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    vignette: float = 0.12
    """Loss of light in the corners."""
    shading: tuple[float, float] = (0.0, 0.0)
    """Further loss of red and of blue there; below 0 there is more of them."""
    blur_px: float = 0.6
    """Lens and demosaicing, at 1280 pixels width."""
    softness_px: float = 0.0
    """Blur that the lens adds in the corners, at 1280 pixels width."""
    noise: float = 0.006
    """Standard deviation of the noise at a linear value of 0.28; grows with the root of the light."""
    flare: float = 0.01
    """Light scattered over the whole image, as a share of the mean."""
    glow: float = 0.0
    """Share of the light that the lens scatters around where it belongs: dark things are paler at their edges."""
    contrast: float = 1.0
    saturation: float = 1.0
    sharpening: float = 0.0
    """Strength of the camera's own sharpening."""
    thin_px: float = 0.0
    """Blur of the colour beside the brightness, at 1280 pixels width."""
    fringe_px: float = 0.0
    """How far red and blue lie from green in the corners, at 1280 pixels width."""
    knee: float = 0.65
    """Value of the picture, 0 to 1, above which highlights are rolled off; in real frames about 0.9."""
    jpeg_quality: int = 92
    motion_px: tuple[float, float] = (0.0, 0.0)
    """Movement of the camera while the shutter was open."""


def random_rgb_sensor(rng: np.random.Generator) -> RgbSensor:
    """Draw a setting, from a good camera in good light to a poor one."""
    temperature = rng.normal() * 0.06
    motion = rng.normal(size=2) * 3.0 if rng.random() < 0.12 else np.zeros(2)
    exposure = float(rng.uniform(0.26, 0.56))
    if exposure > 0.55:  # one in thirty fails; a draw of its own would change all that follow
        exposure *= 2.2
    return RgbSensor(
        exposure=exposure,
        white_balance=(
            float(1 + temperature),
            float(1 + rng.normal() * 0.015),
            float(1 - temperature + rng.normal() * 0.02),
        ),
        vignette=float(rng.uniform(0, 0.3)),
        blur_px=float(rng.uniform(0.4, 1.4)),
        softness_px=float(max(0.0, rng.uniform(-1.0, 1.6))),
        noise=float(rng.uniform(0.0015, 0.0075)),
        flare=float(rng.uniform(0.0, 0.09)),
        contrast=float(rng.uniform(0.92, 1.25)),
        saturation=float(rng.uniform(0.85, 1.35)),
        sharpening=float(max(0.0, rng.uniform(-0.5, 1.4))),
        knee=float(rng.uniform(0.5, 0.9)),
        thin_px=float(max(0.0, rng.uniform(-1.0, 2.0))),
        fringe_px=float(rng.normal() * 0.6),
        jpeg_quality=int(rng.integers(78, 97)),
        motion_px=(float(motion[0]), float(motion[1])),
        shading=(float(rng.normal() * 0.06), float(rng.normal() * 0.1 + 0.05)),
        glow=float(rng.uniform(0.0, 0.05)),
    )


def motion_kernel(dx: float, dy: float) -> Plane:
    """A line of the given extent in pixels, normalised."""
    reach = int(np.ceil(max(abs(dx), abs(dy), 1) / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    for t in np.linspace(-0.5, 0.5, 4 * reach + 1):
        x, y = reach + t * dx, reach + t * dy
        x0, y0 = int(np.floor(x)), int(np.floor(y))
        for u, v in ((x0, y0), (x0 + 1, y0), (x0, y0 + 1), (x0 + 1, y0 + 1)):
            if 0 <= u <= 2 * reach and 0 <= v <= 2 * reach:
                kernel[v, u] += max(0.0, 1 - abs(x - u)) * max(0.0, 1 - abs(y - v))
    return kernel / kernel.sum()


def blur_moving(radiance: Linear, mask: Mask, motion_px: tuple[float, float]) -> Linear:
    """Smear what moves (`mask`) along its motion over what stands still."""
    kernel = motion_kernel(*motion_px)
    weight = cv2.filter2D(mask.astype(np.float32), -1, kernel)
    moved = cv2.filter2D(radiance * mask[:, :, None].astype(np.float32), -1, kernel)
    still = radiance * (~mask)[:, :, None].astype(np.float32)
    # Behind the moving thing nothing was rendered; its rim is filled from what surrounds it.
    spread = max(1.0, float(np.hypot(*motion_px)) / 2)
    around = cv2.GaussianBlur((~mask).astype(np.float32), (0, 0), spread)
    filled = cv2.GaussianBlur(still, (0, 0), spread) / np.maximum(around, 1e-3)[:, :, None]
    background = np.where((mask & (around > 0.02))[:, :, None], filled, still)
    background = np.where((mask & (around <= 0.02))[:, :, None], radiance, background)
    return np.asarray(moved + background * (1 - weight)[:, :, None], np.float32)


def metered(image: Linear) -> float:
    """The linear value that sets the exposure: bright things count for less, the smaller they are.

    So a white part on a dark table keeps its shading, and a glint does not darken the picture.
    """
    middle, bright, small = np.percentile(image[::4, ::4].mean(axis=2), [80, 98, 99.7])
    return max(float(middle), 0.5 * float(bright), 0.25 * float(small))


def photograph(radiance: Linear, *, sensor: RgbSensor, rng: np.random.Generator) -> Rgb:
    """Turn radiance into the 8-bit image that the camera would deliver."""
    height, width = radiance.shape[:2]
    scale = width / 1280
    image: np.ndarray = radiance * np.array(sensor.white_balance, np.float32)
    image = image * np.float32(sensor.exposure / max(metered(image), 1e-4))
    image = (image + sensor.flare * image.mean(axis=(0, 1))) / (1 + sensor.flare)
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    losses = np.array([sensor.shading[0], 0.0, sensor.shading[1]], np.float32) + sensor.vignette
    image *= 1 - losses * ((x * x + y * y) / 2)[:, :, None]
    if abs(sensor.fringe_px) * scale > 0.1:
        image = fringed(image.astype(np.float32), sensor.fringe_px * scale)
    image = cv2.GaussianBlur(image, (0, 0), max(sensor.blur_px * scale, 0.25))
    if sensor.glow > 0:
        image += sensor.glow * (cv2.GaussianBlur(image, (0, 0), GLOW_PX * scale) - image)
    if sensor.softness_px * scale > 0.3:
        soft = cv2.GaussianBlur(image, (0, 0), sensor.softness_px * scale)
        image = image + (soft - image) * np.minimum((x * x + y * y) / 1.6, 1)[:, :, None]
    if any(abs(m) * scale > 0.6 for m in sensor.motion_px):
        image = cv2.filter2D(image, -1, motion_kernel(*(m * scale for m in sensor.motion_px)))
    speckle = grain(rng, height, width, colored=sensor.thin_px > 0)
    # Mostly shot noise: cameras smooth the dark parts themselves.
    image = image + speckle * sensor.noise * np.sqrt(0.004 + 3.4 * np.maximum(image, 0))
    gray = (image @ np.full(3, 1 / 3, np.float32))[:, :, None]
    image = gray + (image - gray) * sensor.saturation
    image = np.maximum(image, 0) ** np.float32(1 / 2.2)
    image = rolled_off((0.5 + (image - 0.5) * sensor.contrast).astype(np.float32), sensor.knee)
    halo, thin = max(1.2 * scale, 0.4), sensor.thin_px * scale
    if sensor.sharpening > 0 or thin > 0:
        image = developed(image, sharpening=sensor.sharpening, halo_px=halo, thin_px=thin)
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)
