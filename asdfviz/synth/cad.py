"""Makes the assemblies that this project designed itself and writes them as models.

The designs are code (`own_*.py`, in millimetres); this module turns them into an Assembly. The
committed models are what `write_own_assembly` makes, kept so by a test.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import Manifold

from asdfviz.data.assembly_writer import write_assembly
from asdfviz.data.meshes import default_keypoints
from asdfviz.data.states_section import default_transitions, state_class_name
from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.shapes import Transform
from asdfviz.synth import own_corner_clamp, own_geared_caliper, own_screw_clamp, own_vise
from asdfviz.synth.own_design import Design, Piece, Step

OWN_ASSEMBLIES: dict[str, Callable[[], Design]] = {
    "corner_clamp": own_corner_clamp.design,
    "geared_caliper": own_geared_caliper.design,
    "vise": own_vise.design,
    "screw_clamp": own_screw_clamp.design,
}
_METRE = 1e-3
"""Metres per CAD unit."""
_MADE_BY = "Made by asdfviz.synth.cad.write_own_assembly: change the code, not this file."


def write_own_assembly(name: str, folder: Path) -> Path:
    """Write one of our own assemblies (yaml, PLYs in mm) and return its assembly.yaml.

    Raises:
        AssemblyError: no own assembly has that name.
    """
    return write_assembly(own_assembly(name), folder, comment=_MADE_BY)


def own_assembly(name: str) -> Assembly:
    """Build one of our own assemblies from its code; the same code gives the same meshes.

    Raises:
        AssemblyError: no own assembly has that name.
    """
    if name not in OWN_ASSEMBLIES:
        raise AssemblyError(
            f"'{name}' is not one of our own assemblies: {', '.join(OWN_ASSEMBLIES)}"
        )
    design = OWN_ASSEMBLIES[name]()
    parts: dict[str, Part] = {}
    for piece in design.pieces:
        parts |= _parts(piece, first_id=len(parts) + 1)
    base = next(iter(parts))
    states = _states(name, design.steps, base)
    part_classes = dict.fromkeys(p.detector_class for p in parts.values())
    return Assembly(
        name=name,
        title=design.title,
        base=base,
        parts=parts,
        states=states,
        transitions=default_transitions(states),
        detector_classes=(*part_classes, *(s.detector_class for s in states if s.detector_class)),
        path="",
    )


def _states(assembly: str, steps: tuple[Step, ...], base: str) -> tuple[State, ...]:
    states: list[State] = []
    before = State(-1, "", {base: np.eye(4)})
    for index, step in enumerate(steps):
        if step.after is not None:
            before = next(s for s in states if s.name == step.after)
        poses = {part: _in_metres(T) for part, T in step.poses.items()}
        state = State(
            index,
            step.name,
            {**before.T_base_part, **poses},
            is_error=step.after is not None,
            after=None if step.after is None else before.index,
            detector_class=state_class_name(assembly, step.name, index=index),
            joints={**before.joints, **step.joints},
        )
        states.append(state)
        before = state
    return tuple(states)


def _parts(piece: Piece, *, first_id: int) -> dict[str, Part]:
    mesh = solid_mesh(piece.solid, name=piece.names[0])
    keypoints = default_keypoints(mesh)
    return {
        name: Part(
            name=name,
            mesh=mesh,
            keypoints=keypoints,
            symmetries=piece.symmetries,
            diameter=diameter(mesh.vertices),
            color=np.array(piece.color, dtype=np.uint8),
            detector_class=piece.names[0],
            obj_id=obj_id,
        )
        for obj_id, name in enumerate(piece.names, start=first_id)
    }


def solid_mesh(solid: Manifold, *, name: str) -> Mesh:
    """The surface of a solid, in metres; its vertices are multiples of 0.1 um.

    Raises:
        AssemblyError: the solid is empty or in several pieces, which no printed part is.
    """
    pieces = len(solid.decompose())
    if solid.volume() <= 0 or pieces != 1:
        raise AssemblyError(
            f"part '{name}' is {pieces} pieces of {solid.volume():.1f} mm3 in all, "
            "expected one piece with a volume"
        )
    surface: Any = solid.to_mesh()
    vertices_mm = np.round(np.asarray(surface.vert_properties, dtype=np.float64)[:, :3], 4)
    return Mesh(vertices_mm * _METRE, np.array(surface.tri_verts, dtype=np.int32))


def _in_metres(T_mm: Transform) -> Transform:
    T = T_mm.copy()
    T[:3, 3] *= _METRE
    return T
