"""The truth that the corrections make: what they started from, with every edit on top.

Evaluation and export read truth in this form, whether people or a renderer made it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from asdfviz.annotate.kept_shares import KeptShares
from asdfviz.annotate.records import PoseAnnotation, Seed, StateLabel, label_of
from asdfviz.annotate.store import AnnotationStore
from asdfviz.data.result_csv import load_run_or_csv
from asdfviz.data.run_files import RUNS, is_unfilled
from asdfviz.datatypes import Assembly, FrameTruth, Run, Sequence
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Transform


def corrected_truth(
    store: AnnotationStore,
    base: Mapping[int, FrameTruth] | Run | Sequence,
    *,
    assembly: Assembly | None = None,
    frames: Iterable[int] | None = None,
) -> dict[int, FrameTruth]:
    """Return poses and states by frame number: the base, where nothing was corrected.

    Only frames that the base or an edit knows are in it. Visible shares are kept of parts that were
    not moved, unless one that was may hide them. A part without a pose is unchecked, unless it was taken
    away or the base knows it not there.

    Args:
        store: the corrections.
        base: what they are put over: truth, a run, or a sequence with its own truth.
        assembly: the parts and states that may occur; may be left to a sequence.
        frames: frame numbers of the sequence; without them and without a sequence as base, every
            number in a range of states counts as a frame.

    Raises:
        AnnotationError: an edit names a part or state that the assembly does not have, or the
            assembly is not known.
    """
    truth: Mapping[int, FrameTruth]
    if isinstance(base, Mapping):
        truth = base
    elif isinstance(base, Run):
        truth = truth_from_run(base, known_assembly(assembly))
    else:
        truth = _truth_of(base)
        assembly = assembly or base.assembly
        frames = base.frame_indices if frames is None else frames
    assembly = known_assembly(assembly)
    known = None if frames is None else frozenset(frames)
    poses = _poses_by_frame(store, assembly)
    labels = labels_by_frame(store.state_ranges(), known, assembly)
    wanted = {*truth, *poses, *labels}
    wanted = wanted if known is None else wanted & known
    shares = KeptShares(assembly)
    return {
        index: _corrected_frame(
            truth.get(index, FrameTruth(index, {}, None)),
            poses.get(index, {}),
            labels.get(index),
            assembly,
            shares,
        )
        for index in sorted(wanted)
    }


def seed_truth(seed: Seed, sequence: Sequence, assembly: Assembly) -> dict[int, FrameTruth]:
    """Return what the corrections start from, by frame number.

    Raises:
        AnnotationError: they started from a run that was never saved, or from truth that is gone.
        RunError: the run that they started from cannot be read.
        SequenceError: the sequence's truth cannot be read.
    """
    if seed.kind == "run":
        folder = None if seed.run is None else run_of_seed(seed.run, sequence)
        if folder is None or is_unfilled(folder):
            raise AnnotationError(
                f"the run of '{seed.method}' that the corrections of '{sequence.name}' started "
                "from was not saved: run the method again in the app and use that run there"
            )
        return truth_from_run(
            load_run_or_csv(folder, sequence=sequence, assembly=assembly), assembly
        )
    if seed.kind == "none":
        return {}
    truth = _truth_of(sequence)
    if not any(frame.T_camera_part for frame in truth.values()):
        raise AnnotationError(
            f"the corrections of '{sequence.name}' started from its own truth, which is no longer "
            "there: bring it back, or begin the corrections anew"
        )
    return truth


def run_of_seed(folder: str, sequence: Sequence) -> Path:
    """The folder of a run that corrections start from; in the scene's own runs if the scene was moved."""
    moved = Path(sequence.path) / RUNS / Path(folder).name
    return moved if not Path(folder).exists() and moved.exists() else Path(folder)


def truth_from_run(run: Run, assembly: Assembly) -> dict[int, FrameTruth]:
    """Take a run's poses and most probable states as if they were true, to be corrected.

    A part that it did not find may be there all the same, so it is unchecked.

    Raises:
        AnnotationError: the run has another number of states than the assembly.
    """
    found: dict[int, FrameTruth] = {}
    for prediction in run.predictions:
        index = prediction.frame_index
        poses = {name: pose.T_camera_part for name, pose in prediction.poses.items()}
        label = None
        if prediction.state is not None:
            if len(prediction.state.probabilities) != len(assembly.states):
                raise AnnotationError(
                    f"run of '{run.method}', frame {index}: it knows "
                    f"{len(prediction.state.probabilities)} states, {assembly.name} has "
                    f"{len(assembly.states)}"
                )
            label = label_of(assembly.states[prediction.state.index])
        missed = tuple(name for name in assembly.parts if name not in poses)
        found[index] = _with_label(
            FrameTruth(index, poses, None, unchecked=missed), label, assembly
        )
    return found


def _corrected_frame(
    base: FrameTruth,
    edits: Mapping[str, PoseAnnotation],
    label: StateLabel | None,
    assembly: Assembly,
    shares: KeptShares,
) -> FrameTruth:
    poses: dict[str, Transform] = dict(base.T_camera_part)
    for part, edit in edits.items():
        poses.pop(part, None)
        if edit.T_camera_part is not None:
            poses[part] = edit.T_camera_part
    in_order = {name: poses[name] for name in (*assembly.parts, *poses) if name in poses}
    frame = replace(
        base,
        T_camera_part=in_order,
        visible=shares.of(base, in_order),
        lists_parts=base.lists_parts or bool(edits),  # what was taken away is known not to be there
        unchecked=tuple(name for name in _unchecked_of(base, assembly) if name not in edits),
    )
    return _with_label(frame, label, assembly)


def _unchecked_of(base: FrameTruth, assembly: Assembly) -> tuple[str, ...]:
    """Nothing and a state alone say of no part that it is not there."""
    if base.T_camera_part or base.lists_parts:
        return base.unchecked
    return tuple(assembly.parts)


def _with_label(frame: FrameTruth, label: StateLabel | None, assembly: Assembly) -> FrameTruth:
    if label is None:
        return frame
    attached = label.attached
    if attached is None and not label.is_error:
        attached = assembly.states[label.state].attached
    return replace(
        frame,
        state=label.state,
        is_error=label.is_error,
        attached=attached,
        error=label.name if label.is_error else None,
    )


def _poses_by_frame(
    store: AnnotationStore, assembly: Assembly
) -> dict[int, dict[str, PoseAnnotation]]:
    found: dict[int, dict[str, PoseAnnotation]] = {}
    for (frame, part), annotation in store.poses().items():
        if part not in assembly.parts:
            raise AnnotationError(
                f"annotation {store.path}, frame {frame}: part '{part}' is not in "
                f"{assembly.name}; parts: {', '.join(assembly.parts)}"
            )
        found.setdefault(frame, {})[part] = annotation
    return found


def labels_by_frame(
    ranges: Iterable[tuple[int, int, StateLabel | None]],
    known: frozenset[int] | None,
    assembly: Assembly,
) -> dict[int, StateLabel]:
    """The states that were set, by frame number.

    Args:
        ranges: as `AnnotationStore.state_ranges` has them.
        known: numbers of the frames there are; without them every number in a range is one.
        assembly: the states that may occur.

    Raises:
        AnnotationError: another one was set.
    """
    labels: dict[int, StateLabel] = {}
    for first, last, label in ranges:
        if label is not None and not 0 <= label.state < len(assembly.steps):
            raise AnnotationError(
                f"annotation, frames {first} to {last}: state {label.state} is not in "
                f"{assembly.name}, which has the correct states 0 to {len(assembly.steps) - 1}"
            )
        inside = range(first, last + 1)
        for frame in inside if known is None else (f for f in known if f in inside):
            if label is None:
                labels.pop(frame, None)
            else:
                labels[frame] = label
    return labels


def _truth_of(sequence: Sequence) -> dict[int, FrameTruth]:
    found = (sequence.truth(place) for place in range(len(sequence)))
    return {frame.frame_index: frame for frame in found if frame is not None}


def known_assembly(assembly: Assembly | None) -> Assembly:
    """The assembly; raises an AnnotationError where nobody named one."""
    if assembly is None:
        raise AnnotationError("the assembly of the corrections is not known: name it")
    return assembly
