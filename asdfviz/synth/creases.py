"""Relief of a cloth that lay folded: fold lines, pinched wrinkles and free bends; used by the drape."""

from __future__ import annotations

import math

import numpy as np

from asdfviz.synth.fractals import Plane, fractal, unit_axes


def creased(rng: np.random.Generator, n: int, *, side: float) -> Plane:
    """Heights (metres) of all creases of a sheet `side` metres wide."""
    folds = _folds(rng, n, side=side) + _crumples(rng, n, side=side)
    return (folds + _bends(rng, n, side=side)).astype(np.float32)


def _folds(rng: np.random.Generator, n: int, *, side: float) -> Plane:
    """Heights (metres) of a sheet `side` metres wide that lay folded to a packet.

    Fold lines wander, fade out and come back; most alternate between ridge and valley, and one line may
    be both. Slopes grow towards a fold and change their sign on it, so that light shows a bright flank
    beside a dark one; the panels between are tilted a little. Few weaker lines run across, and faint
    ones anywhere; the cloth is pinched where strong ones cross.
    """
    x, y = (axis * side for axis in unit_axes(n))
    wander = 0.0030 * fractal(rng, n, base=3, octaves=3) + 0.0002 * fractal(
        rng, n, base=30, octaves=3
    )
    fades = fractal(rng, n, base=5, octaves=3, gain=0.7)
    near = np.zeros((2, n, n), np.float32)
    height = np.zeros((n, n), np.float32)
    for axis, share, apart in ((0, 1.0, 0.088), (1, 0.4, 0.27), (0, 0.35, 0.2), (1, 0.35, 0.3)):
        pitch = apart * rng.uniform(0.85, 1.2)
        sign = 1.0
        for place in np.arange(rng.random() * pitch, 1.1 * side, pitch).tolist():
            angle = axis * np.pi / 2 + rng.normal() * (0.02 if share > 0.5 else 0.12)
            aside = pitch * rng.normal() * (0.06 if share > 0.5 else 0.5)
            shift = tuple(int(v) for v in rng.integers(0, n, 2))
            # Plain numbers keep the planes in single precision: a third of the time.
            line = math.cos(angle) * x + math.sin(angle) * y - place - aside
            d = line + np.roll(wander, shift, (0, 1))
            sharp = np.sqrt(d * d + rng.uniform(0.0004, 0.0010) ** 2)
            flank = 0.0016 * 6.0 ** rng.random()
            fade = share + 0.75 * np.roll(fades, shift[::-1], (0, 1))
            power = sign * share * np.clip(fade, -0.5, 1.8)
            height += power * rng.uniform(0.13, 0.42) * flank * np.exp(-sharp / flank)
            height += float(power.mean()) * rng.uniform(0.0, 0.02) * sharp
            near[axis] = np.maximum(near[axis], np.abs(power) * np.exp(-((d / 0.011) ** 2)))
            sign *= -1.0 if rng.random() < 0.8 else 1.0
    pinched = near[0] * near[1] * fractal(rng, n, base=48, octaves=2)
    return (height + 0.0009 * pinched).astype(np.float32)


def _bends(rng: np.random.Generator, n: int, *, side: float) -> Plane:
    """Heights (metres) of a few curved folds that swell and taper."""
    x, y = (axis * side for axis in unit_axes(n))
    height = np.zeros((n, n), np.float32)
    for _ in range(7):
        # Roughly along the folds: what lies across them is pulled flat.
        spot, turn = rng.random(2) * side, np.pi / 2 * rng.choice([-1, 1]) + rng.normal() * 0.3
        radius, long = rng.uniform(0.12, 0.6), rng.uniform(0.04, 0.10)
        at_x, at_y = (float(v) for v in spot)
        center_x, center_y = at_x - radius * math.cos(turn), at_y - radius * math.sin(turn)
        d = np.hypot(x - center_x, y - center_y) - radius
        taper = np.exp(-((x - at_x) ** 2 + (y - at_y) ** 2) / long**2)
        flank = rng.uniform(0.004, 0.014)
        height += (
            float(rng.choice([-1.0, 1.0]))
            * rng.uniform(0.12, 0.36)
            * flank
            * (np.exp(-np.sqrt(d * d + (0.3 * flank) ** 2) / flank) * taper)
        )
    return height


def _crumples(rng: np.random.Generator, n: int, *, side: float) -> Plane:
    """Heights (metres) of short pinched wrinkles, mostly along or across the folds."""
    x, y = (axis * side for axis in unit_axes(n))
    wobble = fractal(rng, n, base=5, octaves=4)
    height = np.zeros((n, n), np.float32)
    window = n // 7
    for _ in range(190):
        row, column = rng.integers(0, n - window, 2)
        here = (slice(row, row + window), slice(column, column + window))
        cx, cy = (float(k + window / 2) / n * side for k in (column, row))
        angle = rng.normal() * 0.35 + (np.pi / 2 if rng.random() < 0.4 else 0.0)
        cos, sin = math.cos(angle), math.sin(angle)
        along = -sin * (x[here] - cx) + cos * (y[here] - cy)
        d = cos * (x[here] - cx) + sin * (y[here] - cy) + 0.002 * wobble[here]
        flank, long = rng.uniform(0.0025, 0.009), rng.uniform(0.008, 0.028)
        ridge = np.exp(-np.sqrt(d * d + 0.0007**2) / flank - (along / long) ** 2)
        height[here] += rng.normal() * 0.13 * flank * ridge
    return height
