"""The camera's faults: colour as a cheap RGB module gives it, depth as a time-of-flight camera does.

Modelled after an Azure Kinect's 1280x720 colour image with depth warped into it (narrow view, 2x2
binned); the constants were read off real frames: smeared edges about 10 px wide, holes on black
plastic and at edges, a hexagonal field of view that leaves 40 % of the image without depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.shapes import Depth, Mask, Rgb
from asdfviz.synth.kinect import CENTER, FOCAL, KINECT_LENS, whole_image
from asdfviz.synth.optics import developed, fringed, grain, rolled_off

FIELD_OF_VIEW = np.array(
    [[188, 462], [247, 115], [376, 0], [890, 0], [1041, 250], [1044, 442], [886, 719], [323, 719]]
) / np.array([1280.0, 720.0])
"""Outline of the depth image within the colour image, as shares of width and height."""

Linear = Float32[np.ndarray, "h w 3"]
Plane = Float32[np.ndarray, "h w"]


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


@dataclass(frozen=True, slots=True)
class DepthSensor:
    """One setting of the depth camera; pixels are those of an image 1280 wide."""

    noise: float = 0.0019
    """Standard deviation of the range at 0.6 m, metres; grows with the square of the range."""
    smear_px: float = 7.0
    """Width of the ramps at depth edges."""
    trail_px: float = 11.0
    """Width of the longer ramps on the side of near things away from the illuminator."""
    dark_albedo: float = 0.014
    """Below this linear albedo returns are lost now and then, or come too far."""
    dark_loss: float = 0.4
    """Share of lost returns on black."""
    edge_jump: float = 0.045
    """Depth step, metres, beyond which the side away from the illuminator is lost."""
    field_of_view: bool = True
    shift_px: tuple[float, float] = (0.0, 0.0)
    """Misregistration of depth against colour."""
    lens: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Radial coefficients k1, k2, k3 of a colour lens that nobody took out of the colour image: depth
    then lies nearer to the image's centre than colour does."""
    bias: float = 0.0
    """Constant range error, metres."""


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
    )


def random_depth_sensor(rng: np.random.Generator, *, shifted: bool = False) -> DepthSensor:
    """Draw a setting; `shifted` adds a misregistration and half the time the real frames' lens."""
    shift = (float(rng.normal() * 3), float(rng.normal() * 1.5)) if shifted else (0.0, 0.0)
    return DepthSensor(
        noise=float(rng.uniform(0.0008, 0.003)),
        smear_px=float(rng.uniform(3, 10)),
        trail_px=float(rng.uniform(2, 20)),
        dark_loss=float(rng.uniform(0.1, 0.5)),
        edge_jump=float(rng.uniform(0.03, 0.09)),
        field_of_view=bool(rng.random() < 0.7),
        shift_px=shift,
        lens=KINECT_LENS if shifted and rng.random() < 0.5 else (0.0, 0.0, 0.0),
        bias=float(rng.normal() * 0.002),
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


def measure_depth(
    depth: Depth,
    albedo: Plane,
    *,
    sensor: DepthSensor,
    rng: np.random.Generator,
) -> Depth:
    """Turn true planar depth (0 = nothing there) into what the camera would report.

    Args:
        depth: exact depth, metres.
        albedo: mean linear albedo at every pixel.
        sensor: the setting.
        rng: source of noise.
    """
    height, width = depth.shape
    whole = whole_image(width, height)[0]
    scale = whole / 1280
    known = depth > 0
    far = float(depth.max()) if known.any() else 1.0
    filled = np.where(known, depth, far).astype(np.float32)
    darkness = np.clip(1.4 - albedo / sensor.dark_albedo, 0, 1)
    measured = _smeared(filled, sensor, scale)
    spread = sensor.noise * (filled / 0.6) ** 2
    measured += _range_noise(rng, height, width) * spread + sensor.bias + 0.005 * darkness
    # Seen from the illuminator, 32 mm aside, the far side of a high step lies in shadow.
    reach = max(1, round(0.032 * FOCAL * whole / far * 0.3))
    shadow = np.zeros_like(known)
    shadow[:, reach:] = (filled[:, reach:] - filled[:, :-reach]) > sensor.edge_jump
    share = np.clip(sensor.dark_loss * darkness, 1e-6, 1 - 1e-6)
    # The logistic curve stands for the normal one (Bowling et al. 2009).
    lost = _patches(rng, height, width, scale) < np.log(share / (1 - share)) / 1.702
    measured = np.where(shadow | lost | ~known, 0, measured).astype(np.float32)
    measured = _misregistered(measured, sensor, scale)
    if sensor.field_of_view:
        measured[~field_of_view(height, width)] = 0
    return measured


def _smeared(depth: Plane, sensor: DepthSensor, scale: float) -> Plane:
    """Depth with edges drawn out, the long ramps to the right of near things."""
    height, width = depth.shape
    reach = round(sensor.trail_px * scale)
    if reach > 1:
        trailing = cv2.blur(depth, (reach, 1), anchor=(reach - 1, 0))
        depth = np.minimum(depth, trailing)
    soft = cv2.GaussianBlur(depth, (0, 0), max(sensor.smear_px * scale / 3, 0.3))
    coarse = (max(2, round(width * 0.5)), max(2, round(height * 0.5)))
    return cv2.resize(cv2.resize(soft, coarse, interpolation=cv2.INTER_AREA), (width, height))


def _range_noise(rng: np.random.Generator, height: int, width: int) -> Plane:
    """Noise of deviation 1 whose neighbours agree: over 5, 13 and 64 pixels at 1280 width."""
    total = np.zeros((height, width), np.float32)
    for cells, weight in ((256, 0.42), (96, 0.62), (20, 0.66)):
        size = (cells, max(2, cells * height // width))
        grain = rng.standard_normal((size[1], size[0]), dtype=np.float32)
        # Cubic interpolation keeps about seven tenths of the deviation.
        total += weight * 1.35 * cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC)
    return total


def _patches(rng: np.random.Generator, height: int, width: int, scale: float) -> Plane:
    """Smooth noise of about deviation 1, from which lost patches are cut."""
    total = np.zeros((height, width), np.float32)
    for size_px, weight in ((28, 0.9), (8, 0.44)):
        rows, columns = (max(2, round(n / (size_px * scale))) for n in (height, width))
        grain = rng.standard_normal((rows, columns), dtype=np.float32)
        total += weight * 1.35 * cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC)
    return total


def _misregistered(measured: Plane, sensor: DepthSensor, scale: float) -> Plane:
    """Depth moved against colour: p shows what colour has at lens(p - shift)."""
    if sensor.shift_px == (0.0, 0.0) and not any(sensor.lens):
        return measured
    height, width = measured.shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    whole = np.array(whole_image(width, height))
    focal = FOCAL * float(whole[0])
    cx, cy = CENTER * whole + ([width, height] - whole) / 2
    x = (u - sensor.shift_px[0] * scale - cx) / focal
    y = (v - sensor.shift_px[1] * scale - cy) / focal
    r2 = x * x + y * y
    k1, k2, k3 = sensor.lens
    stretch = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    at_u = (x * stretch * focal + cx).astype(np.float32)
    at_v = (y * stretch * focal + cy).astype(np.float32)
    return cv2.remap(measured, at_u, at_v, cv2.INTER_NEAREST)


def field_of_view(height: int, width: int) -> Mask:
    """Where the depth camera sees at all."""
    mask = np.zeros((height, width), np.uint8)
    outline = np.round(FIELD_OF_VIEW * [width, height]).astype(np.int32)
    cv2.fillPoly(mask, [outline], 1)
    return mask.astype(bool)
