"""The classes that a crop network tells apart: "assembly/detector class" of parts, and joined groups.

A group is what is joined to an assembly's base part. Its crop is cut about the base part and is as
wide as the assembly gets, so that it does not depend on what is joined, nor on how the base is turned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from asdfviz.datatypes import Assembly, Part
from asdfviz.geometry.rotation_grid import Equivalents
from asdfviz.geometry.sampling import even_directions, hull_corners, surface_middle
from asdfviz.geometry.shapes import Box, Intrinsics, Points, Transform, Vector
from asdfviz.geometry.transforms import apply

CORNERS = 96
"""Points of a class from which its box follows."""
GROUP_REACH = 0.7
"""Of the distance from the base part's middle to the farthest point of any state: the crop's context
adds some, and of few views the rest is missed."""
GROUP = "group"


@dataclass(frozen=True, slots=True, eq=False)
class CropClass:
    """One class of a crop network; of a group, everything but `states` is about the base part."""

    name: str
    assembly: int
    """Place in the list of assemblies."""
    parts: tuple[str, ...]
    """Names of the parts that share it; exact repeats."""
    middle: Vector
    """`surface_middle` of the mesh, part's frame, metres."""
    diameter: float
    """Of the part, or of the space that a group may take."""
    corners: Points
    """Points about which boxes are drawn, part's frame."""
    equivalents: Equivalents
    states: tuple[str, ...] = ()
    """Names of the states that are told apart; none for a part."""


def class_name(assembly: Assembly, part: Part) -> str:
    """The name that a part has in a network for several assemblies."""
    return f"{assembly.name}/{part.detector_class}"


def group_name(assembly: Assembly) -> str:
    """The name that what is joined to the base has in a network for several assemblies."""
    return f"{assembly.name}//{GROUP}"


def crop_classes(assemblies: Sequence[Assembly]) -> tuple[CropClass, ...]:
    """The classes of assemblies: those of all parts, in their order, then a group for each."""
    classes = [c for i, assembly in enumerate(assemblies) for c in _part_classes(assembly, i)]
    classes += [_group_class(assembly, i) for i, assembly in enumerate(assemblies)]
    return tuple(classes)


def group_states(classes: Sequence[CropClass]) -> dict[str, tuple[str, ...]]:
    """Of every group among the classes the states that are told apart, in order."""
    return {c.name: c.states for c in classes if c.states}


def state_spans(states: Mapping[str, Sequence[str]]) -> dict[str, slice]:
    """Where the states of each group lie among the network's outputs: one group's after another's."""
    ends = accumulate(len(of) for of in states.values())
    pairs = zip(states.items(), ends, strict=True)
    return {name: slice(end - len(of), end) for (name, of), end in pairs}


def group_radius(assembly: Assembly) -> float:
    """Half of the extent that a group's box is given, about the base part's middle, metres."""
    middle = _middle(assembly.parts[assembly.base])
    farthest = max(
        float(np.linalg.norm(apply(T, assembly.parts[name].mesh.vertices) - middle, axis=1).max())
        for state in assembly.states
        for name, T in state.T_base_part.items()
    )
    return GROUP_REACH * farthest


def group_box(assembly: Assembly, radius: float, T_camera_base: Transform, K: Intrinsics) -> Box:
    """The box of what is joined to the base part, pixels.

    Args:
        assembly: gives the base part.
        radius: `group_radius` of it.
        T_camera_base: where the base part is.
        K: of the frame.
    """
    x, y, z = apply(T_camera_base, _middle(assembly.parts[assembly.base])[None])[0]
    u, v = K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]
    half_u, half_v = K[0, 0] * radius / z, K[1, 1] * radius / z
    return np.array([u - half_u, v - half_v, u + half_u, v + half_v])


def _part_classes(assembly: Assembly, place: int) -> list[CropClass]:
    names: dict[str, list[str]] = {}
    for part in assembly.parts.values():
        names.setdefault(part.detector_class, []).append(part.name)
    return [
        CropClass(
            name=class_name(assembly, assembly.parts[parts[0]]),
            assembly=place,
            parts=tuple(parts),
            middle=_middle(assembly.parts[parts[0]]),
            diameter=assembly.parts[parts[0]].diameter,
            corners=hull_corners(assembly.parts[parts[0]].mesh.vertices, CORNERS),
            equivalents=Equivalents.of(assembly.parts[parts[0]].symmetries),
        )
        for parts in names.values()
    ]


def _group_class(assembly: Assembly, place: int) -> CropClass:
    base, radius = assembly.parts[assembly.base], group_radius(assembly)
    return CropClass(
        name=group_name(assembly),
        assembly=place,
        parts=(base.name,),
        middle=_middle(base),
        diameter=2 * radius,
        corners=_middle(base) + radius * even_directions(CORNERS),
        equivalents=Equivalents.of(base.symmetries),
        states=tuple(state.name for state in assembly.states),
    )


def _middle(part: Part) -> Vector:
    return surface_middle(part.mesh.vertices, part.mesh.faces)
