"""A pose as figures to read and to type: position in millimetres, turns about the camera's axes. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Rotation, Transform
from asdfviz.geometry.transforms import rotation_about, transform_from

FIGURES = ("x", "y", "z", "turn x", "turn y", "turn z")
"""Position of the part's origin in the camera frame, millimetres; turns about the camera's axes, degrees."""
FARTHEST_MM = 1e5
"""No camera sees farther."""


def euler_deg(R: Rotation) -> tuple[float, float, float]:
    """Turns about the camera's x, then y, then z axis (fixed axes) that give R, in degrees."""
    y = float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
    if abs(R[2, 0]) > 1 - 1e-9:
        x, z = float(np.arctan2(-R[0, 1] * np.sign(R[2, 0]), R[1, 1])), 0.0
    else:
        x = float(np.arctan2(R[2, 1], R[2, 2]))
        z = float(np.arctan2(R[1, 0], R[0, 0]))
    return (float(np.degrees(x)), float(np.degrees(y)), float(np.degrees(z)))


def figures_of(T_camera_part: Transform) -> dict[str, float]:
    """The figures of a pose, by name."""
    values = (*(1000 * T_camera_part[:3, 3]), *euler_deg(T_camera_part[:3, :3]))
    return {name: float(value) for name, value in zip(FIGURES, values, strict=True)}


def typed_pose(T_camera_part: Transform, typed: Mapping[str, str], *, part: str) -> Transform:
    """The pose with the figures that were typed; all others stay as exact as they were.

    Raises:
        AnnotationError: a figure is none, or lies where no camera sees it; nothing changes.
    """
    read = {name: _figure(name, said, part) for name, said in typed.items()}
    values = {**figures_of(T_camera_part), **read}
    if values["z"] <= 0:
        raise AnnotationError(
            f"{part} was not moved: z is {values['z']:g} mm, behind the camera; type more than 0"
        )
    t = np.array([values[name] / 1000 for name in FIGURES[:3]])
    if not any(name in read for name in FIGURES[3:]):
        return transform_from(T_camera_part[:3, :3], t)
    x, y, z = (math.radians(values[name]) for name in FIGURES[3:])
    axes = np.eye(3)
    R = rotation_about(axes[2], z) @ rotation_about(axes[1], y) @ rotation_about(axes[0], x)
    return transform_from(R, t)


def _figure(name: str, said: str, part: str) -> float:
    unit = "millimetres" if name in FIGURES[:3] else "degrees"
    try:
        value = float(said.strip().replace("\u2212", "-").replace(",", "."))
    except ValueError:
        value = math.nan
    if name not in FIGURES or not abs(value) <= FARTHEST_MM:
        raise AnnotationError(
            f"{part} was not moved: '{said}' is no {name} in {unit}; type a number such as 12.5"
        )
    return value
