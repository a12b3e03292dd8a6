"""Which poses an export lacks, which nobody would find out from its files: no pose reads as "not there"."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping

from asdfviz.datatypes import FrameTruth
from asdfviz.errors import some

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
    counts = Counter(
        part
        for frame in frames
        for part in lacking(
            frame, truth[frame].T_camera_part if frame in truth else (), parts, gone=gone
        )
    )
    told = [
        f"{part} in {counts[part]} of {len(frames)} frames"
        if counts[part] < len(frames)
        else f"{part} in all frames"
        for part in parts
        if part in counts
    ]
    return f"without a pose, so exported as not there: {some(told, most=_MOST)}" if told else ""
