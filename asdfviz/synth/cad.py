"""Makes the assemblies that this project designed itself and writes them as models.

The shapes are code (`own_*.py`); this module gives them colours, states and joints. The committed
models are what `write_own_assembly` makes, kept so by a test.
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
from asdfviz.datatypes import Assembly, Joint, Mesh, Part, State
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.synth import own_corner_clamp

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
    return OWN_ASSEMBLIES[name]()


def _corner_clamp() -> Assembly:
    along = own_corner_clamp.DIAGONAL
    axle = np.array([0.0, 0.0, own_corner_clamp.AXIS_HEIGHT]) * _METRE
    slide = _metres(own_corner_clamp.SLIDE)
    T_base_jaw = _in_metres(own_corner_clamp.jaw_pose())
    T_base_reversed = _in_metres(own_corner_clamp.reversed_jaw_pose())
    T_base_bolt = _in_metres(own_corner_clamp.bolt_pose())
    # Jaw and bolt share axis and origin: they move together, tip in socket.
    jaw_joint = Joint("prismatic", along, axle, slide=slide)
    bolt_joint = Joint("cylindrical", along, axle, slide=slide, turn=(-np.pi, np.pi))
    stuck = Joint("prismatic", along, axle, slide=_metres(own_corner_clamp.REVERSED_SLIDE))
    about_z = Symmetries(continuous=(Axis(np.array([0.0, 0.0, 1.0]), np.zeros(3)),))
    parts = (
        _part("base", own_corner_clamp.base_solid(), (0, 90, 170), 1),
        _part("jaw", own_corner_clamp.jaw_solid(), (225, 120, 20), 2),
        _part("bolt", own_corner_clamp.bolt_solid(), (205, 205, 200), 3, symmetries=about_z),
    )
    base = {"base": np.eye(4)}
    with_jaw = base | {"jaw": T_base_jaw}
    states = (
        _state(0, "base", base, {}),
        _state(1, "jaw", with_jaw, {"jaw": jaw_joint}),
        _state(2, "bolt", with_jaw | {"bolt": T_base_bolt}, {"jaw": jaw_joint, "bolt": bolt_joint}),
        _state(3, "jaw_reversed", base | {"jaw": T_base_reversed}, {"jaw": stuck}, after=0),
    )
    return _assembly("corner_clamp", "Corner clamp", parts, states)


OWN_ASSEMBLIES: dict[str, Callable[[], Assembly]] = {"corner_clamp": _corner_clamp}


def _state(
    index: int,
    name: str,
    poses: dict[str, Transform],
    joints: dict[str, Joint],
    *,
    after: int | None = None,
) -> State:
    return State(index, name, poses, is_error=after is not None, after=after, joints=joints)


def _assembly(
    name: str, title: str, parts: tuple[Part, ...], states: tuple[State, ...]
) -> Assembly:
    """Add the detector classes and the transitions that follow from parts and states."""
    named = tuple(
        State(
            s.index,
            s.name,
            s.T_base_part,
            is_error=s.is_error,
            after=s.after,
            detector_class=state_class_name(name, s.name, index=s.index),
            joints=s.joints,
        )
        for s in states
    )
    state_classes = [s.detector_class for s in named if s.detector_class]
    return Assembly(
        name=name,
        title=title,
        base=parts[0].name,
        parts={p.name: p for p in parts},
        states=named,
        transitions=default_transitions(named),
        detector_classes=(*(p.detector_class for p in parts), *state_classes),
        path="",
    )


def _part(
    name: str,
    solid: Manifold,
    color: tuple[int, int, int],
    obj_id: int,
    *,
    symmetries: Symmetries | None = None,
) -> Part:
    mesh = solid_mesh(solid, name=name)
    return Part(
        name=name,
        mesh=mesh,
        keypoints=default_keypoints(mesh),
        symmetries=symmetries or Symmetries(),
        diameter=diameter(mesh.vertices),
        color=np.array(color, dtype=np.uint8),
        detector_class=name,
        obj_id=obj_id,
    )


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


def _metres(span_mm: tuple[float, float]) -> tuple[float, float]:
    return span_mm[0] * _METRE, span_mm[1] * _METRE
