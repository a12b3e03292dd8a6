"""How one of our own assemblies is written down: pieces, steps and mistakes, in millimetres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from manifold3d import Manifold

from asdfviz.datatypes import Joint
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from

ABOUT_Z = Symmetries(continuous=(Axis(np.array([0.0, 0.0, 1.0]), np.zeros(3)),))
"""A part turned on the lathe, its axis z."""
Numbers = Sequence[float | int] | np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A printed shape and the parts that are made of it."""

    names: tuple[str, ...]
    """One a part; copies share shape and detector class, which has the first one's name."""
    solid: Manifold
    """mm, in the part's frame."""
    color: tuple[int, int, int]
    """sRGB of the filament."""
    symmetries: Symmetries = field(default_factory=Symmetries)
    """About the frame's origin."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What a state changes against the one before; of a mistake, against the one it follows."""

    name: str
    poses: Mapping[str, Transform] = field(default_factory=dict[str, Transform])
    """T_base_part with its translation in mm."""
    joints: Mapping[str, Joint] = field(default_factory=dict[str, Joint])
    after: str | None = None
    """Of a mistake: the last step that was right."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """One assembly; the first piece is the base part, the first step holds it alone."""

    title: str
    pieces: tuple[Piece, ...]
    steps: tuple[Step, ...]
    """The correct ones in order, mistakes after them."""


def freedom(
    kind: Literal["prismatic", "revolute", "cylindrical", "ball"],
    axis: Numbers,
    origin_mm: Numbers,
    *,
    slide_mm: tuple[float, float] = (0.0, 0.0),
    turn_deg: tuple[float, float] = (0.0, 0.0),
    link: str = "",
) -> Joint:
    """A joint from millimetres and degrees."""
    return Joint(
        kind,
        np.array(axis, dtype=float),
        np.array(origin_mm, dtype=float) * 1e-3,
        slide=(slide_mm[0] * 1e-3, slide_mm[1] * 1e-3),
        turn=(float(np.deg2rad(turn_deg[0])), float(np.deg2rad(turn_deg[1]))),
        link=link,
    )


def turned_alike(count: int) -> Symmetries:
    """Looks the same after every count-th of a turn about z."""
    z = np.array([0.0, 0.0, 1.0])
    turns = [rotation_about(z, 2 * np.pi * k / count) for k in range(1, count)]
    return Symmetries(discrete=tuple(transform_from(R, np.zeros(3)) for R in turns))
