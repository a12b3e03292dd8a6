"""The solids that our own parts are put together from; millimetres and degrees throughout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64
from manifold3d import CrossSection, Manifold

from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import transform_from

Length: TypeAlias = float | int
Pair: TypeAlias = tuple[Length, Length]
Outline: TypeAlias = Sequence[Pair] | Float64[np.ndarray, "n 2"]

ROUND = 24
"""Sides of a cylinder."""
_PRESSURE_ANGLE = float(np.deg2rad(25.0))
"""Of the teeth; wide, so that wheels of few teeth need no undercut."""
_ADDENDUM, _DEDENDUM = 0.8, 1.05
"""Height of a tooth over and its depth under the pitch line, in modules (stub teeth print well)."""
_FLANK_POINTS = 4


def placed(t: Sequence[Length], *, x: Sequence[Length], z: Sequence[Length]) -> Transform:
    """The pose (mm) of a frame at `t` whose x and z axes point as said."""
    return transform_from(
        axes(np.array(x, dtype=float), np.array(z, dtype=float)), np.array(t, dtype=float)
    )


def axes(x: Vector, z: Vector) -> Float64[np.ndarray, "3 3"]:
    """The rotation whose columns are x, z cross x and z."""
    return np.stack([x, np.cross(z, x), z], axis=1)


def box(x: Pair, y: Pair, z: Pair) -> Manifold:
    """A box from its spans."""
    low, high = np.array([x, y, z], dtype=float).T
    return Manifold.cube(tuple(high - low)).translate(tuple(low))


def rounded_box(x: Pair, y: Pair, z: Pair, *, radius: Length) -> Manifold:
    """A box whose upright edges are rounded."""
    corners = [
        (a, b) for a in (x[0] + radius, x[1] - radius) for b in (y[0] + radius, y[1] - radius)
    ]
    return outline_of(corners, radius=radius).extrude(z[1] - z[0]).translate((0, 0, z[0]))


def outline_of(centers: Sequence[Pair], *, radius: Length) -> CrossSection:
    """The hull of circles of one radius."""
    circle = CrossSection.circle(radius, ROUND)
    return CrossSection.batch_hull([circle.translate((float(a), float(b))) for a, b in centers])


def cylinder(radius: Length, bottom: Length, top: Length, *, at: Pair = (0.0, 0.0)) -> Manifold:
    """An upright cylinder."""
    return Manifold.cylinder(top - bottom, radius, radius, ROUND).translate((*at, bottom))


def cone(bottom: Pair, top: Pair, *, at: Pair = (0.0, 0.0)) -> Manifold:
    """An upright truncated cone between two (radius, height)."""
    solid = Manifold.cylinder(top[1] - bottom[1], bottom[0], top[0], ROUND)
    return solid.translate((*at, bottom[1]))


def hexagon(across: Length, bottom: Length, top: Length, *, at: Pair = (0.0, 0.0)) -> Manifold:
    """An upright hexagonal bar, `across` its flats."""
    radius = across / np.sqrt(3.0)
    return Manifold.cylinder(top - bottom, radius, radius, 6).translate((*at, bottom))


def prism(outline: Outline, height: Length) -> Manifold:
    """An outline, of either sense, extruded upwards from z = 0."""
    points = np.array(outline, dtype=float)
    x, y = points.T
    # manifold3d turns a clockwise outline into nothing, without a word.
    if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() < 0:
        points = points[::-1]
    return CrossSection([points]).extrude(height)


def polar_prism(radius: Float64[np.ndarray, "n"], height: Length) -> Manifold:
    """A prism whose outline has these radii at even angles, from x on."""
    angle = np.linspace(0, 2 * np.pi, len(radius), endpoint=False)
    return prism(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), height)


def thread(
    radius: Length, bottom: Length, top: Length, *, pitch: Length, depth: Length
) -> Manifold:
    """A right-handed V-thread about z: a cross-section whose radius falls and rises once a turn.

    The groove lies at x = 0 where z is a multiple of the pitch, wherever the thread begins, so that
    screw and nut of one pitch fit when their axes and x directions agree.
    """
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    reach = radius - depth * (1 - np.abs(angle / np.pi - 1))
    outline = np.stack([-reach * np.cos(angle), -reach * np.sin(angle)], axis=1)
    turns = (top - bottom) / pitch
    solid = CrossSection([outline]).extrude(top - bottom, int(np.ceil(10 * turns)), 360 * turns)
    return solid.rotate((0, 0, 360 * bottom / pitch)).translate((0, 0, bottom))


def gear(module: Length, teeth: int, *, backlash: Length = 0.3) -> CrossSection:
    """An involute gear about the origin, a tooth on x; the backlash thins every tooth."""
    pitch_radius = module * teeth / 2
    base = float(pitch_radius * np.cos(_PRESSURE_ANGLE))
    tip, root = pitch_radius + _ADDENDUM * module, pitch_radius - _DEDENDUM * module
    radius: Float64[np.ndarray, "n"] = np.linspace(max(base, root), tip, _FLANK_POINTS)
    half = np.pi / (2 * teeth) - backlash / (2 * pitch_radius) + _involute(_PRESSURE_ANGLE)
    flank = half - _involute(np.arccos(np.minimum(base / radius, 1.0)))
    radii = np.concatenate([[root], radius, radius[::-1], [root]])
    angles = np.concatenate([[-flank[0]], -flank, flank[::-1], [flank[0]]])
    turns = np.arange(teeth)[:, None] * (2 * np.pi / teeth)
    a, r = (angles + turns).reshape(-1), np.tile(radii, teeth)
    return CrossSection([np.stack([r * np.cos(a), r * np.sin(a)], axis=1)])


def rack(module: Length, spaces: Sequence[Length]) -> list[Outline]:
    """The spaces between the teeth of a rack: to cut off a bar whose pitch line is y = 0, from y < 0.

    Args:
        module: of the gears that run on it.
        spaces: x of each space's middle.
    """
    slope = np.tan(_PRESSURE_ANGLE)
    deep, out = _DEDENDUM * module, (_ADDENDUM + 0.4) * module
    half = np.pi * module / 4
    narrow, wide = half - deep * slope, half + out * slope
    return [
        [(x - wide, -out), (x + wide, -out), (x + narrow, deep), (x - narrow, deep)] for x in spaces
    ]


def _involute(angle: np.ndarray | float) -> np.ndarray:
    return np.asarray(np.tan(angle) - angle)
