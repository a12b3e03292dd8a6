"""Colours: parts, states, runs, and what text stands on them. Pure.

Parts take a colour-blind-safe qualitative set (Okabe and Ito, then Tol), states the ramp of
`render.state_ramp`, truth is neutral white, each run has a hue of its own.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from asdfviz.render.state_ramp import Rgb3

PART_COLORS: tuple[Rgb3, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (240, 228, 66),
    (213, 94, 0),
    (0, 114, 178),
    (170, 170, 170),
    (136, 204, 238),
    (153, 153, 51),
    (170, 68, 153),
    (68, 170, 153),
)
RUN_COLORS: tuple[Rgb3, ...] = (
    (94, 196, 255),
    (255, 138, 101),
    (186, 147, 255),
    (129, 212, 132),
    (255, 193, 79),
    (240, 120, 190),
    (120, 222, 210),
    (196, 180, 150),
)
TRUTH: Rgb3 = (255, 255, 255)
ANNOTATION: Rgb3 = (255, 214, 92)
UNKNOWN: Rgb3 = (58, 64, 72)
ERROR: Rgb3 = (226, 71, 71)


def part_colors(names: Iterable[str]) -> dict[str, Rgb3]:
    """One legible colour a part, the same everywhere."""
    return {name: PART_COLORS[i % len(PART_COLORS)] for i, name in enumerate(names)}


def run_color(place: int) -> Rgb3:
    """The hue of the run at a place of the list."""
    return RUN_COLORS[place % len(RUN_COLORS)]


def css(color: Rgb3, alpha: float = 1.0) -> str:
    """The colour as CSS writes it."""
    r, g, b = color
    return f"rgb({r} {g} {b})" if alpha >= 1 else f"rgb({r} {g} {b} / {alpha:.2f})"


def lighter(color: Rgb3) -> Rgb3:
    """Half-way to white: edges over faces of the colour."""
    r, g, b = (c + (255 - c) // 2 for c in color)
    return r, g, b


def luminance(color: Rgb3) -> float:
    """Relative luminance of WCAG 2, 0 to 1."""
    c = np.asarray(color, float) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: Rgb3, b: Rgb3) -> float:
    """Contrast ratio of WCAG 2, 1 to 21."""
    light, dark = sorted((luminance(a), luminance(b)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def ink(background: Rgb3) -> Rgb3:
    """Black or white, whichever reads better on a background."""
    black, white = (13, 15, 18), (255, 255, 255)
    return black if contrast(black, background) > contrast(white, background) else white
