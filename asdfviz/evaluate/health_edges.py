"""Edges of colour and depth images with sub-pixel places and directions, for the shift between both."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from asdfviz.geometry.shapes import Depth, Mask, Pixels, Rgb, Scores

_BLUR_PX = 1.5
_SOBEL_SCALE = 1.0 / 8.0
"""Makes OpenCV's 3 x 3 Sobel a slope a pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Edge points and the direction across them."""

    pixels: Pixels
    angles: Scores
    """Direction of the steepest slope, radians, 0 to pi: an edge has no sign here."""
    strengths: Scores


def depth_edges(depth: Depth, *, least_slope: float = 0.0025) -> Edges:
    """Find the steps in a depth image.

    Small holes are filled from their nearest neighbour, because sensors lose just the pixels at
    object borders. The rims of large holes are left out: they say where the sensor gave up, not
    where an object ends.

    Args:
        depth: metres, 0 where nothing was measured.
        least_slope: smallest change a pixel, as a share of the depth.
    """
    holes = (depth <= 0).astype(np.uint8)
    if holes.all():
        return Edges(np.empty((0, 2)), np.empty(0), np.empty(0))
    large = cv2.morphologyEx(holes, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    smooth = cv2.GaussianBlur(_filled(depth, holes), (0, 0), _BLUR_PX)
    gx, gy = _slopes(smooth)
    near_hole = cv2.dilate(large, np.ones((9, 9), np.uint8)) > 0
    strength = np.where(near_hole, 0.0, np.hypot(gx, gy) / smooth)
    return _ridges(gx, gy, strength, least=least_slope)


def color_edges(rgb: Rgb, *, least_slope: float = 4.0, largest_share: float = 0.04) -> Edges:
    """Find the edges of a colour image, in its strongest channel.

    Args:
        rgb: the image.
        least_slope: smallest change a pixel, in steps of 8-bit colour.
        largest_share: of all pixels; busy textures keep only their strongest edges.
    """
    smooth = cv2.GaussianBlur(rgb.astype(np.float32), (0, 0), _BLUR_PX)
    gx, gy = _slopes(smooth)
    steepest = np.hypot(gx, gy).argmax(axis=2)[..., None]
    gx = np.take_along_axis(gx, steepest, axis=2)[..., 0]
    gy = np.take_along_axis(gy, steepest, axis=2)[..., 0]
    edges = _ridges(gx, gy, np.hypot(gx, gy), least=least_slope)
    most = int(largest_share * rgb.shape[0] * rgb.shape[1])
    return edges if len(edges.pixels) <= most else strongest(edges, most)


def strongest(edges: Edges, count: int) -> Edges:
    """Keep the `count` strongest edge points."""
    kept = np.argsort(-edges.strengths, kind="stable")[:count]
    return Edges(edges.pixels[kept], edges.angles[kept], edges.strengths[kept])


def thinned(edges: Edges, count: int, *, seed: int = 0) -> Edges:
    """Keep an even random choice of at most `count` edge points."""
    if len(edges.pixels) <= count:
        return edges
    kept = np.random.default_rng(seed).choice(len(edges.pixels), size=count, replace=False)
    return Edges(edges.pixels[kept], edges.angles[kept], edges.strengths[kept])


def _filled(depth: Depth, holes: UInt8[np.ndarray, "h w"]) -> Depth:
    found = cv2.distanceTransformWithLabels(holes, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    labels = np.asarray(found[1], dtype=np.int32)
    nearest = np.zeros(int(labels.max()) + 1, dtype=np.float32)
    measured = holes == 0
    nearest[labels[measured]] = depth[measured]
    return nearest[labels]


def _slopes(image: Float32[np.ndarray, "h w *c"]) -> tuple[np.ndarray, np.ndarray]:
    gx = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=_SOBEL_SCALE)
    return gx, cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=_SOBEL_SCALE)


def _ridges(gx: np.ndarray, gy: np.ndarray, strength: np.ndarray, *, least: float) -> Edges:
    """Keep the pixels that are strongest across their edge, as in Canny (1986), to sub-pixels."""
    strength = strength.astype(np.float32)
    v, u = np.nonzero(_inside(strength > least))
    length = np.maximum(np.hypot(gx[v, u], gy[v, u]), 1e-12)
    across = np.stack([gx[v, u] / length, gy[v, u] / length], axis=1).astype(np.float64)
    pixels = np.stack([u, v], axis=1).astype(np.float64)
    here = strength[v, u].astype(np.float64)
    before = sampled(strength, pixels - across)
    after = sampled(strength, pixels + across)
    is_ridge = (here >= before) & (here > after)
    # The top of the parabola through the three values.
    bend = np.minimum(before - 2.0 * here + after, -1e-12)
    offset = np.clip(0.5 * (before - after) / bend, -0.7, 0.7)
    angles = np.arctan2(across[:, 1], across[:, 0]) % np.pi
    return Edges(
        pixels=(pixels + offset[:, None] * across)[is_ridge],
        angles=angles[is_ridge],
        strengths=here[is_ridge],
    )


def _inside(mask: Mask, border: int = 3) -> Mask:
    kept = np.zeros_like(mask)
    kept[border:-border, border:-border] = mask[border:-border, border:-border]
    return kept


def sampled(image: Float32[np.ndarray, "h w"], pixels: Pixels) -> Scores:
    """Values of an image between its pixels, bilinear; beyond the border the nearest value."""
    # cv2.remap takes at most 32767 columns.
    chunks = [
        cv2.remap(
            image,
            np.ascontiguousarray(chunk[:, 0], dtype=np.float32)[None],
            np.ascontiguousarray(chunk[:, 1], dtype=np.float32)[None],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )[0]
        for chunk in np.array_split(pixels, len(pixels) // 30000 + 1)
        if len(chunk)
    ]
    return np.concatenate(chunks).astype(np.float64) if chunks else np.empty(0)
