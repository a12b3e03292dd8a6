"""Random looks: colours of parts, skin and cloth, grounds and lights."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Vector
from asdfviz.synth.description import Finish, Ground, Light
from asdfviz.synth.textures import MACRO_KINDS, MACRO_VARIANTS, MICRO_KINDS, MICRO_VARIANTS

FLOOR = -0.72
"""Height of the floor below the table's top, metres."""
FILAMENTS = (
    (28, 56, 190),
    (22, 22, 24),
    (235, 235, 228),
    (160, 158, 152),
    (210, 40, 30),
    (250, 120, 20),
)
"""Usual colours of printed plastic, sRGB."""
SKINS = ((236, 196, 170), (222, 170, 138), (196, 140, 106), (150, 98, 68), (98, 62, 44))
GLOVES = ((60, 110, 190), (25, 25, 28), (235, 235, 235), (120, 80, 170))


def veneer(pale: Vector) -> Float64[np.ndarray, "3 3"]:
    """The three colours of a table's wood: the second that of its darker streaks."""
    return np.stack([pale, pale * [0.95, 0.88, 0.77], pale])


def linear(srgb: object) -> Float64[np.ndarray, "*pixels 3"]:
    """Linear RGB (0 to 1) of sRGB colours (0 to 255)."""
    return (np.asarray(srgb, dtype=np.float64) / 255.0) ** 2.2


def random_hue(
    rng: np.random.Generator,
    *,
    saturation: tuple[float, float] = (0.1, 0.95),
    value: tuple[float, float] = (0.12, 0.88),
) -> Vector:
    """A colour with any hue, linear RGB."""
    hsv = np.array(
        [[[rng.random() * 360, rng.uniform(*saturation), rng.uniform(*value)]]], np.float32
    )
    return (cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0].astype(np.float64)) ** 2.2


def part_colors(
    assembly: Assembly, rng: np.random.Generator, *, true_share: float
) -> Mapping[str, Vector]:
    """A colour for each part: the real ones with small changes, or random ones."""
    kind = rng.random()
    if kind < true_share:
        jitter = {
            n: np.exp(rng.normal(size=3) * 0.06 + rng.normal() * 0.14) for n in assembly.parts
        }
        return {
            n: np.clip(linear(p.color) * jitter[n] + 0.004, 0.004, 0.85)
            for n, p in assembly.parts.items()
        }
    if kind < true_share + 0.25 * (1 - true_share):
        one = random_hue(rng)
        return {n: np.clip(one * np.exp(rng.normal() * 0.1), 0.003, 0.85) for n in assembly.parts}
    colors: dict[str, Vector] = {}
    for name in assembly.parts:
        filament = linear(FILAMENTS[int(rng.integers(len(FILAMENTS)))]) * np.exp(
            rng.normal() * 0.15
        )
        colors[name] = np.clip(filament if rng.random() < 0.5 else random_hue(rng), 0.003, 0.85)
    return colors


def plastic(color: Vector, rng: np.random.Generator) -> Finish:
    """Printed plastic."""
    return Finish(
        color=color,
        roughness=float(rng.uniform(0.22, 0.7)),
        mottling=float(rng.uniform(0, 0.16)),
        layer_axis=int(rng.choice(3, p=[0.2, 0.2, 0.6])),
        layer_height=float(rng.uniform(0.0006, 0.0025)),
        layer_depth=float(rng.uniform(0, 0.22)),
    )


def skin(rng: np.random.Generator) -> Finish:
    """Bare skin, or a glove in one of six cases."""
    if rng.random() < 0.17:
        color = linear(GLOVES[int(rng.integers(len(GLOVES)))]) * np.exp(rng.normal() * 0.15)
        return Finish(np.clip(color, 0.004, 0.8), float(rng.uniform(0.35, 0.6)), 0.1)
    tone = linear(SKINS[int(rng.integers(len(SKINS)))]) * np.exp(rng.normal(size=3) * 0.04)
    return Finish(tone, float(rng.uniform(0.45, 0.65)), 0.18, translucency=0.35)


def sleeve(rng: np.random.Generator) -> Finish:
    """Cloth of a sleeve."""
    color = random_hue(rng, saturation=(0.0, 0.6), value=(0.08, 0.8))
    return Finish(color, 0.95, 0.3)


def _micro(rng: np.random.Generator, kind: str | None = None) -> tuple[str, int]:
    chosen = kind if kind is not None else MICRO_KINDS[int(rng.integers(len(MICRO_KINDS)))]
    return chosen, int(rng.integers(MICRO_VARIANTS))


def _three(rng: np.random.Generator) -> Float64[np.ndarray, "3 3"]:
    first = random_hue(rng, saturation=(0.0, 0.8), value=(0.15, 0.9))
    related = np.clip(first * np.exp(rng.normal(size=3) * 0.25), 0.01, 0.9)
    second = related if rng.random() < 0.5 else random_hue(rng, saturation=(0.0, 0.8))
    return np.stack([first, second, random_hue(rng)])


def _outline(
    points: Float64[np.ndarray, "n 2"], rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "k 3"], tuple[float, float, float] | None]:
    """Edges or a circle that leave everything that stands on the table inside."""
    center = points.mean(axis=0) + rng.normal(size=2) * 0.03
    if rng.random() < 0.4:
        radius = float(np.linalg.norm(points - center, axis=1).max()) + rng.uniform(0.03, 0.35)
        return np.zeros((0, 3)), (float(center[0]), float(center[1]), float(radius))
    k = int(rng.integers(4, 9))
    angles = rng.random() * 2 * np.pi + (np.arange(k) + rng.uniform(-0.2, 0.2, k)) * 2 * np.pi / k
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    limits = (points @ normals.T).max(axis=0) + rng.uniform(0.03, 0.35, k)
    return np.column_stack([normals, limits]), None


def _plane(
    rng: np.random.Generator,
    height: float,
    macro: str,
    *,
    micro: str | None = None,
    colors: Float64[np.ndarray, "3 3"] | None = None,
    edges: Float64[np.ndarray, "k 3"] | None = None,
    circle: tuple[float, float, float] | None = None,
) -> Ground:
    return Ground(
        height=height,
        edges=np.zeros((0, 3)) if edges is None else edges,
        macro=(macro, int(rng.integers(MACRO_VARIANTS))),
        micro=_micro(rng, micro),
        colors=_three(rng) if colors is None else colors,
        angle=float(rng.random() * 2 * np.pi),
        offset=(float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5))),
        bump=float(rng.uniform(0.6, 1.8)),
        roughness=float(rng.uniform(0.55, 1.0)) if macro == "wood" else 0.95,
        circle=circle,
        scale=float(rng.uniform(0.8, 1.3)) * (0.42 if macro == "drape" else 1.0),
    )


def theatre(points: Float64[np.ndarray, "n 2"], rng: np.random.Generator) -> tuple[Ground, ...]:
    """Blue drape on a pale round table over a brown carpet, as in the paper's recordings."""
    change = 0.63 * np.exp(rng.normal(size=3) * 0.02 + rng.normal() * 0.05)
    blue, faded = linear((125, 166, 198)) * change, linear((133, 164, 188)) * change
    center = points.mean(axis=0) + rng.normal(size=2) * 0.02
    reach = float(np.linalg.norm(points - center, axis=1).max())
    radius = reach + rng.uniform(0.04, 0.15)
    # The drape is about as large as the table and hangs over its rim where it is larger.
    k = int(rng.integers(5, 11))
    angles = rng.random() * 2 * np.pi + (np.arange(k) + rng.uniform(-0.2, 0.2, k)) * 2 * np.pi / k
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    limits = np.maximum(
        (points @ normals.T).max(axis=0) + 0.02,
        normals @ center + radius * rng.uniform(0.85, 1.15, k),
    )
    outline = _corners_cut(np.column_stack([normals, limits]), rng)
    cloth = _plane(
        rng,
        0.0,
        "drape",
        micro="nonwoven",
        colors=np.stack([blue, faded, linear((215, 220, 222))]),
        edges=outline,
        circle=(float(center[0]), float(center[1]), radius + rng.uniform(0.0, 0.04)),
    )
    pale = linear((252, 205, 172)) * rng.uniform(0.54, 0.68)
    table = _plane(
        rng,
        -0.001,
        "board",
        micro="smooth",
        colors=veneer(pale),
        circle=(float(center[0]), float(center[1]), radius),
    )
    rim = _plane(
        rng,
        -0.003,
        "plain",
        micro="smooth",
        colors=np.stack([linear((196, 70, 46)) * rng.uniform(0.6, 1.1)] * 3),
        circle=(float(center[0]), float(center[1]), radius + rng.uniform(0.0005, 0.0016)),
    )
    brown = linear((80, 58, 44)) * rng.uniform(0.7, 1.3)
    carpet = np.stack([brown, brown * [1.8, 1.65, 1.5], brown * [1.06, 0.86, 0.98]])
    return cloth, table, rim, _plane(rng, FLOOR, "worn", micro="carpet", colors=carpet)


def _corners_cut(
    edges: Float64[np.ndarray, "k 3"], rng: np.random.Generator
) -> Float64[np.ndarray, "n 3"]:
    """An outline whose corners are rounded off by two more edges each, some more than others."""
    cuts = [edges]
    for one, other in zip(edges, np.roll(edges, -1, axis=0), strict=True):
        if one[0] * other[1] - one[1] * other[0] < 0.1:
            continue
        reach = rng.uniform(0.003, 0.02)
        # The centre of a circle that touches both edges; the cuts are tangents of it.
        pair = np.stack([one, other])
        middle = np.linalg.solve(pair[:, :2], pair[:, 2] - reach)
        for share in (0.33, 0.67):
            normal = one[:2] * (1 - share) + other[:2] * share
            normal /= np.linalg.norm(normal)
            cuts.append(np.array([[*normal, normal @ middle + reach]]))
    return np.concatenate(cuts)


def any_grounds(points: Float64[np.ndarray, "n 2"], rng: np.random.Generator) -> tuple[Ground, ...]:
    """A table of any look over a floor of any look."""
    macro = MACRO_KINDS[int(rng.integers(len(MACRO_KINDS)))]
    colors = None
    if macro == "wood" and rng.random() < 0.7:
        tone = linear((190, 140, 92)) * np.exp(rng.normal(size=3) * 0.12 + rng.normal() * 0.4)
        tone = np.clip(tone, 0.02, 0.75)
        colors = np.stack([tone, tone * rng.uniform(0.5, 0.8), tone])
    if rng.random() < 0.3:
        return (_plane(rng, 0.0, macro, colors=colors),)
    edges, circle = _outline(points, rng)
    top = _plane(rng, 0.0, macro, colors=colors, edges=edges, circle=circle)
    below = ("plain", "wood", "noise", "brick", "checker")[int(rng.integers(5))]
    dark = _three(rng) * rng.uniform(0.2, 0.8)
    return top, _plane(rng, FLOOR, below, colors=dark)


def room_lights(rng: np.random.Generator) -> tuple[tuple[Light, ...], Vector, Vector]:
    """Panels of several sizes on the ceiling of a bright room: overlapping shadows, some soft, some
    less, mostly to one side, and much light from all around."""
    warmth = rng.normal() * 0.05 + 0.04
    white = np.array([1 + warmth, 1.0, 1 - warmth])
    side, count = rng.random() * 2 * np.pi, int(rng.integers(2, 4))
    shares = rng.dirichlet(np.full(count, 2.5)) * rng.uniform(0.6, 1.5)
    lights: list[Light] = []
    for share in shares:
        azimuth, elevation = side + rng.normal() * 0.6, rng.uniform(0.6, 1.3)
        flat = np.cos(elevation)
        where = np.array([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)]) * 2.0
        radius = float(0.06 * (1.0 / 0.06) ** rng.random())
        lights.append(Light(where, radius, white * float(share)))
    # Shadows are lit by walls and sky, bluer than the lamps.
    sky = white * [0.92, 1.0, 1.08] * rng.uniform(0.20, 0.42)
    return tuple(lights), sky, rng.normal(size=3) * 0.12


def random_lights(
    rng: np.random.Generator, *, room: float = 0.35
) -> tuple[tuple[Light, ...], Vector, Vector]:
    """One to three area lights, the sky's light and how that varies with direction.

    Args:
        rng: throws.
        room: probability of the soft light of a bright room.
    """
    if rng.random() < room:
        return room_lights(rng)
    count = int(rng.choice([1, 2, 3], p=[0.45, 0.4, 0.15]))
    lights: list[Light] = []
    for _ in range(count):
        azimuth, elevation = rng.random() * 2 * np.pi, rng.uniform(0.6, 1.5)
        distance = rng.uniform(1.1, 2.2)
        flat = np.cos(elevation)
        where = np.array([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)])
        warmth = rng.normal() * 0.12
        color = np.array([1 + warmth, 1.0, 1 - warmth]) * rng.uniform(0.7, 1.5) / count
        lights.append(Light(where * distance, float(rng.uniform(0.04, 0.4)) * distance, color))
    cold = rng.normal() * 0.06
    sky = np.array([1 - cold, 1.0, 1 + cold]) * rng.uniform(0.25, 0.9)
    return tuple(lights), sky, rng.normal(size=3) * 0.2
