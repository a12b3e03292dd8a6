"""The truth to export: what people answer for. What they left alone in a run's poses are its guesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from asdfviz.annotate.corrected import (
    corrected_truth,
    known_assembly,
    labels_by_frame,
    seed_truth,
)
from asdfviz.annotate.identity import open_annotation, own_annotation_file
from asdfviz.annotate.records import gone_of
from asdfviz.annotate.store import AnnotationStore
from asdfviz.datatypes import Assembly, FrameTruth, Sequence
from asdfviz.errors import AnnotationError, counted


@dataclass(frozen=True, slots=True)
class Checked:
    """A truth without its guesses, and how many there were."""

    truth: dict[int, FrameTruth]
    """By frame number: poses that were set, tracked or verified, and states that were set."""
    frames: int = 0
    """Frames with poses in which nobody touched a part; all of them are left out,"""
    poses: int = 0
    """and poses in the others that nobody touched, which are left out, too."""

    @property
    def told(self) -> str:
        """What was left out; empty where nothing was."""
        said: list[str] = []
        if self.frames:
            said.append(f"{counted(self.frames, 'frame')} left out in which nobody checked a pose")
        if self.poses:
            said.append(
                f"{counted(self.poses, 'pose')} left out that nobody checked, beside checked parts"
            )
        return "; ".join(said)


def checked_truth(
    store: AnnotationStore, truth: Mapping[int, FrameTruth], assembly: Assembly
) -> Checked:
    """Leave a run's guesses out of the truth that corrections of it make.

    A part that was taken away is known not to be there, also where all others are guesses: those are
    unchecked.

    Args:
        store: the corrections.
        truth: theirs, by frame number, over the run's.
        assembly: the parts and states that may occur.
    """
    touched: dict[int, set[str]] = {}
    for frame, part in store.said():
        touched.setdefault(frame, set()).add(part)
    labels = labels_by_frame(store.state_ranges(), frozenset(truth), assembly)
    kept: dict[int, FrameTruth] = {}
    left_out = poses = 0
    for index, frame in truth.items():
        if index not in labels:
            frame = replace(frame, state=None, is_error=None, attached=None, error=None)
        mine = {n: T for n, T in frame.T_camera_part.items() if n in touched.get(index, ())}
        guessed = len(frame.T_camera_part) - len(mine)
        is_touched = index in touched
        left_out += bool(guessed) and not is_touched
        poses += guessed if is_touched else 0
        if is_touched or index in labels:
            visible = {n: share for n, share in frame.visible.items() if n in mine}
            others = tuple(n for n in assembly.parts if n not in touched.get(index, ()))
            kept[index] = replace(
                frame,
                T_camera_part=mine,
                visible=visible,
                lists_parts=is_touched,
                unchecked=others,
            )
    return Checked(kept, left_out, poses)


@dataclass(frozen=True, slots=True)
class Annotated:
    """What an annotation file says of its sequence."""

    truth: dict[int, FrameTruth]
    """Corrected poses and states, by frame number."""
    gone: set[tuple[int, str]]
    """Frame numbers and parts that a person said are not there."""
    unchecked: str = ""
    """What to say of a run's guesses, if corrections started from one."""


def annotated(
    sequence: Sequence, *, annotations: Path | None = None, guesses: bool = False
) -> Annotated:
    """Return what the file of a sequence in an annotations folder says.

    Args:
        sequence: what was corrected; its assembly must be known.
        annotations: the folder; None for the default one.
        guesses: whether what nobody checked in a run that corrections started from counts as well.

    Raises:
        AnnotationError: there is no file or nothing in it, it cannot be used, or the assembly is
            not known.
        InputError: what the corrections started from cannot be read.
    """
    assembly = known_assembly(sequence.assembly)
    file = own_annotation_file(sequence, folder=annotations)
    if not file.is_file():
        raise _nothing_annotated(sequence, f"there is no {file}")
    with open_annotation(sequence, assembly, folder=annotations) as store:
        seed = store.seed()
        truth = corrected_truth(
            store,
            seed_truth(seed, sequence, assembly),
            assembly=assembly,
            frames=sequence.frame_indices,
        )
        checked = Checked(truth)
        if seed.kind == "run" and not guesses:
            checked = checked_truth(store, truth, assembly)
        gone = gone_of(store.said())
    if not any(
        frame.T_camera_part or frame.lists_parts or frame.state is not None
        for frame in checked.truth.values()
    ):
        raise _nothing_annotated(sequence, f"{file} has neither poses nor states")
    return Annotated(checked.truth, gone, checked.told)


def _nothing_annotated(sequence: Sequence, why: str) -> AnnotationError:
    return AnnotationError(
        f"nothing is annotated in '{sequence.name}': {why}; correct it in "
        "`asdfviz view` first, or name the folder of the corrections with --annotations"
    )
