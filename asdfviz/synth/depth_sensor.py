"""The depth camera's faults, as a time-of-flight camera has them.

Modelled after an Azure Kinect's depth, warped into its 1280x720 colour image (narrow view, 2x2
binned); the constants were read off real frames: smeared edges about 10 px wide, what its light
does not reach behind high steps, holes on black plastic, a hexagonal field of view that leaves 40 %
of the image without depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.shapes import Depth, Mask
from asdfviz.synth.kinect import CENTER, FOCAL, KINECT_LENS, whole_image

FIELD_OF_VIEW = np.array(
    [[188, 462], [247, 115], [376, 0], [890, 0], [1041, 250], [1044, 442], [886, 719], [323, 719]]
) / np.array([1280.0, 720.0])
"""Outline of the depth image within the colour image, as shares of width and height."""

ILLUMINATOR = 0.032
"""How far to the left of the camera its light is, metres."""
LONGEST = 36.0
"""No ramp is longer, pixels at 1280 width."""

Plane = Float32[np.ndarray, "h w"]


@dataclass(frozen=True, slots=True)
class DepthSensor:
    """One setting of the depth camera; pixels are those of an image 1280 wide."""

    noise: float = 0.0019
    """Standard deviation of the range at 0.6 m, metres; grows with the square of the range."""
    smear_px: float = 7.0
    """Width of the ramps at depth edges."""
    trail: float = 3.0
    """How far ramps reach to the right of near things, times what these hide from the illuminator:
    little behind a plate that lies on the table, much behind a hand."""
    dark_albedo: float = 0.014
    """Below this linear albedo returns are lost now and then, or come too far."""
    dark_loss: float = 0.4
    """Share of lost returns on black."""
    edge_jump: float = 0.06
    """Depth step, metres, beyond which the far end of such a ramp is lost."""
    field_of_view: bool = True
    shift_px: tuple[float, float] = (0.0, 0.0)
    """Misregistration of depth against colour."""
    lens: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Radial coefficients k1, k2, k3 of a colour lens that nobody took out of the colour image: depth
    then lies nearer to the image's centre than colour does."""
    bias: float = 0.0
    """Constant range error, metres."""


def random_depth_sensor(rng: np.random.Generator, *, shifted: bool = False) -> DepthSensor:
    """Draw a setting; `shifted` adds a misregistration and half the time the real frames' lens."""
    shift = (float(rng.normal() * 3), float(rng.normal() * 1.5)) if shifted else (0.0, 0.0)
    return DepthSensor(
        noise=float(rng.uniform(0.0008, 0.003)),
        smear_px=float(rng.uniform(3, 10)),
        trail=float(rng.uniform(1.0, 4.5)),
        dark_loss=float(rng.uniform(0.1, 0.5)),
        edge_jump=float(rng.uniform(0.03, 0.09)),
        field_of_view=bool(rng.random() < 0.7),
        shift_px=shift,
        lens=KINECT_LENS if shifted and rng.random() < 0.5 else (0.0, 0.0, 0.0),
        bias=float(rng.normal() * 0.002),
    )


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
    drawn_out, shadow = _unlit(filled, sensor, scale)
    measured = _smeared(drawn_out, sensor, scale)
    spread = sensor.noise * (filled / 0.6) ** 2
    measured += _range_noise(rng, height, width) * spread + sensor.bias + 0.005 * darkness
    share = np.clip(sensor.dark_loss * darkness, 1e-6, 1 - 1e-6)
    # The logistic curve stands for the normal one (Bowling et al. 2009).
    lost = _patches(rng, height, width, scale) < np.log(share / (1 - share)) / 1.702
    measured = np.where(shadow | lost | ~known, 0, measured).astype(np.float32)
    measured = _misregistered(measured, sensor, scale)
    if sensor.field_of_view:
        measured[~field_of_view(height, width)] = 0
    return measured


def _unlit(depth: Plane, sensor: DepthSensor, scale: float) -> tuple[Plane, Mask]:
    """Draw near things out over what the illuminator does not reach; and what of that is lost.

    A thing at depth n hides from the illuminator what lies at depth d for b f (1/n - 1/d) pixels to
    its right, b being how far that is from the camera. In the authors' real frames ramps reach three
    times as far, up to 36 pixels: steps of 18, 27, 55 and 77 mm rise from 10 to 90 % over 6, 7, 13
    and 19 pixels, to the left over 4 to 6. Behind those above 65 mm the far end of the ramp is lost,
    as much as is hidden.
    """
    near = np.float32(ILLUMINATOR * FOCAL * 1280 * scale) / depth
    span = float(near.max() - near.min())
    reach = int(min(sensor.trail * span, LONGEST * scale))
    drawn, lost = depth.copy(), np.zeros(depth.shape, bool)
    if reach < 1:
        return drawn, lost
    row = np.ones((1, reach + 1), np.uint8)
    before = cv2.dilate(near, row, anchor=(reach, 0), borderType=cv2.BORDER_REPLICATE)
    at_v, at_u = np.nonzero(sensor.trail * (before - near) >= 1)
    here, hidden = depth[at_v, at_u], near[at_v, at_u]
    ramp = here.copy()
    stepped, gone = np.zeros((2, len(here)), bool)
    for k in range(1, reach + 1):
        from_u = np.maximum(at_u - k, 0)
        other, shade = depth[at_v, from_u], near[at_v, from_u] - hidden
        end = np.clip(sensor.trail * shade, 1e-6, LONGEST * scale)
        ramp = np.minimum(ramp, other + (here - other) * np.float32(k) / np.maximum(end, k))
        first = (here - other > sensor.edge_jump) & ~stepped
        gone |= first & (k <= end) & (k > end - shade)
        stepped |= first
    drawn[at_v, at_u], lost[at_v, at_u] = ramp, gone
    return drawn, lost


def _smeared(depth: Plane, sensor: DepthSensor, scale: float) -> Plane:
    """Depth with soft edges, as of half as many pixels."""
    height, width = depth.shape
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
