"""The part classes that a crop network tells: "assembly/detector class", each with one shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Part
from asdfviz.geometry.rotation_grid import Equivalents
from asdfviz.geometry.sampling import surface_middle
from asdfviz.geometry.shapes import Vector


@dataclass(frozen=True, slots=True, eq=False)
class PartClass:
    """One class of a crop network."""

    name: str
    assembly: int
    """Place in the list of assemblies."""
    parts: tuple[str, ...]
    """Names of the parts that share it; exact repeats."""
    middle: Vector
    """`surface_middle` of the mesh, part's frame, metres."""
    diameter: float
    equivalents: Equivalents


def class_name(assembly: Assembly, part: Part) -> str:
    """The name that a part has in a network for several assemblies."""
    return f"{assembly.name}/{part.detector_class}"


def part_classes(assemblies: Sequence[Assembly]) -> tuple[PartClass, ...]:
    """The classes of assemblies, in their order and that of their parts."""
    classes: list[PartClass] = []
    for place, assembly in enumerate(assemblies):
        names: dict[str, list[str]] = {}
        for part in assembly.parts.values():
            names.setdefault(part.detector_class, []).append(part.name)
        for parts in names.values():
            part = assembly.parts[parts[0]]
            classes.append(
                PartClass(
                    name=class_name(assembly, part),
                    assembly=place,
                    parts=tuple(parts),
                    middle=surface_middle(part.mesh.vertices, part.mesh.faces),
                    diameter=part.diameter,
                    equivalents=Equivalents.of(part.symmetries),
                )
            )
    return tuple(classes)
