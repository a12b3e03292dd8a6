"""Turns pictures' labels by affine maps.

A camera roll about the optical axis is an affine map of the picture, a zoom and a shift are other
intrinsics: each result is a picture that a camera could have taken, with exact labels. Canonical
poses of symmetric parts depend on the camera's place alone, so a roll keeps them canonical.
Mirroring is absent on purpose: it would turn left-hand parts into right-hand ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from asdfviz.datatypes import KEYPOINTS
from asdfviz.geometry.shapes import Intrinsics, Rgb
from asdfviz.geometry.transforms import rotation_about
from asdfviz.train.dataset import LabelledImage, Stacked

Labels: TypeAlias = Int64[np.ndarray, "m"]


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Labels of a network input, in network coordinates (first pixel's centre at 0.5)."""

    labels: Labels
    boxes: Float32[np.ndarray, "m 4"]
    """x0, y0, x1, y1."""
    keypoints: Float32[np.ndarray, "m 17 3"]
    rotations: Float32[np.ndarray, "m 3 3"]
    """Of the part in the frame of its own viewing ray, after the roll; zeros for states."""

    @classmethod
    def joined(cls, pieces: Sequence[Marks], corners: Sequence[tuple[int, int]]) -> Marks:
        """Those of windows whose first pixels lie at `corners` (x, y) of one input."""
        boxes: list[np.ndarray] = []
        keypoints: list[np.ndarray] = []
        for piece, (x, y) in zip(pieces, corners, strict=True):
            boxes.append(piece.boxes + np.array([x, y, x, y], np.float32))
            moved = piece.keypoints.copy()
            moved[:, :, :2] += np.array([x, y], np.float32) * (moved[:, :, 2:] > 0)
            keypoints.append(moved)
        return cls(
            labels=np.concatenate([p.labels for p in pieces]),
            boxes=np.concatenate(boxes),
            keypoints=np.concatenate(keypoints),
            rotations=np.concatenate([p.rotations for p in pieces]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A network input with its labels."""

    rgb: Rgb
    marks: Marks


def roll(K: Intrinsics, angle: float) -> Float64[np.ndarray, "3 3"]:
    """Homography K R K^-1 of a camera turned by `angle` radians about its optical axis: affine."""
    cos, sin = math.cos(angle), math.sin(angle)
    (fx, skew, x), (_, fy, y) = K[:2].tolist()
    # Of the upper triangle A of K: A R A^-1.
    a, b = fx * cos + skew * sin, skew * cos - fx * sin
    xx, xy = a / fx, (b - a * skew / fx) / fy
    yx, yy = fy * sin / fx, cos - sin * skew / fx
    moved = [[xx, xy, x - xx * x - xy * y], [yx, yy, y - yx * x - yy * y], [0.0, 0.0, 1.0]]
    return np.array(moved)


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


def marks_in(
    image: LabelledImage,
    H: Float64[np.ndarray, "3 3"],
    *,
    width: int,
    height: int,
    angle: float,
    smallest_inside: float = 0.4,
) -> Marks:
    """Return the labels of what an affine map of a picture shows in a window.

    Args:
        image: the picture and its labels.
        H: maps its pixels to the window's (integer = centre).
        width: of the window, pixels.
        height: of the window, pixels.
        angle: the roll that H contains, radians, to turn the parts' rotations by.
        smallest_inside: as for `boxes_in`.
    """
    labels = _near(image.stacked, H, width, height)
    # Pixel centres move by half a pixel between a frame's and the network's coordinates.
    outlines = move_points(H, labels.outlines) + np.float32(0.5)
    boxes, is_taught = boxes_in(
        labels, outlines, width=width, height=height, smallest_inside=smallest_inside
    )
    kept = is_taught.nonzero()[0]
    return _labelled((width, height), labels, kept, boxes[kept], H, angle)


def _near(labels: Stacked, H: Float64[np.ndarray, "3 3"], width: int, height: int) -> Stacked:
    """Without the objects that lie apart from the window; most of a picture's do from a tile."""
    if not len(labels.labels):
        return labels
    middles = move_points(H, labels.middles)
    # The Frobenius norm is no smaller than what the map stretches lengths by; a pixel for rounding.
    reach = labels.radii * float(np.linalg.norm(H[:2, :2])) + 1
    x, y = middles[:, 0], middles[:, 1]
    is_near = (x > -reach) & (x < width + reach) & (y > -reach) & (y < height + reach)
    places = is_near.nonzero()[0]
    return labels if len(places) == len(labels.labels) else labels.those(places)


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
    low, high = (np.minimum(np.maximum(edge, 0), window) for edge in (first, last))
    needed = np.where(labels.is_state, 0.7, smallest_inside)
    inside, whole = (high - low).astype(float), (last - first).astype(float)
    shown = inside[:, 0] * inside[:, 1] >= needed * (whole[:, 0] * whole[:, 1])
    boxes = np.concatenate([low, high], axis=1).astype(np.float32, copy=False)
    return boxes, shown & (inside[:, 0] >= 2) & (inside[:, 1] >= 2)


def _labelled(
    size: tuple[int, int],
    labels: Stacked,
    kept: Labels,
    boxes: np.ndarray,
    H: np.ndarray,
    angle: float,
) -> Marks:
    """The labels of the kept objects, in a window of this width and height."""
    keypoints = labels.keypoints[kept]
    points = move_points(H, keypoints[:, :, :2].reshape(-1, 2)) + np.float32(0.5)
    points = points.reshape(-1, KEYPOINTS, 2)
    x, y = points[:, :, 0], points[:, :, 1]
    inside = (x >= 0) & (y >= 0) & (x < size[0]) & (y < size[1])
    flags = np.where(inside, keypoints[:, :, 2], 1.0).astype(np.float32)
    moved = np.concatenate([points, flags[:, :, None]], axis=2)
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), angle)
    return Marks(
        labels=labels.labels[kept],
        boxes=boxes.astype(np.float32),
        keypoints=np.where(labels.is_state[kept, None, None], keypoints, moved),
        rotations=(turn @ labels.rays[kept]).astype(np.float32),
    )
