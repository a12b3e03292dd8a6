"""Which poses an export lacks, which nobody would find out from its files: no pose reads as "not there"."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from asdfviz.datatypes import FrameTruth
from asdfviz.errors import some

_MOST = 5
"""So many parts are told by name."""


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
    known = {i: set(truth[i].T_camera_part) if i in truth else set[str]() for i in frames}
    lacking = {
        part: sum(part not in here and (i, part) not in gone for i, here in known.items())
        for part in parts
    }
    told = [
        f"{part} in {count} of {len(known)} frames"
        if count < len(known)
        else f"{part} in all frames"
        for part, count in lacking.items()
        if count
    ]
    return f"without a pose, so exported as not there: {some(told, most=_MOST)}" if told else ""
