"""Which poses an export lacks, which nobody would find out from its files: where there are some, no pose
reads as "not there" unless the part is unchecked, and a frame without any is passed over.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from asdfviz.datatypes import FrameTruth
from asdfviz.errors import counted, some

_MOST = 5
"""So many parts are told by name."""


def lacking(
    frame: int,
    posed: Collection[str],
    parts: Iterable[str],
    *,
    gone: Collection[tuple[int, str]],
) -> list[str]:
    """The parts without a pose in a frame, but for those that a person said are not there."""
    return [part for part in parts if part not in posed and (frame, part) not in gone]


def says_what_is_there(
    frame: FrameTruth, parts: Iterable[str], gone: Collection[tuple[int, str]]
) -> bool:
    """Whether a frame's truth tells parts that are there from parts that are not: poses do, a list without
    any does, and so does a person who said of every part that it is gone, but not a state alone.
    """
    if frame.T_camera_part or frame.lists_parts or frame.state is None:
        return True
    return not lacking(frame.frame_index, (), parts, gone=gone)


def unchecked_frames(
    truth: Mapping[int, FrameTruth],
    frames: Iterable[int],
    parts: Collection[str],
    gone: Collection[tuple[int, str]],
) -> list[int]:
    """The frames that tell which parts are there, but not of all."""
    return [
        i
        for i in frames
        if i in truth and truth[i].unchecked and says_what_is_there(truth[i], parts, gone)
    ]


def told_gaps(
    truth: Mapping[int, FrameTruth],
    frames: Collection[int],
    parts: Collection[str],
    *,
    gone: Collection[tuple[int, str]] = (),
) -> str:
    """Say of which parts there is no pose in how many frames; empty where nobody misses one.

    Args:
        truth: what is exported, by frame number.
        frames: numbers of all frames.
        parts: names of the assembly's parts.
        gone: frame numbers and parts that a person said are not there.
    """
    said = [i for i in frames if i in truth and says_what_is_there(truth[i], parts, gone)]
    missed = [
        (part, truth[i])
        for i in said
        for part in lacking(i, truth[i].T_camera_part, parts, gone=gone)
    ]
    unchecked = Counter(part for part, frame in missed if part in frame.unchecked)
    absent = Counter(part for part, frame in missed if part not in frame.unchecked)
    notes: list[str] = []
    if without := len(frames) - len(said):
        notes.append(f"no pose, and so no truth, in {without} of {counted(len(frames), 'frame')}")
    kinds = (
        ("and not taken away, so exported as unchecked", unchecked),
        ("so exported as not there", absent),
    )
    for how, counts in kinds:
        told = [f"{p} in {counts[p]} of {counted(len(said), 'frame')}" for p in counts]
        if told:
            notes.append(f"without a pose, {how}: {some(told, most=_MOST)}")
    return "; ".join(notes)


def told_label_gaps(
    truth: Mapping[int, FrameTruth],
    frames: Collection[int],
    parts: Collection[str],
    *,
    gone: Collection[tuple[int, str]] = (),
    unchecked: bool = False,
) -> str:
    """As `told_gaps`, of labels for training, which cannot say that a part is unchecked; see `export_yolo`."""
    left_out = [] if unchecked else unchecked_frames(truth, frames, parts, gone)
    whole = {i: replace(known, unchecked=()) for i, known in truth.items() if i not in left_out}
    names = [part for part in parts if any(part in truth[i].unchecked for i in left_out)]
    notes = [told_gaps(whole, [i for i in frames if i not in left_out], parts, gone=gone)]
    if left_out:
        notes.insert(
            0,
            f"{counted(len(left_out), 'frame')} left out in which nobody said of "
            f"{some(names, most=_MOST)} whether it is there (--unchecked: it is not)",
        )
    return "; ".join(note for note in notes if note)
