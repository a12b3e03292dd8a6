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
from jaxtyping import Bool, Float32, Float64, Int64

from asdfviz.datatypes import KEYPOINTS
from asdfviz.geometry.shapes import Intrinsics, Rgb
from asdfviz.geometry.transforms import rotation_about
from asdfviz.train.dataset import LabelledImage, Stacked

Labels: TypeAlias = Int64[np.ndarray, "m"]


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
        smallest_inside: as for `boxes_in`.
    """
    rgb = cv2.warpAffine(
        image.rgb, H[:2], (width, height), flags=cv2.INTER_LINEAR, borderValue=fill
    ).astype(np.uint8, copy=False)
    labels = image.stacked
    # Pixel centres move by half a pixel between a frame's and the network's coordinates.
    outlines = move_points(H, labels.outlines) + np.float32(0.5)
    boxes, is_taught = boxes_in(
        labels, outlines, width=width, height=height, smallest_inside=smallest_inside
    )
    kept = is_taught.nonzero()[0]
    return _labelled(rgb, labels, kept, boxes[kept], H, angle)


def boxes_in(
    labels: Stacked,
    outlines: Float32[np.ndarray, "p 2"],
    *,
    width: int,
    height: int,
    smallest_inside: float = 0.4,
) -> tuple[Float32[np.ndarray, "m 4"], Bool[np.ndarray, "m"]]:
    """Boxes x0, y0, x1, y1 of all objects, cut at a window's border, and which of them are taught.

    Args:
        labels: whose outlines they are.
        outlines: in network coordinates of the window.
        width: of the window, pixels.
        height: of the window, pixels.
        smallest_inside: objects with less than this share of their area in the window get no
            label (states need 0.7: a part of an assembled thing looks like another state).
    """
    if not len(labels.labels):
        return np.zeros((0, 4), np.float32), np.zeros(0, bool)
    window = np.array([width, height], np.float32)
    first = np.minimum.reduceat(outlines, labels.starts, axis=0)
    last = np.maximum.reduceat(outlines, labels.starts, axis=0)
    low, high = np.clip(first, 0, window), np.clip(last, 0, window)
    needed = np.where(labels.is_state, 0.7, smallest_inside)
    shown = (high - low).astype(float).prod(1) >= needed * (last - first).astype(float).prod(1)
    boxes = np.concatenate([low, high], axis=1).astype(np.float32, copy=False)
    return boxes, shown & ((high - low).min(1) >= 2)


def _labelled(
    rgb: Rgb, labels: Stacked, kept: Labels, boxes: np.ndarray, H: np.ndarray, angle: float
) -> Sample:
    """The sample with the labels of the kept objects, in a window of the picture's size."""
    window = np.array([rgb.shape[1], rgb.shape[0]], np.float32)
    keypoints = labels.keypoints[kept]
    points = move_points(H, keypoints[:, :, :2].reshape(-1, 2)) + np.float32(0.5)
    points = points.reshape(-1, KEYPOINTS, 2)
    inside = ((points >= 0) & (points < window)).all(2)
    flags = np.where(inside, keypoints[:, :, 2], 1.0).astype(np.float32)
    moved = np.concatenate([points, flags[:, :, None]], axis=2)
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), angle)
    return Sample(
        rgb=rgb,
        labels=labels.labels[kept],
        boxes=boxes.astype(np.float32),
        keypoints=np.where(labels.is_state[kept, None, None], keypoints, moved),
        rotations=(turn @ labels.rays[kept]).astype(np.float32),
    )


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
