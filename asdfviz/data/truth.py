"""The truth of a scene folder: poses (scene_gt.json), visibility (scene_gt_info.json), states (states.json),
and the parts without a pose that may be there all the same (unchecked.json).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from asdfviz.data.cameras import frame_number
from asdfviz.data.json_files import Json, read_json
from asdfviz.data.scene_objects import SceneObject, assign_parts, read_scene_objects
from asdfviz.datatypes import Assembly, FrameTruth, State
from asdfviz.errors import SequenceError

STATES = "states.json"
UNCHECKED = "unchecked.json"


@dataclass(frozen=True, slots=True)
class StateTruth:
    """One entry of states.json."""

    state: int | None
    is_error: bool | None
    attached: tuple[str, ...] | None
    error: str | None = None


def read_truth(folder: Path, assembly: Assembly) -> dict[int, FrameTruth]:
    """Read what is known of each frame, by frame number; empty where the folder holds no truth.

    Objects that the assembly does not know are left out: they are distractors. An entry without any
    part says that none is there; a frame that has no entry says nothing of it.

    Raises:
        SequenceError: a file is broken, a pose is not rigid, a state or part is unknown, or a part
            has a pose and is unchecked.
    """
    objects = read_scene_objects(folder)
    states = read_states(folder, assembly)
    truth = {
        index: _frame_truth(index, objects.get(index), states.get(index), assembly)
        for index in sorted({*objects, *states})
    }
    for index, parts in _read_unchecked(folder, assembly).items():
        if index in truth:
            truth[index] = _with_unchecked(truth[index], parts, folder)
    return truth


def fitting_errors(truth: FrameTruth, assembly: Assembly) -> tuple[State, ...]:
    """The error states that a truth may mean, by all that it says; none where there is no error."""
    if not truth.is_error:
        return ()
    return tuple(
        error
        for error in assembly.errors
        if error.completed == truth.state
        and (truth.attached is None or set(error.attached) == set(truth.attached))
        and truth.error in (None, error.name)
    )


def read_states(folder: Path, assembly: Assembly) -> dict[int, StateTruth]:
    """Read states.json: a list of {"frame", "state", "is_error", "attached", "name"}, the last three optional.

    `state` is the index of the last correctly completed state, also while `is_error` is true; null
    where nobody knows it. `name` tells errors apart. Other keys are ignored.

    Raises:
        SequenceError: a frame twice, a state or a part that the assembly does not have.
    """
    file = folder / STATES
    if not file.is_file():
        return {}
    states: dict[int, StateTruth] = {}
    for entry in read_json(file, error=SequenceError).entries():
        index = entry.get("frame").integer()
        if index < 0:
            raise entry.get("frame").fail("a frame number, 0 or more")
        if index in states:
            raise SequenceError(f"{entry.where}: frame {index} has a second entry; keep one")
        states[index] = _parse_state(entry, assembly)
    return states


def unchecked_frames(folder: Path) -> frozenset[int]:
    """Numbers of the frames of which unchecked.json names parts, whatever they are called.

    Raises:
        SequenceError: the file is broken.
    """
    file = folder / UNCHECKED
    if not file.is_file():
        return frozenset()
    named = read_json(file, error=SequenceError).items().items()
    return frozenset(frame_number(key, field.where) for key, field in named if field.entries())


def _parse_state(entry: Json, assembly: Assembly) -> StateTruth:
    is_error, attached = entry.find("is_error"), entry.find("attached")
    name = entry.find("name")
    return StateTruth(
        state=_state_index(entry, assembly),
        is_error=None if is_error is None else is_error.boolean(),
        attached=None if attached is None else _parse_parts(attached, assembly.parts),
        error=name.text() if name is not None and is_error is not None and is_error.value else None,
    )


def _state_index(entry: Json, assembly: Assembly) -> int | None:
    if "state" in entry.items() and entry.find("state") is None:
        return None
    field = entry.get("state")
    state = field.integer()
    steps = assembly.steps
    if not 0 <= state < len(steps):
        raise SequenceError(
            f"{field.where} is {state}, but {assembly.name} has the correct states 0 to "
            f"{len(steps) - 1}; during an error give the last correct one and is_error"
        )
    return state


def _parse_parts(field: Json, parts: Iterable[str]) -> tuple[str, ...]:
    known = tuple(parts)
    names = tuple(entry.text() for entry in field.entries())
    for name in names:
        if name not in known:
            raise SequenceError(f"{field.where}: no part '{name}'; parts: {', '.join(known)}")
    return names


def _read_unchecked(folder: Path, assembly: Assembly) -> dict[int, tuple[str, ...]]:
    """Names of the parts by frame number; empty where the file is missing, as all is checked then."""
    file = folder / UNCHECKED
    if not file.is_file():
        return {}
    return {
        frame_number(key, field.where): _parse_parts(field, assembly.parts)
        for key, field in read_json(file, error=SequenceError).items().items()
    }


def _with_unchecked(truth: FrameTruth, parts: tuple[str, ...], folder: Path) -> FrameTruth:
    for name in parts:
        if name in truth.T_camera_part:
            raise SequenceError(
                f"{folder / UNCHECKED}: frame {truth.frame_index} names '{name}', which has a pose in "
                "scene_gt.json: take one of them away"
            )
    return replace(truth, unchecked=parts)


def _frame_truth(
    index: int,
    objects: tuple[SceneObject, ...] | None,
    state: StateTruth | None,
    assembly: Assembly,
) -> FrameTruth:
    found, _ = assign_parts(objects or (), assembly)
    return FrameTruth(
        frame_index=index,
        T_camera_part={name: item.T_camera_object for name, item in found.items()},
        state=None if state is None else state.state,
        is_error=None if state is None else state.is_error,
        attached=None if state is None else state.attached,
        error=None if state is None else state.error,
        visible={name: item.visible for name, item in found.items() if item.visible is not None},
        lists_parts=objects is not None,
    )
