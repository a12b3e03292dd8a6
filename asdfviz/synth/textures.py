"""Procedural surface textures: large maps that cover the whole view and small ones that repeat.

A map has four channels: two mixing weights between three colours, a brightness and a height. Large
maps lie over `MACRO_SIZE` metres and are mirrored beyond, so no seam is ever seen; small ones are
periodic by construction.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from jaxtyping import Float32, Shaped
from torch import Tensor

from asdfviz.synth.tensors import to_tensor

MACRO_SIZE = 2.4
"""Metres that a large map covers."""
MICRO_SIZE = 0.2
"""Metres after which a small map repeats."""
MACRO_PIXELS = 1024
MICRO_PIXELS = 256
MACRO_KINDS = ("plain", "drape", "cloth", "wood", "noise", "checker", "plaid", "brick", "blobs")
MICRO_KINDS = ("weave", "carpet", "grain", "fine", "smooth")
BLURS_PX = (0.0, 1.0, 2.2, 4.5)
"""Small maps are kept at several blurs, chosen by the size of a pixel on the surface."""

Map = Float32[np.ndarray, "n n 4"]
Plane = Float32[np.ndarray, "n n"]
Weight = Shaped[np.ndarray, "n n"] | float


def fractal(
    rng: np.random.Generator, n: int, *, base: int, octaves: int, gain: float = 0.55
) -> Plane:
    """Periodic fractal noise of mean 0 and deviation 1; `base` is the coarsest grid."""
    total = np.zeros((n, n), np.float32)
    for octave in range(octaves):
        k = min(base * 2**octave, n // 2)
        grid = np.pad(rng.random((k, k)).astype(np.float32), 4, mode="wrap")
        side = n * (k + 8) // k
        large = cv2.resize(grid, (side, side), interpolation=cv2.INTER_CUBIC)
        cut = (side - n) // 2
        total += gain**octave * large[cut : cut + n, cut : cut + n]
    total -= total.mean()
    return (total / (total.std() + 1e-6)).astype(np.float32)


def _axes(n: int) -> tuple[Plane, Plane]:
    y, x = np.mgrid[0:n, 0:n].astype(np.float32) / n
    return x, y


def _stack(w1: Weight, w2: Weight, shade: Weight, height: Weight) -> Map:
    n = np.asarray(height).shape[0]
    planes = [np.broadcast_to(np.asarray(p, np.float32), (n, n)) for p in (w1, w2, shade, height)]
    return np.stack(planes, axis=2).astype(np.float32)


def _creases(rng: np.random.Generator, n: int, *, spacing: float, strength: float) -> Plane:
    """Heights (in units of the map) of a cloth that lay folded: a grid of soft ridges."""
    x, y = _axes(n)
    wobble = fractal(rng, n, base=3, octaves=3)
    height = np.zeros((n, n), np.float32)
    for axis in (x, y):
        pitch = spacing * rng.uniform(0.8, 1.25)
        offset = rng.random() * pitch
        for k, place in enumerate(np.arange(offset, 1, pitch)):
            d = axis - place + 0.0012 * wobble
            sign = 1.0 if k % 2 else -1.0
            height += sign * strength * np.exp(-np.abs(d) / 0.012) * rng.uniform(0.5, 1.0)
    return height.astype(np.float32)


def _drape(rng: np.random.Generator, n: int) -> Map:
    height = _creases(rng, n, spacing=0.1, strength=0.003)
    height += 0.004 * fractal(rng, n, base=5, octaves=3)
    height += 0.00025 * fractal(rng, n, base=40, octaves=3)
    return _stack(0.0, 0.0, 1 + 0.02 * fractal(rng, n, base=8, octaves=5), height)


def _cloth(rng: np.random.Generator, n: int) -> Map:
    height = 0.0022 * fractal(rng, n, base=4, octaves=4, gain=0.45)
    weight = np.clip(0.5 + 0.2 * fractal(rng, n, base=6, octaves=5), 0.0, 1)
    return _stack(0.3 * weight, 0.0, 1 + 0.05 * fractal(rng, n, base=32, octaves=4), height)


def _wood(rng: np.random.Generator, n: int) -> Map:
    _, y = _axes(n)
    boards = np.floor(y * rng.integers(3, 18)) if rng.random() < 0.6 else np.zeros_like(y)
    warp = fractal(rng, n, base=2, octaves=4) * 0.02 + boards * 0.37
    stretched = cv2.resize(
        fractal(rng, n, base=64, octaves=3)[:, : n // 16].copy(),
        (n, n),
        interpolation=cv2.INTER_CUBIC,
    )
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * ((y + warp) * 40 + 0.25 * stretched))
    tone = np.sin(boards * 12.9) * 0.08
    edge = np.abs((y * rng.integers(3, 18)) % 1 - 0.5) > 0.49 if boards.any() else 0.0
    shade = 1 + tone + 0.06 * stretched - 0.3 * np.asarray(edge, np.float32)
    return _stack(np.clip(rings * 0.6, 0, 1), 0.0, shade, (0.00004 * stretched).astype(np.float32))


def _noise(rng: np.random.Generator, n: int) -> Map:
    gain = float(rng.uniform(0.4, 0.75))
    a = fractal(rng, n, base=int(rng.integers(3, 20)), octaves=6, gain=gain)
    b = fractal(rng, n, base=int(rng.integers(3, 20)), octaves=5)
    return _stack(
        np.clip(0.5 + 0.5 * a, 0, 1), np.clip(0.5 * b, 0, 1), 1.0, (0.0004 * a).astype(np.float32)
    )


def _checker(rng: np.random.Generator, n: int) -> Map:
    x, y = _axes(n)
    k = int(rng.integers(12, 80))
    squares = (np.floor(x * k) + np.floor(y * k)) % 2
    dirt = fractal(rng, n, base=8, octaves=5)
    return _stack(squares.astype(np.float32), 0.0, 1 + 0.06 * dirt, np.zeros((n, n), np.float32))


def _plaid(rng: np.random.Generator, n: int) -> Map:
    weights = np.zeros((2, n, n), np.float32)
    for i, axis in enumerate(_axes(n)):
        for _ in range(3):
            pitch = rng.uniform(0.03, 0.12)
            stripe = ((axis + rng.random()) % pitch) / pitch < rng.uniform(0.05, 0.5)
            weights[int(rng.integers(2)) if rng.random() < 0.4 else i] += 0.45 * stripe
    height = 0.0012 * fractal(rng, n, base=5, octaves=4, gain=0.45)
    first, second = np.clip(weights, 0, 1)
    return _stack(first, second, 1.0, height.astype(np.float32))


def _brick(rng: np.random.Generator, n: int) -> Map:
    x, y = _axes(n)
    k = int(rng.integers(8, 30))
    row = np.floor(y * k * 2)
    u, v = (x * k + 0.5 * (row % 2)) % 1, (y * k * 2) % 1
    edge = np.minimum(np.minimum(u, 1 - u) * 2, np.minimum(v, 1 - v))
    rough = fractal(rng, n, base=24, octaves=4)
    inner = np.clip((edge + 0.02 * rough - 0.06) * 12, 0, 1)
    height = (0.002 * inner + 0.0003 * rough).astype(np.float32)
    return _stack(inner, 0.0, 1 + 0.1 * rough, height)


def _blobs(rng: np.random.Generator, n: int) -> Map:
    a = fractal(rng, n, base=int(rng.integers(4, 24)), octaves=2)
    b = fractal(rng, n, base=int(rng.integers(4, 24)), octaves=2)
    flat = np.zeros((n, n), np.float32)
    return _stack(np.clip(a * 6, 0, 1), np.clip(b * 6, 0, 1), 1.0, flat)


def _plain(rng: np.random.Generator, n: int) -> Map:
    soft = fractal(rng, n, base=3, octaves=5)
    return _stack(0.0, 0.0, 1 + 0.03 * soft, (0.0001 * soft).astype(np.float32))


def _weave(rng: np.random.Generator, n: int) -> Map:
    x, y = _axes(n)
    threads = int(rng.integers(60, 110))
    weave = np.sin(2 * np.pi * x * threads) * np.sin(2 * np.pi * y * threads)
    dirt = fractal(rng, n, base=32, octaves=3)
    return _stack(0.0, 0.0, 1 + 0.05 * weave + 0.03 * dirt, (0.00006 * weave).astype(np.float32))


def _carpet(rng: np.random.Generator, n: int) -> Map:
    tufts = fractal(rng, n, base=90, octaves=2)
    return _stack(
        np.clip(0.3 + 0.3 * tufts, 0, 1), 0.0, np.clip(1 + 0.3 * tufts, 0.2, 2), 0.0006 * tufts
    )


def _grain(rng: np.random.Generator, n: int) -> Map:
    lines = cv2.resize(fractal(rng, n, base=64, octaves=2)[:, : n // 8].copy(), (n, n))
    lines = 0.5 * (lines + lines[:, ::-1])
    return _stack(0.0, 0.0, 1 + 0.04 * lines, (0.00001 * lines).astype(np.float32))


def _fine(rng: np.random.Generator, n: int) -> Map:
    dots = fractal(rng, n, base=64, octaves=2)
    return _stack(0.0, 0.0, 1 + 0.03 * dots, (0.00002 * dots).astype(np.float32))


def _smooth(rng: np.random.Generator, n: int) -> Map:
    return _stack(0.0, 0.0, 1.0, np.zeros((n, n), np.float32))


_MACRO = {
    "plain": _plain,
    "drape": _drape,
    "cloth": _cloth,
    "wood": _wood,
    "noise": _noise,
    "checker": _checker,
    "plaid": _plaid,
    "brick": _brick,
    "blobs": _blobs,
}
_MICRO = {"weave": _weave, "carpet": _carpet, "grain": _grain, "fine": _fine, "smooth": _smooth}


@cache
def macro_map(kind: str, variant: int, device: str) -> Float32[Tensor, "5 n n"]:
    """A large map; the same kind and variant always give the same map."""
    rng = np.random.default_rng([MACRO_KINDS.index(kind), variant, 71])
    made = _with_slopes(_MACRO[kind](rng, MACRO_PIXELS), MACRO_SIZE, mirrored=True)
    return to_tensor(made, device)


@cache
def micro_map(kind: str, variant: int, blur: int, device: str) -> Float32[Tensor, "5 n n"]:
    """A small periodic map, blurred by BLURS_PX[blur] pixels."""
    rng = np.random.default_rng([MICRO_KINDS.index(kind), variant, 72])
    made = _with_slopes(_MICRO[kind](rng, MICRO_PIXELS), MICRO_SIZE, mirrored=False)
    if BLURS_PX[blur] > 0:
        pad = np.pad(made, ((0, 0), (16, 16), (16, 16)), mode="wrap").transpose(1, 2, 0)
        soft = cv2.GaussianBlur(pad, (0, 0), BLURS_PX[blur])
        made = np.ascontiguousarray(soft[16:-16, 16:-16].transpose(2, 0, 1))
    return to_tensor(made, device)


def _with_slopes(made: Map, size: float, *, mirrored: bool) -> Float32[np.ndarray, "5 n n"]:
    """Channels first, the height replaced by its slopes along x and y."""
    height = made[:, :, 3]
    step = size / made.shape[0]
    mode = "edge" if mirrored else "wrap"
    padded = np.pad(height, 1, mode=mode)
    slope_x = (padded[1:-1, 2:] - padded[1:-1, :-2]) / (2 * step)
    slope_y = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / (2 * step)
    return np.stack([made[:, :, 0], made[:, :, 1], made[:, :, 2], slope_x, slope_y]).astype(
        np.float32
    )
