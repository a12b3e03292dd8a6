"""Writes an Assembly as assembly.yaml with its meshes: what data.assembly.load_assembly reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.data.meshes import default_keypoints
from asdfviz.data.ply import ply_bytes
from asdfviz.data.states_section import default_transitions, state_class_name
from asdfviz.datatypes import Assembly, Joint, Part, State
from asdfviz.errors import AssemblyError
from asdfviz.geometry.shapes import Transform

_MM = 1e3


class _Dumper(yaml.SafeDumper):
    """Puts a list of numbers on one line."""


def _represent_list(dumper: _Dumper, rows: list[Any]) -> yaml.Node:
    flat = not any(isinstance(row, (list, dict)) for row in rows)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", rows, flow_style=flat)


_Dumper.add_representer(list, _represent_list)


def write_assembly(assembly: Assembly, folder: Path, *, comment: str = "") -> Path:
    """Write folder/assembly.yaml, parts/*.ply (mm) and keypoints, and return the yaml's path.

    The yaml is written last, so that a folder with an assembly.yaml is whole.

    Args:
        assembly: what to write; its `path` is not used.
        folder: made if it does not exist.
        comment: lines put at the head of the yaml.

    Raises:
        AssemblyError: the states cannot be said in the file's form.
    """
    document = assembly_document(assembly)
    for part in assembly.parts.values():
        write_bytes(folder / _mesh_path(assembly, part), ply_bytes(part.mesh))
        if _has_own_keypoints(part):
            rows = "\n".join(" ".join(f"{x:.9f}" for x in row) for row in part.keypoints)
            write_text(folder / _keypoints_path(part), rows + "\n")
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_text(folder / "assembly.yaml", head + text)
    return folder / "assembly.yaml"


def assembly_document(assembly: Assembly) -> dict[str, Any]:
    """Return the yaml's content; lengths in mm, what `load_assembly` would fill in left out.

    Raises:
        AssemblyError: a state loses a part or a joint, which only an error state can.
    """
    document: dict[str, Any] = {
        "name": assembly.name,
        "title": assembly.title,
        "unit": "mm",
        "base": assembly.base,
        "parts": {name: _part(assembly, part) for name, part in assembly.parts.items()},
        "states": [],
    }
    before = State(-1, "", {assembly.base: np.eye(4)})
    for state in assembly.steps:
        document["states"].append(_state(assembly, state, before))
        before = state
    if assembly.errors:
        document["errors"] = [_error(assembly, state) for state in assembly.errors]
    if assembly.transitions != default_transitions(assembly.states):
        names = [s.name for s in assembly.states]
        document["transitions"] = [[names[a], names[b]] for a, b in sorted(assembly.transitions)]
    return document


def _part(assembly: Assembly, part: Part) -> dict[str, Any]:
    record: dict[str, Any] = {"mesh": _mesh_path(assembly, part), "color": part.color.tolist()}
    if _has_own_keypoints(part):
        record["keypoints"] = _keypoints_path(part)
    if part.detector_class != part.name:
        record["detector_class"] = part.detector_class
    if part.obj_id is not None:
        record["obj_id"] = part.obj_id
    symmetries: dict[str, Any] = {}
    if part.symmetries.discrete:
        symmetries["discrete"] = [_row(T) for T in part.symmetries.discrete]
    if part.symmetries.continuous:
        symmetries["continuous"] = [
            {"axis": _numbers(a.direction), "offset": _numbers(a.offset * _MM)}
            for a in part.symmetries.continuous
        ]
    if symmetries:
        record["symmetries"] = symmetries
    return record


def _state(assembly: Assembly, state: State, before: State) -> dict[str, Any]:
    lost = (set(before.T_base_part) - set(state.T_base_part)) | (
        set(before.joints) - set(state.joints)
    )
    if lost:
        raise AssemblyError(
            f"assembly '{assembly.name}': state '{state.name}' loses {', '.join(sorted(lost))}; "
            f"what an earlier state joined stays joined"
        )
    return _named(assembly, state) | _changes(state, before)


def _error(assembly: Assembly, state: State) -> dict[str, Any]:
    before = assembly.states[state.completed]
    record = _named(assembly, state) | {"after": before.name}
    removed = [name for name in before.T_base_part if name not in state.T_base_part]
    if removed:
        record["remove"] = removed
    return record | _changes(state, before)


def _named(assembly: Assembly, state: State) -> dict[str, Any]:
    record: dict[str, Any] = {"name": state.name}
    if state.detector_class != state_class_name(assembly.name, state.name, index=state.index):
        record["detector_class"] = state.detector_class or ""
    return record


def _changes(state: State, before: State) -> dict[str, Any]:
    record: dict[str, Any] = {}
    poses = {
        name: _pose(T)
        for name, T in state.T_base_part.items()
        if name not in before.T_base_part or not np.array_equal(T, before.T_base_part[name])
    }
    joints = {
        name: _joint(joint)
        for name, joint in state.joints.items()
        if name not in before.joints or _joint(joint) != _joint(before.joints[name])
    }
    if poses:
        record["poses"] = poses
    if joints:
        record["joints"] = joints
    return record


def _joint(joint: Joint) -> dict[str, Any]:
    record: dict[str, Any] = {
        "kind": joint.kind,
        "axis": _numbers(joint.axis),
        "origin": _numbers(joint.origin * _MM),
    }
    if joint.slide != (0.0, 0.0):
        record["slide"] = _numbers(np.array(joint.slide) * _MM)
    if joint.turn != (0.0, 0.0):
        record["turn"] = _numbers(np.rad2deg(joint.turn))
    if joint.link:
        record["link"] = joint.link
    return record


def _pose(T_base_part: Transform) -> dict[str, Any]:
    return {"R": _numbers(T_base_part[:3, :3]), "t": _numbers(T_base_part[:3, 3] * _MM)}


def _row(T: Transform) -> list[float]:
    T_mm = T.copy()
    T_mm[:3, 3] *= _MM
    return _numbers(T_mm)


def _numbers(values: np.ndarray) -> list[float]:
    # Nine digits keep a rotation orthonormal to 1e-9; adding 0 turns -0.0 into 0.0.
    return [float(x) + 0.0 for x in np.round(np.asarray(values, dtype=float).reshape(-1), 9)]


def _mesh_path(assembly: Assembly, part: Part) -> str:
    """Copies of a part hold one mesh object between them and share its file."""
    first = next(p for p in assembly.parts.values() if p.mesh is part.mesh)
    return f"parts/{first.name}.ply"


def _keypoints_path(part: Part) -> str:
    return f"keypoints/{part.name}.txt"


def _has_own_keypoints(part: Part) -> bool:
    return bool(np.abs(default_keypoints(part.mesh) - part.keypoints).max() > 1e-6)
