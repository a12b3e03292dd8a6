"""Which model points the camera can see: nothing measured in front, no other part in front.

Two tests that both modalities ask: of the measured depth (something unknown is nearer than the
part, such as a hand), and of the rendered id image (another tracked part is nearer).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, no_type_check

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Intrinsics, Scores, Transforms
from asdfviz.track import raster
from asdfviz.track.jit import kernel

MaybeDepth: TypeAlias = Float32[np.ndarray, "_ _"]
"""Planar depth in metres, or an image without pixels where none is to be asked."""

NO_DEPTH = np.zeros((0, 0), np.float32)

PROBES = 5
"""Depth pixels a side that are looked at for an occluder."""


@dataclass(frozen=True, slots=True, eq=False)
class Silhouettes:
    """Images of part and region numbers, cut out around the parts; -1 is background."""

    ids: Int32[np.ndarray, "h w"]
    """Which part is in front."""
    regions: Int32[np.ndarray, "h w"]
    """The number that it shares with the parts of like colour."""
    crop: Float64[np.ndarray, 3]
    """u and v of the cut's first pixel in the camera image, and cut pixels per image pixel."""


_NO_IDS = np.zeros((0, 0), np.int32)
NO_SILHOUETTES = Silhouettes(_NO_IDS, _NO_IDS, np.array([0.0, 0.0, 1.0]))
"""Switches the test off."""


def like_regions(colors: Sequence[UInt8[np.ndarray, 3]], *, nearer_than: float) -> list[int]:
    """Number the parts so that those of like colours (sRGB distance) share a number."""
    regions = np.arange(len(colors))
    known = np.array(colors, np.float64).reshape(-1, 3)
    apart = np.linalg.norm(known[:, None] - known, axis=2)
    for i, j in np.argwhere(np.tril(apart < nearer_than, -1)):
        regions[regions == regions[i]] = regions[j]
    return [int(region) for region in regions]


def render_silhouettes(
    meshes: Sequence[Mesh],
    Ts_camera_part: Transforms,
    K: Intrinsics,
    *,
    shown: Sequence[int],
    size: int,
    reaches: Scores,
    regions: Sequence[int],
) -> Silhouettes | None:
    """Draw the meshes that are to be shown, each with its place in the list as its number, in a square
    cut around them.

    `reaches` is how far each mesh reaches from its own origin (metres), `regions` each part's
    region number, `size` the greatest side of the square.

    Returns:
        None where none of them lies in front of the camera.
    """
    which = list(shown)
    box = _box_around(Ts_camera_part[which], reaches[which], K)
    if box is None:
        return None
    u0, v0, side = box
    scale = min(1.0, size / side)
    pixels = max(2, min(size, int(np.ceil(side * scale))))
    K_cut = np.array(
        [
            [K[0, 0] * scale, 0.0, (K[0, 2] - u0) * scale],
            [0.0, K[1, 1] * scale, (K[1, 2] - v0) * scale],
            [0.0, 0.0, 1.0],
        ]
    )
    inverse_depth, ids = raster.new_buffers(pixels, pixels)
    for i in which:
        raster.draw(
            meshes[i], Ts_camera_part[i], K=K_cut, inverse_depth=inverse_depth, ids=ids, number=i
        )
    # The last entry answers for the background's -1.
    numbers = np.array([*regions, -1], np.int32)
    return Silhouettes(ids, numbers[ids], np.array([u0, v0, scale]))


def _box_around(
    Ts_camera_part: Transforms, reaches: Scores, K: Intrinsics
) -> tuple[float, float, float] | None:
    """First pixel and side of a square that holds the spheres around all parts."""
    z = Ts_camera_part[:, 2, 3]
    # A sphere's rim is at most this far from its middle's pixel, in units of the focal length.
    spread = reaches / np.maximum(z - reaches, 0.1 * reaches)
    seen = z > raster.NEAR
    if not seen.any():
        return None
    rays = Ts_camera_part[:, :2, 3] / np.where(seen, z, 1.0)[:, None]
    focal, middle = np.array([K[0, 0], K[1, 1]]), K[:2, 2]
    low = ((rays - 1.1 * spread[:, None]) * focal + middle)[seen].min(axis=0)
    high = ((rays + 1.1 * spread[:, None]) * focal + middle)[seen].max(axis=0)
    low, high = np.maximum(low, -64.0), np.minimum(high, 2 * middle + 64.0)
    if (high <= low).any():
        return None
    return float(low[0]) - 2.0, float(low[1]) - 2.0, float((high - low).max()) + 5.0


@kernel
@no_type_check
def pixel_of(point, T, lens, width, height):
    """Nearest pixel (u, v) of a point at pose T, and its depth; that is 0 where it has no pixel."""
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3]
    if z <= 0.0:
        return 0, 0, 0.0
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    u, v = int(lens[0] * x / z + lens[2] + 0.5), int(lens[1] * y / z + lens[3] + 0.5)
    if u < 0 or v < 0 or u >= width or v >= height:
        return 0, 0, 0.0
    return u, v, z


@kernel
@no_type_check
def id_at(ids, crop, u, v):
    """Part number at image pixel (u, v); -1 for background and outside the cut."""
    y = int(np.floor((v - crop[1]) * crop[2] + 0.5))
    x = int(np.floor((u - crop[0]) * crop[2] + 0.5))
    if x < 0 or y < 0 or y >= ids.shape[0] or x >= ids.shape[1]:
        return -1
    return ids[y, x]


@kernel
@no_type_check
def occluded(depth, u, v, limit, radius_px):
    """Whether any measured depth within radius_px of (u, v) is nearer than `limit` metres."""
    height, width = depth.shape
    stride = max(1, int(np.ceil(2.0 * radius_px / (PROBES - 1))))
    reach = int(radius_px) // stride
    for j in range(-reach, reach + 1):
        y = int(v + 0.5) + j * stride
        if y < 0 or y >= height:
            continue
        for i in range(-reach, reach + 1):
            x = int(u + 0.5) + i * stride
            if x >= 0 and x < width and depth[y, x] > 0.0 and depth[y, x] < limit:
                return True
    return False
