"""What an annotation says: edits as they are kept, and the poses and states that follow from them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, cast, get_args

import numpy as np

from asdfviz.datatypes import State
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import is_rigid

EditKind: TypeAlias = Literal[
    "pose", "remove_pose", "drop_pose", "verify", "state", "seed", "undo", "redo"
]
"""What a row does. An undo or redo names the step that it switches; nothing is ever deleted."""

Said: TypeAlias = Mapping[tuple[int, str], tuple[str, str]]
"""By frame number and part, the kind of what was last said and its provenance (`AnnotationStore.said`)."""

SeedKind: TypeAlias = Literal["none", "truth", "run"]

TRACKED = "tracked"
"""Provenance of a pose that a tracker carried from annotated frames."""
BY_STATE = "state"
"""Of one that follows from where the base is and how the state joins the part to it."""
DERIVED = frozenset({TRACKED, BY_STATE})
"""Such poses give way to what is derived anew; all others are a person's."""


@dataclass(frozen=True, slots=True, eq=False)
class Edit:
    """One row of the history."""

    id: int
    """Rises with every row and is never used again."""
    time: str
    """UTC, ISO 8601."""
    author: str
    kind: EditKind
    step: int
    """Id of the first edit of the step that is undone as one; of an undo or redo: the step meant."""
    frame: int | None
    last_frame: int | None
    """End of a range of frames, itself in it."""
    part: str | None
    payload: Mapping[str, Any]
    undone: bool


@dataclass(frozen=True, slots=True, eq=False)
class PoseAnnotation:
    """What the history says of one part in one frame."""

    T_camera_part: Transform | None
    """None where an annotator took the pose away."""
    provenance: str
    """Where it came from: "manual", "gizmo", "keys", "copied", "method:asdf" ..."""
    verified: bool
    author: str
    time: str
    """UTC, ISO 8601."""


@dataclass(frozen=True, slots=True)
class StateLabel:
    """The state of the assembly in a frame, as states.json has it."""

    state: int
    """Index of the last correctly completed state, also while an error is there."""
    is_error: bool = False
    name: str | None = None
    """Name of the state or error in assembly.yaml."""
    attached: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Seed:
    """What the corrections started from: nothing, the sequence's own truth, or a run."""

    kind: SeedKind = "none"
    run: str | None = None
    """Folder of the run."""
    method: str | None = None

    @property
    def provenance(self) -> str:
        """How a pose that was taken over is marked."""
        return f"method:{self.method}" if self.kind == "run" else self.kind


def gone_of(said: Said) -> set[tuple[int, str]]:
    """Frame numbers and parts that were said not to be there."""
    return {key for key, (kind, _) in said.items() if kind == "remove_pose"}


def by_hand_of(said: Said) -> set[tuple[int, str]]:
    """Those of which a person said where they are, that they are right or not there: nothing derived."""
    return {
        key
        for key, (kind, provenance) in said.items()
        if kind == "verify" or provenance not in DERIVED
    }


def label_of(state: State) -> StateLabel:
    """Return the label that a state of the assembly stands for."""
    return StateLabel(state.completed, state.is_error, state.name, state.attached)


def pose_payload(T_camera_part: Transform, provenance: str) -> dict[str, Any]:
    """Return what is kept of a pose: 16 numbers, row by row, that read back bit for bit.

    Raises:
        AnnotationError: the matrix is not a rigid transform.
    """
    if not is_rigid(T_camera_part):
        raise AnnotationError("a pose must be a rigid 4x4 transform, metres, part to camera")
    return {
        "T_camera_part": [float(value) for value in T_camera_part.ravel()],
        "provenance": provenance,
    }


def pose_from(payload: Mapping[str, Any]) -> Transform:
    """Read a pose back; the array is read-only."""
    T_camera_part = np.array(payload["T_camera_part"], dtype=np.float64).reshape(4, 4)
    T_camera_part.flags.writeable = False
    return T_camera_part


def label_payload(label: StateLabel | None) -> dict[str, Any]:
    """Return what is kept of a state label; None takes a label away."""
    if label is None:
        return {"state": None}
    return {
        "state": label.state,
        "is_error": label.is_error,
        "name": label.name,
        "attached": None if label.attached is None else list(label.attached),
    }


def label_from(payload: Mapping[str, Any]) -> StateLabel | None:
    """Read a state label back; None where it was taken away."""
    if payload["state"] is None:
        return None
    attached = payload["attached"]
    return StateLabel(
        state=payload["state"],
        is_error=payload["is_error"],
        name=payload["name"],
        attached=None if attached is None else tuple(attached),
    )


def edit_from_row(row: tuple[Any, ...]) -> Edit:
    """Read a row of the edits table.

    Raises:
        AnnotationError: the kind or the payload is none that this version writes.
    """
    number, time, author, kind, step, frame, last_frame, part, payload, undone = row
    if kind not in get_args(EditKind):
        raise AnnotationError(f"edit {number} is of the unknown kind '{kind}'")
    try:
        content = json.loads(payload)
    except ValueError as error:
        raise AnnotationError(f"edit {number} holds a payload that is no JSON: {error}") from error
    return Edit(
        id=number,
        time=time,
        author=author,
        kind=kind,
        step=step,
        frame=frame,
        last_frame=last_frame,
        part=part,
        payload=cast(Mapping[str, Any], content),
        undone=bool(undone),
    )


def annotation_from(edit: Edit) -> PoseAnnotation:
    """Return what a pose, remove_pose or verify edit says of its part."""
    return PoseAnnotation(
        T_camera_part=None if edit.kind == "remove_pose" else pose_from(edit.payload),
        provenance=edit.payload["provenance"],
        verified=edit.kind == "verify",
        author=edit.author,
        time=edit.time,
    )
