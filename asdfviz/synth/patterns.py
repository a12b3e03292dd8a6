"""Procedural patterns: heights, brightness and mixing weights of cloth, wood, stone and the like.

A pattern has four channels: two mixing weights between three colours, a brightness and a height in
metres. Small patterns are periodic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float32, Shaped

from asdfviz.synth.creases import creased
from asdfviz.synth.fractals import Plane, fractal, unit_axes

FINE = 0.00025
"""Height of a drape's fine wrinkles, metres."""
Map = Float32[np.ndarray, "n n 4"]
Weight = Shaped[np.ndarray, "n n"] | float
Pattern: TypeAlias = Callable[[np.random.Generator, int], np.ndarray]


def _stack(w1: Weight, w2: Weight, shade: Weight, height: Weight) -> Map:
    n = np.asarray(height).shape[0]
    planes = [np.broadcast_to(np.asarray(p, np.float32), (n, n)) for p in (w1, w2, shade, height)]
    return np.stack(planes, axis=2).astype(np.float32)


def _drape(rng: np.random.Generator, n: int) -> Map:
    folds = creased(rng, n, side=1.0)
    broad = fractal(rng, n, base=5, octaves=3, gain=0.45)
    along = fractal(rng, n, base=6, octaves=3, drawn_out=3).T
    # Fine wrinkles run as the folds do, in some places more than in others.
    fine = fractal(rng, n, base=34, octaves=3, gain=0.6, drawn_out=7)
    fine *= np.clip(0.6 + 0.6 * fractal(rng, n, base=5, octaves=2), 0, 1.6)
    height = 1.9 * folds + 0.0048 * broad + 0.0030 * along + FINE * fine
    # Worn folds are a little paler than the cloth, whatever the light.
    worn = folds - cv2.GaussianBlur(folds, (0, 0), n / 250)
    # What is paler and darker is drawn out along the folds, too, as in the real drape.
    blotches = fractal(rng, n, base=30, octaves=4, gain=0.6, drawn_out=3)
    shade = 1 + 0.02 * blotches + np.clip(120 * np.abs(worn), 0, 0.08)
    bands = fractal(rng, n, base=16, octaves=3, drawn_out=3)
    hue = 0.45 + 0.22 * fractal(rng, n, base=7, octaves=5, gain=0.7) + 0.3 * bands
    lint = 0.4 * _specks(rng, n)
    shade *= 1 - _specks(rng, n)  # dirt
    return _stack(np.clip(hue, 0, 1), lint, shade, height.astype(np.float32))


def _specks(rng: np.random.Generator, n: int) -> Plane:
    """Short threads, most of them faint, 0 to 0.5."""
    plane = np.zeros((n, n), np.float32)
    for _ in range(n * n // 25000):
        start = rng.integers(4, n - 8, 2)
        end = start + rng.integers(-3, 4, 2)
        ends = [tuple(int(v) for v in p) for p in (start, end)]
        cv2.line(plane, ends[0], ends[1], 0.5 * float(rng.random()) ** 2, 1)
    return plane


def _cloth(rng: np.random.Generator, n: int) -> Map:
    height = 0.0022 * fractal(rng, n, base=4, octaves=4, gain=0.45)
    weight = np.clip(0.5 + 0.2 * fractal(rng, n, base=6, octaves=5), 0.0, 1)
    return _stack(0.3 * weight, 0.0, 1 + 0.05 * fractal(rng, n, base=32, octaves=4), height)


def _wood(rng: np.random.Generator, n: int) -> Map:
    _, y = unit_axes(n)
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
    x, y = unit_axes(n)
    k = int(rng.integers(12, 80))
    squares = (np.floor(x * k) + np.floor(y * k)) % 2
    dirt = fractal(rng, n, base=8, octaves=5)
    return _stack(squares.astype(np.float32), 0.0, 1 + 0.06 * dirt, np.zeros((n, n), np.float32))


def _plaid(rng: np.random.Generator, n: int) -> Map:
    weights = np.zeros((2, n, n), np.float32)
    for i, axis in enumerate(unit_axes(n)):
        for _ in range(3):
            pitch = rng.uniform(0.03, 0.12)
            stripe = ((axis + rng.random()) % pitch) / pitch < rng.uniform(0.05, 0.5)
            weights[int(rng.integers(2)) if rng.random() < 0.4 else i] += 0.45 * stripe
    height = 0.0012 * fractal(rng, n, base=5, octaves=4, gain=0.45)
    first, second = np.clip(weights, 0, 1)
    return _stack(first, second, 1.0, height.astype(np.float32))


def _brick(rng: np.random.Generator, n: int) -> Map:
    x, y = unit_axes(n)
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


def _worn(rng: np.random.Generator, n: int) -> Map:
    """Large stains of the third colour, as on a carpet."""
    stains = fractal(rng, n, base=8, octaves=4, gain=0.7)
    soft = fractal(rng, n, base=12, octaves=5, gain=0.8)
    flat = np.zeros((n, n), np.float32)
    return _stack(0.0, np.clip(0.5 + 0.4 * stains, 0, 1), 1 + 0.06 * soft, flat)


def _plain(rng: np.random.Generator, n: int) -> Map:
    soft = fractal(rng, n, base=3, octaves=5)
    return _stack(0.0, 0.0, 1 + 0.03 * soft, (0.0001 * soft).astype(np.float32))


def _board(rng: np.random.Generator, n: int) -> Map:
    """Pale veneer: long faint streaks, no joints."""
    streaks = cv2.resize(
        fractal(rng, n, base=128, octaves=3, gain=0.8)[:, : n // 24].copy(),
        (n, n),
        interpolation=cv2.INTER_CUBIC,
    )
    darker = np.clip(0.3 + 0.3 * streaks, 0, 1)
    return _stack(darker, 0.0, 1 + 0.025 * streaks, (0.00001 * streaks).astype(np.float32))


def _weave(rng: np.random.Generator, n: int) -> Map:
    x, y = unit_axes(n)
    threads = int(rng.integers(60, 110))
    weave = np.sin(2 * np.pi * x * threads) * np.sin(2 * np.pi * y * threads)
    dirt = fractal(rng, n, base=32, octaves=3)
    return _stack(0.0, 0.0, 1 + 0.05 * weave + 0.03 * dirt, (0.00006 * weave).astype(np.float32))


def _nonwoven(rng: np.random.Generator, n: int) -> Map:
    """Pressed fibres embossed with a fine slanted grid, as in a surgical drape."""
    x, y = unit_axes(n)
    clouds = fractal(rng, n, base=5, octaves=3)
    # About as fine as a pixel of the paper's camera: it shows in places only, and as moire.
    first = np.cos(2 * np.pi * (84 * y + 53 * x)) + 0.5 * np.cos(2 * np.pi * (61 * y - 78 * x))
    fibres = fractal(rng, n, base=230, octaves=2, gain=0.9)
    fibres = fibres - np.mean([np.roll(fibres, k, axis=1) for k in (-3, -2, 2, 3)], axis=0)
    fibres = fibres / fibres.std() + 0.6 * fractal(rng, n, base=60, octaves=3, gain=0.9)
    shade = (
        1
        + 0.10 * first * np.clip(0.55 + 0.4 * clouds, 0.1, 1.3)
        + 0.026 * (1 + 0.5 * clouds) * fibres
    )
    # Worn and pressed spots of a few millimetres.
    spots = 0.02 * fractal(rng, n, base=22, octaves=3, gain=0.9, drawn_out=2)
    return _stack(0.0, 0.0, shade + 0.006 * clouds + spots, (0.000012 * fibres).astype(np.float32))


def _carpet(rng: np.random.Generator, n: int) -> Map:
    """Loops of a few millimetres, some of them paler strands, on clouds of wear."""
    tufts = fractal(rng, n, base=70, octaves=3, gain=0.8)
    strands = cv2.resize(fractal(rng, n, base=64, octaves=3)[:, : n // 3].copy(), (n, n))
    pale = np.clip(1.3 * np.maximum(strands, strands[::-1].T) - 1.5, 0, 1)
    clouds = fractal(rng, n, base=6, octaves=4, gain=0.8)
    shade = np.clip(1 + 0.20 * tufts + 0.13 * clouds, 0.2, 2)
    fibres = _fibres(rng, n)
    mixed = np.clip(0.2 + 0.2 * tufts + pale + fibres, 0, 1)
    return _stack(mixed, 0.0, shade * (1 + 0.25 * fibres), 0.0003 * tufts)


def _fibres(rng: np.random.Generator, n: int) -> Plane:
    """Sparse bright strands of five to twenty millimetres, most of them one way."""
    plane = np.zeros((n, n), np.float32)
    for _ in range(n * n // 180):
        start, turn, long = rng.random(2) * n, rng.normal() * 0.7, n * rng.uniform(0.025, 0.1)
        end = start + long * np.array([np.cos(turn), np.sin(turn)])
        ends = [tuple(int(v) for v in p) for p in (start, end)]
        cv2.line(plane, ends[0], ends[1], float(rng.random()) ** 3, 2)
    return cv2.GaussianBlur(plane, (0, 0), 1.0)


def _grain(rng: np.random.Generator, n: int) -> Map:
    lines = cv2.resize(fractal(rng, n, base=64, octaves=2)[:, : n // 8].copy(), (n, n))
    lines = 0.5 * (lines + lines[:, ::-1])
    return _stack(0.0, 0.0, 1 + 0.04 * lines, (0.00001 * lines).astype(np.float32))


def _fine(rng: np.random.Generator, n: int) -> Map:
    dots = fractal(rng, n, base=64, octaves=2)
    return _stack(0.0, 0.0, 1 + 0.03 * dots, (0.00002 * dots).astype(np.float32))


def _smooth(rng: np.random.Generator, n: int) -> Map:
    return _stack(0.0, 0.0, 1.0, np.zeros((n, n), np.float32))


MACRO: Mapping[str, Pattern] = {
    "plain": _plain,
    "board": _board,
    "drape": _drape,
    "cloth": _cloth,
    "wood": _wood,
    "noise": _noise,
    "checker": _checker,
    "plaid": _plaid,
    "brick": _brick,
    "blobs": _blobs,
    "worn": _worn,
}
MICRO: Mapping[str, Pattern] = {
    "weave": _weave,
    "carpet": _carpet,
    "grain": _grain,
    "fine": _fine,
    "smooth": _smooth,
    "nonwoven": _nonwoven,
}
