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

Map = Float32[np.ndarray, "n n 4"]
Plane = Float32[np.ndarray, "n n"]
Weight = Shaped[np.ndarray, "n n"] | float
Pattern: TypeAlias = Callable[[np.random.Generator, int], np.ndarray]


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
    """Heights (metres) of a cloth that lay folded: parallel ridges, few faint ones across them.

    A fold is steep on one side and leans out slowly on the other, so that light shows a bright and a
    shaded side; it weakens along its way. Short wrinkles run beside the folds, nearly along them.
    """
    x, y = _axes(n)
    wobble = fractal(rng, n, base=3, octaves=4)
    fading = np.clip(0.75 + 0.45 * fractal(rng, n, base=4, octaves=3), 0.1, 1.6)
    height = np.zeros((n, n), np.float32)
    for axis, share, apart in ((0, 1.0, 1.0), (1, 0.35, 3.1)):
        direction = axis * np.pi / 2 + rng.normal() * 0.04
        pitch = spacing * rng.uniform(0.85, 1.2) * apart
        for place in np.arange(rng.random() * pitch, 1.2, pitch):
            angle = direction + rng.normal() * 0.025
            d = np.cos(angle) * x + np.sin(angle) * y - place + 0.0016 * wobble
            steep, slow = rng.uniform(0.0009, 0.0026), rng.uniform(0.007, 0.022)
            if rng.random() < 0.5:
                d = -d
            power = strength * share * rng.uniform(0.35, 1.0) * rng.choice([1.0, -0.6])
            height += power * fading * np.exp(-np.abs(d) / np.where(d > 0, slow, steep))
    window = n // 6
    for _ in range(150):
        row, column = rng.integers(0, n - window, 2)
        here = (slice(row, row + window), slice(column, column + window))
        cx, cy = (column + window / 2) / n, (row + window / 2) / n
        angle = rng.normal() * 0.5 + (np.pi / 2 if rng.random() < 0.3 else 0.0)
        along = -np.sin(angle) * (x[here] - cx) + np.cos(angle) * (y[here] - cy)
        d = np.cos(angle) * (x[here] - cx) + np.sin(angle) * (y[here] - cy)
        d = d + 0.003 * wobble[here]
        ridge = np.exp(
            -((d / rng.uniform(0.005, 0.014)) ** 2) - (along / rng.uniform(0.015, 0.04)) ** 2
        )
        height[here] += rng.normal() * 0.45 * strength * ridge
    return height.astype(np.float32)


def _drape(rng: np.random.Generator, n: int) -> Map:
    folds = _creases(rng, n, spacing=0.078, strength=0.0034)
    waves = fractal(rng, n, base=3, octaves=4, gain=0.42)
    height = folds + 0.007 * waves
    # Worn folds are a little paler than the cloth, whatever the light.
    worn = folds - cv2.GaussianBlur(folds, (0, 0), n / 250)
    clouds = fractal(rng, n, base=4, octaves=4, gain=0.5)
    shade = 1 + 0.010 * clouds + np.clip(100 * worn, -0.05, 0.12)
    specks = _specks(rng, n)
    return _stack(0.0, specks, shade, height.astype(np.float32))


def _specks(rng: np.random.Generator, n: int) -> Plane:
    """Lint: single pixels and short threads of the third colour, most of them faint."""
    plane = np.zeros((n, n), np.float32)
    for _ in range(n * n // 18000):
        row, column = rng.integers(2, n - 4, 2)
        long = int(rng.integers(1, 3))
        plane[row : row + long, column : column + 1 + (rng.random() < 0.3)] = (
            0.7 * rng.random() ** 3
        )
    return plane


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


def _board(rng: np.random.Generator, n: int) -> Map:
    """Pale veneer: long faint streaks, no joints."""
    streaks = cv2.resize(
        fractal(rng, n, base=128, octaves=3, gain=0.8)[:, : n // 24].copy(),
        (n, n),
        interpolation=cv2.INTER_CUBIC,
    )
    return _stack(0.0, 0.0, 1 + 0.025 * streaks, (0.00001 * streaks).astype(np.float32))


def _weave(rng: np.random.Generator, n: int) -> Map:
    x, y = _axes(n)
    threads = int(rng.integers(60, 110))
    weave = np.sin(2 * np.pi * x * threads) * np.sin(2 * np.pi * y * threads)
    dirt = fractal(rng, n, base=32, octaves=3)
    return _stack(0.0, 0.0, 1 + 0.05 * weave + 0.03 * dirt, (0.00006 * weave).astype(np.float32))


def _nonwoven(rng: np.random.Generator, n: int) -> Map:
    """Pressed fibres with a fine grid of dots, as in a surgical drape."""
    x, y = _axes(n)
    dots = 84
    grid = np.cos(2 * np.pi * dots * x) * np.cos(2 * np.pi * dots * y)
    # Fibres run mostly one way, which is how the web left the machine.
    drawn = fractal(rng, n, base=100, octaves=2, gain=0.9)
    drawn = np.mean([np.roll(drawn, k, axis=1) for k in range(10)], axis=0)
    fibres = 0.75 * drawn / drawn.std() + 0.55 * fractal(rng, n, base=110, octaves=2, gain=0.9)
    clouds = fractal(rng, n, base=10, octaves=3)
    shade = 1 + 0.045 * grid * (1 + 0.5 * clouds) + 0.034 * fibres + 0.004 * clouds
    return _stack(0.0, 0.0, shade, (0.00003 * fibres).astype(np.float32))


def _carpet(rng: np.random.Generator, n: int) -> Map:
    tufts = fractal(rng, n, base=90, octaves=3, gain=0.8)
    return _stack(
        np.clip(0.3 + 0.3 * tufts, 0, 1), 0.0, np.clip(1 + 0.2 * tufts, 0.2, 2), 0.0003 * tufts
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
}
MICRO: Mapping[str, Pattern] = {
    "weave": _weave,
    "carpet": _carpet,
    "grain": _grain,
    "fine": _fine,
    "smooth": _smooth,
    "nonwoven": _nonwoven,
}
