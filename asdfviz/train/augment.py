"""Turns pictures and their labels by affine maps, and changes their colours.

A camera roll about the optical axis is an affine map of the picture, a zoom and a shift are other
intrinsics: each result is a picture that a camera could have taken, with exact labels. Canonical
poses of symmetric parts depend on the camera's place alone, so a roll keeps them canonical.
Mirroring is absent on purpose: it would turn left-hand parts into right-hand ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int64

from asdfviz.datatypes import KEYPOINTS
from asdfviz.geometry.shapes import Intrinsics, Rgb
from asdfviz.geometry.transforms import rotation_about
from asdfviz.pose.labels import LabelledObject
from asdfviz.train.dataset import LabelledImage

Labels: TypeAlias = Int64[np.ndarray, "m"]
Size: TypeAlias = Float32[np.ndarray, "2"]


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


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A network input with labels in network coordinates (first pixel's centre at 0.5)."""

    rgb: Rgb
    labels: Labels
    boxes: Float32[np.ndarray, "m 4"]
    """x0, y0, x1, y1."""
    keypoints: Float32[np.ndarray, "m 17 3"]
    rotations: Float32[np.ndarray, "m 3 3"]
    """Of the part in the frame of its own viewing ray, after the roll; zeros for states."""


def roll(K: Intrinsics, angle: float) -> Float64[np.ndarray, "3 3"]:
    """Homography of a camera turned by `angle` radians about its optical axis."""
    H = K @ rotation_about(np.array([0.0, 0.0, 1.0]), angle) @ np.linalg.inv(K)
    return H / H[2, 2]


def similarity(
    source: Float64[np.ndarray, 2], target: Float64[np.ndarray, 2], zoom: float
) -> Float64[np.ndarray, "3 3"]:
    """Zoom about the point `source` and put it on `target` (pixels)."""
    shift = target - zoom * source
    return np.array([[zoom, 0.0, shift[0]], [0.0, zoom, shift[1]], [0.0, 0.0, 1.0]])


def move_points(
    H: Float64[np.ndarray, "3 3"], points: Float32[np.ndarray, "n 2"]
) -> Float32[np.ndarray, "n 2"]:
    """Map pixels by an affine map."""
    return (points @ H[:2, :2].T + H[:2, 2]).astype(np.float32)


def view(
    image: LabelledImage,
    H: Float64[np.ndarray, "3 3"],
    *,
    width: int,
    height: int,
    angle: float,
    fill: tuple[int, int, int],
    smallest_inside: float = 0.4,
) -> Sample:
    """Return what an affine map of a picture shows in a window.

    Args:
        image: the picture and its labels.
        H: maps its pixels to the window's (integer = centre).
        width: of the window, pixels.
        height: of the window, pixels.
        angle: the roll that H contains, radians, to turn the parts' rotations by.
        fill: colour of what the picture does not cover.
        smallest_inside: objects with less than this share of their area in the window get no
            label (states need 0.7: a part of an assembled thing looks like another state).
    """
    rgb = cv2.warpAffine(
        image.rgb, H[:2], (width, height), flags=cv2.INTER_LINEAR, borderValue=fill
    ).astype(np.uint8, copy=False)
    labels: list[int] = []
    boxes: list[np.ndarray] = []
    keypoints: list[np.ndarray] = []
    rotations: list[np.ndarray] = []
    window = np.array([width, height], np.float32)
    for item in image.objects:
        # Pixel centres move by half a pixel between a frame's and the network's coordinates.
        outline = move_points(H, item.outline) + np.float32(0.5)
        needed = 0.7 if item.part is None else smallest_inside
        low = np.clip(outline.min(0), 0, window)
        high = np.clip(outline.max(0), 0, window)
        whole = _area(outline.max(0) - outline.min(0))
        if _area(high - low) < needed * whole or (high - low).min() < 2:
            continue
        labels.append(item.label)
        boxes.append(np.concatenate([low, high]))
        keypoints.append(_moved_keypoints(item, H, window))
        rotations.append(_ray_rotation(item, angle))
    return Sample(
        rgb=rgb,
        labels=np.array(labels, np.int64),
        boxes=np.array(boxes, np.float32).reshape(-1, 4),
        keypoints=np.array(keypoints, np.float32).reshape(-1, KEYPOINTS, 3),
        rotations=np.array(rotations, np.float32).reshape(-1, 3, 3),
    )


def _area(size: Size) -> float:
    return float(size[0]) * float(size[1])


def _moved_keypoints(
    item: LabelledObject, H: np.ndarray, window: Size
) -> Float32[np.ndarray, "17 3"]:
    if item.part is None:
        return item.keypoints
    points = move_points(H, item.keypoints[:, :2]) + np.float32(0.5)
    inside = ((points >= 0) & (points < window)).all(1)
    flags = np.where(inside, item.keypoints[:, 2], 1.0)
    return np.concatenate([points, flags[:, None]], axis=1).astype(np.float32)


def _ray_rotation(item: LabelledObject, angle: float) -> Float64[np.ndarray, "3 3"]:
    """Rotation of the part as seen along the ray to it: what its picture shows, wherever it is."""
    if item.T_camera_part is None:
        return np.zeros((3, 3))
    t = item.T_camera_part[:3, 3]
    ray = t / np.linalg.norm(t)
    axis = np.cross(ray, [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(axis))
    turn = rotation_about(axis, np.arctan2(length, ray[2])) if length > 1e-9 else np.eye(3)
    return rotation_about(np.array([0.0, 0.0, 1.0]), angle) @ turn @ item.T_camera_part[:3, :3]


def change_colors(rgb: Rgb, rng: np.random.Generator, config: ColorConfig) -> Rgb:
    """Return the picture under other light and another camera."""
    gamma = np.exp(rng.uniform(-config.gamma, config.gamma))
    gains = (1 + rng.uniform(-config.gain, config.gain)) * (
        1 + rng.uniform(-config.balance, config.balance, 3)
    )
    ramp = (np.arange(256) / 255.0) ** gamma
    table = np.clip(ramp[:, None] * gains[None] * 255 + 0.5, 0, 255).astype(np.uint8)
    out = cv2.LUT(rgb, table[None])
    saturation = 1 + rng.uniform(-config.saturation, config.saturation)
    mix = np.eye(3) * saturation + (1 - saturation) * np.array([[0.299, 0.587, 0.114]] * 3)
    out = cv2.transform(out, mix)
    if rng.random() < config.blur:
        out = cv2.GaussianBlur(out, (0, 0), rng.uniform(0.3, 1.2))
    if rng.random() < config.noise:
        grain = np.empty(out.shape, np.int16)
        cv2.setRNGSeed(int(rng.integers(2**31 - 1)))
        cv2.randn(grain, np.zeros(3), np.full(3, rng.uniform(1.0, 10.0)))
        out = cv2.add(out, grain, dtype=cv2.CV_8U)
    return np.asarray(out, np.uint8)
