"""Turns the GBOT data, the paper's four assemblies, into models that this program reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from asdfviz.data.assembly_writer import write_assembly
from asdfviz.data.atomic import make_folder, write_bytes
from asdfviz.data.gbot_facts import FACTS, Facts, Freedom, Mistake, Turns
from asdfviz.data.gbot_source import GbotSource
from asdfviz.data.resources import models_folder
from asdfviz.data.states_section import default_transitions, state_class_name
from asdfviz.datatypes import Assembly, Joint, Mesh, Part, State
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import orthonormalized, rotation_about, transform_from

_MM = 1e-3
_AXES = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}
_WEIGHTS = tuple(
    f"{name}.{ending}"
    for name in ("weights", "crops", "states", "masks")
    for ending in ("safetensors", "json")
)
_JOINT = "gbot"
"""Folder of shipped weights that know all of these assemblies; an assembly's own go before."""
_COMMENT = """Made by `asdfviz import-gbot` from the GBOT data (MIT licence).
State order and relative poses are derived from the meshes where assembly_state.json is absent."""


def import_gbot(source: Path, models: Path) -> list[Path]:
    """Write models/gbot_*/assembly.yaml with meshes and keypoints; return the yamls' paths.

    Assemblies of which the source holds no mesh at all are left out. Weights that ship with the
    program for an assembly are put beside it.

    Raises:
        AssemblyError: the source has none of the assemblies, lacks a mesh, or a file is wrong.
    """
    if not source.is_dir():
        raise AssemblyError(f"no folder at '{source}': give the folder with the GBOT data")
    gbot = GbotSource(source)
    written: list[Path] = []
    for key, facts in FACTS.items():
        record = gbot.description.get(key)
        if not isinstance(record, dict):
            continue
        raw = cast(Mapping[str, Any], record)
        if not any(gbot.has_mesh(str(p["id"])) for p in raw.get("parts", ())):
            continue
        try:
            assembly = _assembly(raw, facts, gbot)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise AssemblyError(
                f"{source}: the description of {key} is wrong: {error!r}"
            ) from error
        make_folder(models)
        written.append(write_assembly(assembly, models / facts.name, comment=_COMMENT))
        _copy_weights(facts.name, models / facts.name)
    if not written:
        raise AssemblyError(
            f"{source} holds no mesh of any GBOT assembly ({', '.join(FACTS)}), "
            "expected files such as NanoViseV2_VISE_BASE.ply or NanoViseV2_VISE_BASE_downsampled.ply"
        )
    return written


def _copy_weights(name: str, folder: Path) -> None:
    for file in _WEIGHTS:
        own, joint = models_folder() / name / file, models_folder() / _JOINT / file
        source = own if own.is_file() else joint
        if source.is_file() and source.resolve() != (folder / file).resolve():
            write_bytes(folder / file, source.read_bytes())


def _assembly(raw: Mapping[str, Any], facts: Facts, gbot: GbotSource) -> Assembly:
    parts = _parts(raw, facts, gbot)
    base = _full_name(str(raw["base_part"]).split()[0], tuple(parts))
    T_base_part = _base_poses(raw, base, parts, gbot)
    joints = {name: _joint(free) for name, free in facts.joints.items() if name in parts}
    steps = _steps(raw, base, T_base_part, joints)
    mistakes = [
        *(_given_error(error, steps, T_base_part) for error in raw.get("error_states", ())),
        *(_mistake(m, T_base_part, parts) for m in facts.mistakes),
    ]
    states = list(steps)
    for name, poses in mistakes:
        after = _last_completed(poses, steps)
        free = {n: j for n, j in joints.items() if n in steps[after].joints and n in poses}
        states.append(
            State(
                index=len(states),
                name=name,
                T_base_part=poses,
                is_error=True,
                after=after,
                detector_class=state_class_name(facts.name, name, index=len(states)),
                joints=free,
            )
        )
    classes = dict.fromkeys(p.detector_class for p in parts.values())
    return Assembly(
        name=facts.name,
        title=facts.title,
        base=base,
        parts=parts,
        states=tuple(states),
        transitions=default_transitions(states),
        detector_classes=(*classes, *(s.detector_class for s in states if s.detector_class)),
        path="",
    )


def _parts(raw: Mapping[str, Any], facts: Facts, gbot: GbotSource) -> dict[str, Part]:
    """Every piece by its obj_id, in the order of the authors' class numbers, copies after."""
    pieces = raw.get("instance_list") or [{**p, "part": p["id"]} for p in raw["parts"]]
    pieces = sorted(pieces, key=lambda p: (int(p["yolo_class"]), str(p["id"])))
    # One mesh object for all copies of a part: it is read, and later uploaded, once.
    meshes: dict[str, Mesh] = {}
    parts: dict[str, Part] = {}
    for piece in pieces:
        name, kind = str(piece["id"]), str(piece["part"])
        mesh = meshes.setdefault(kind, gbot.mesh(kind))
        color = facts.colors.get(kind)
        parts[name] = Part(
            name=name,
            mesh=mesh,
            keypoints=gbot.keypoints(kind, mesh),
            symmetries=_symmetries(facts.symmetries.get(kind)),
            diameter=diameter(mesh.vertices),
            color=_color(gbot, kind) if color is None else np.array(color, dtype=np.uint8),
            detector_class=kind,
            obj_id=len(parts) + 1,
        )
    return parts


def _color(gbot: GbotSource, kind: str) -> np.ndarray:
    found = gbot.color(kind)
    return np.array([200, 200, 200], dtype=np.uint8) if found is None else found


def _symmetries(turns: Turns | None) -> Symmetries:
    if turns is None:
        return Symmetries()
    axis = _AXES[turns.axis]
    if turns.folds == 0:
        return Symmetries(continuous=(Axis(axis, np.zeros(3)),))
    angles = [2 * np.pi * k / turns.folds for k in range(1, turns.folds)]
    return Symmetries(tuple(transform_from(rotation_about(axis, a), np.zeros(3)) for a in angles))


def _joint(free: Freedom) -> Joint:
    slide, turn = np.array(free.slide_mm) * _MM, np.deg2rad(free.turn_deg)
    return Joint(
        kind=free.kind,
        axis=np.array(free.axis, dtype=float),
        origin=np.array(free.origin_mm, dtype=float) * _MM,
        slide=(float(slide[0]), float(slide[1])),
        turn=(float(turn[0]), float(turn[1])),
    )


def _base_poses(
    raw: Mapping[str, Any], base: str, parts: Mapping[str, Part], gbot: GbotSource
) -> dict[str, Transform]:
    """Chain the links from the base outwards; the authors' own relative poses come first."""
    official = gbot.relative_poses(str(raw["folder_names"]["gbot_models"]))
    links = {
        (str(link["parent"]), str(link["child"])): np.array(link["T_parent_child"], dtype=float)
        for link in raw["links"]
    }
    replaced = {child for _, child in official}
    links = {pair: T for pair, T in links.items() if pair[1] not in replaced} | official
    # By part, its pose in the base's frame.
    chained: dict[str, Transform] = {base: np.eye(4)}
    while links:
        ready = [pair for pair in links if pair[0] in chained]
        if not ready:
            raise AssemblyError(f"links without a way to '{base}': {sorted(links)}")
        for parent, child in ready:
            T_parent_child = orthonormalized(links.pop((parent, child)))
            chained[child] = chained[parent] @ T_parent_child
    missing = set(parts) - set(chained)
    if missing:
        raise AssemblyError(f"no relative pose of {', '.join(sorted(missing))}")
    return chained


def _steps(
    raw: Mapping[str, Any],
    base: str,
    T_base_part: Mapping[str, Transform],
    joints: Mapping[str, Joint],
) -> list[State]:
    names = [str(name).split()[0] for name in raw["state_class_names"]]
    # Some assemblies leave state 0 out of their list of classes.
    if len(names) == len(raw["states"]) - 1:
        names.insert(0, f"{names[0].rsplit('_', 1)[0]}_0")
    poses: dict[str, Transform] = {base: np.eye(4)}
    steps: list[State] = []
    for index, step in enumerate(raw["states"]):
        if int(step["id"]) != index:
            raise AssemblyError(f"state {step['id']} stands at place {index}")
        added = [_full_name(str(name), tuple(T_base_part)) for name in step.get("added", ())]
        poses = {**poses, **{name: T_base_part[name] for name in added}}
        steps.append(
            State(
                index=index,
                name=names[index],
                T_base_part=poses,
                detector_class=names[index] if index > 0 else None,
                joints={n: j for n, j in joints.items() if n in poses},
            )
        )
    return steps


def _given_error(
    error: Mapping[str, Any], steps: Sequence[State], T_base_part: Mapping[str, Transform]
) -> tuple[str, dict[str, Transform]]:
    poses = {_full_name(str(name), tuple(T_base_part)): None for name in error["attached"]}
    moved = {str(n): np.array(T, dtype=float) for n, T in error["T_base_override"].items()}
    return str(error["name"]), {
        name: orthonormalized(moved[name]) if name in moved else T_base_part[name] for name in poses
    }


def _mistake(
    mistake: Mistake, T_base_part: Mapping[str, Transform], parts: Mapping[str, Part]
) -> tuple[str, dict[str, Transform]]:
    poses: dict[str, Transform] = {}
    for name in mistake.joined:
        pose = T_base_part[name].copy()
        if name in mistake.flipped:
            pose = pose @ _half_turn(parts[name].mesh, mistake.flipped[name])
        pose[:3, 3] += np.array(mistake.shifted_mm.get(name, (0.0, 0.0, 0.0))) * _MM
        poses[name] = pose
    return mistake.name, poses


def _half_turn(mesh: Mesh, axis: str) -> Transform:
    R = rotation_about(_AXES[axis], np.pi)
    return transform_from(R, mesh.middle - R @ mesh.middle)


def _last_completed(poses: Mapping[str, Transform], steps: Sequence[State]) -> int:
    """Index of the last state all of whose parts are joined where they belong."""
    done = [
        step.index
        for step in steps
        if all(n in poses and np.allclose(poses[n], T) for n, T in step.T_base_part.items())
    ]
    return max(done)


def _full_name(name: str, known: Sequence[str]) -> str:
    """The obj_id that a name of the description stands for; some leave the prefix out."""
    if name in known:
        return name
    longer = [k for k in known if k.endswith(f"_{name}")]
    if len(longer) != 1:
        raise AssemblyError(f"'{name}' is not a part; parts: {', '.join(known)}")
    return longer[0]
