"""The `states`, `errors` and `transitions` of an assembly.yaml."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import cast

import numpy as np

from asdfviz.data.yaml_fields import Fields
from asdfviz.datatypes import Joint, State
from asdfviz.errors import AssemblyError
from asdfviz.geometry.shapes import Transform

STATE_KEYS = ("name", "poses", "joints", "detector_class")
FARTHEST = 3.0
"""A part that is joined farther from the base than this, metres, is in another unit."""
JOINT_KINDS = ("prismatic", "revolute", "cylindrical", "ball")


def parse_states(
    fields: Fields, *, base: str, parts: tuple[str, ...], scale: float
) -> tuple[tuple[State, ...], frozenset[tuple[int, int]]]:
    """Return all states (correct ones first, errors after) and the transitions by index.

    Raises:
        AssemblyError: an unknown part or state, two states of one name, a gap.
    """
    poses: dict[str, Transform] = {base: np.eye(4)}
    joints: dict[str, Joint] = {}
    states: list[State] = []
    for index, raw in enumerate(fields.sequence("states")):
        item = Fields(raw, where=f"{fields.where}: state {index}")
        item.only(*STATE_KEYS)
        poses = {**poses, **_poses(item, parts, base, scale)}
        joints = {**joints, **_joints(item, tuple(poses), scale)}
        states.append(
            State(
                index=index,
                name=item.text("name"),
                T_base_part=poses,
                detector_class=_state_class(item, fields, index=index),
                joints=joints,
            )
        )
    if not states:
        raise AssemblyError(f"{fields.where}: 'states' is empty; state 0 is the base part alone")
    states += _parse_errors(fields, states, base=base, parts=parts, scale=scale)
    names = [s.name for s in states]
    if len(set(names)) != len(names):
        raise AssemblyError(f"{fields.where}: two states have one name: {', '.join(names)}")
    return tuple(states), _transitions(fields, states)


def state_class_name(assembly: str, state: str, *, index: int) -> str | None:
    """The detector class of a state that names none itself; state 0 has none.

    The authors' files have no class for state 0 either: it looks like the base part alone.
    """
    return None if index == 0 else f"{assembly}:{state}"


def _state_class(item: Fields, fields: Fields, *, index: int) -> str | None:
    fallback = state_class_name(fields.text("name"), item.text("name"), index=index)
    return item.text("detector_class", default=fallback or "") or None


def _parse_errors(
    fields: Fields, steps: list[State], *, base: str, parts: tuple[str, ...], scale: float
) -> list[State]:
    by_name = {s.name: s for s in steps}
    errors: list[State] = []
    for raw in fields.sequence("errors"):
        item = Fields(raw, where=f"{fields.where}: error {len(errors)}")
        item.only(*STATE_KEYS, "after", "remove")
        after = item.text("after")
        if after not in by_name:
            raise AssemblyError(
                f"{item.where}: 'after' is '{after}', use a state: {', '.join(by_name)}"
            )
        before = by_name[after]
        removed = {str(name) for name in item.sequence("remove")}
        there = set(before.T_base_part) - {base}
        if removed - there:
            raise AssemblyError(
                f"{item.where}: cannot remove {', '.join(sorted(removed - there))}; "
                f"joined in '{after}': {', '.join(sorted(there)) or 'nothing'}"
            )
        kept = {name: T for name, T in before.T_base_part.items() if name not in removed}
        poses = {**kept, **_poses(item, parts, base, scale)}
        joints = {name: joint for name, joint in before.joints.items() if name in kept}
        errors.append(
            State(
                index=len(steps) + len(errors),
                name=item.text("name"),
                T_base_part=poses,
                is_error=True,
                after=before.index,
                detector_class=_state_class(item, fields, index=len(steps) + len(errors)),
                joints={**joints, **_joints(item, tuple(poses), scale)},
            )
        )
    return errors


def _poses(item: Fields, parts: tuple[str, ...], base: str, scale: float) -> dict[str, Transform]:
    found: dict[str, Transform] = {}
    for name, raw in item.mapping("poses").items():
        _known(name, parts, f"{item.where}: poses")
        pose = Fields(raw, where=f"{item.where}: pose of '{name}'")
        pose.only("R", "t")
        found[name] = T_base_part = pose.pose(scale)
        apart = float(np.linalg.norm(T_base_part[:3, 3]))
        if apart > FARTHEST:
            raise AssemblyError(
                f"{pose.where} is {apart:.4g} m from the base part; does 't' have the file's unit?"
            )
        if name == base and not np.allclose(T_base_part, np.eye(4)):
            raise AssemblyError(
                f"{pose.where}: all poses are told from the base part; leave it out"
            )
    return found


def _joints(item: Fields, attached: tuple[str, ...], scale: float) -> dict[str, Joint]:
    found: dict[str, Joint] = {}
    for name, raw in item.mapping("joints").items():
        _known(name, attached, f"{item.where}: joints")
        joint = Fields(cast(Mapping[str, object], raw), where=f"{item.where}: joint of '{name}'")
        axis = joint.numbers("axis", 3, default=(0, 0, 1))
        if np.linalg.norm(axis) < 1e-9:
            raise AssemblyError(f"{joint.where}: the axis has length 0")
        joint.only("kind", "axis", "origin", "slide", "turn", "link")
        slide, turn = joint.span("slide"), joint.span("turn")
        found[name] = Joint(
            kind=joint.choice("kind", JOINT_KINDS),  # pyright: ignore[reportArgumentType]
            axis=axis / np.linalg.norm(axis),
            origin=joint.numbers("origin", 3, default=(0, 0, 0)) * scale,
            slide=(slide[0] * scale, slide[1] * scale),
            turn=(math.radians(turn[0]), math.radians(turn[1])),
            link=joint.text("link", default=""),
        )
    return found


def _known(name: str, known: tuple[str, ...], where: str) -> None:
    if name not in known:
        raise AssemblyError(f"{where}: '{name}' is not known here; known: {', '.join(known)}")


def _transitions(fields: Fields, states: list[State]) -> frozenset[tuple[int, int]]:
    index = {s.name: s.index for s in states}
    given = fields.sequence("transitions")
    pairs: set[tuple[int, int]] = set()
    for entry in given:
        if not isinstance(entry, list) or len(cast(list[object], entry)) != 2:
            raise AssemblyError(f"{fields.where}: a transition is [from, to], got {entry!r}")
        names = [str(name) for name in cast(list[object], entry)]
        for name in names:
            _known(name, tuple(index), f"{fields.where}: transitions")
        pairs.add((index[names[0]], index[names[1]]))
    return frozenset(pairs) if given else default_transitions(states)


def default_transitions(states: Sequence[State]) -> frozenset[tuple[int, int]]:
    """Each step to the next, and each error to and from the step that it follows."""
    steps = [s for s in states if not s.is_error]
    pairs = {(a.index, b.index) for a, b in pairwise(steps)}
    for error in states:
        if error.after is not None:
            pairs |= {(error.after, error.index), (error.index, error.after)}
    return frozenset(pairs)
