"""The frames of an export: those whose images cannot be read are left out, and told."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as Places

from asdfviz.datatypes import Frame, Sequence
from asdfviz.errors import SequenceError, counted, some

_MOST = 10
"""So many frames are told by number."""


def readable_frames(
    source: Sequence,
    places: Places[int],
    left_out: dict[int, str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Frame]:
    """Yield the frames at the places, and note in `left_out` why others could not be read.

    Raises:
        SequenceError: there is none that can be read.
    """
    for done, place in enumerate(places):
        try:
            frame = source[place]
        except SequenceError as error:
            left_out[source.frame_indices[place]] = str(error)
        else:
            yield frame
        if progress is not None:
            progress(done + 1, len(places))
    if len(left_out) == len(places):
        why = next(iter(left_out.values()))
        raise SequenceError(f"no frame of {source.name} can be read, so nothing is exported: {why}")


def told_left_out(left_out: Mapping[int, str]) -> str:
    """Say which frames an export lacks, and why the first of them."""
    why = next(iter(left_out.values()))
    return (
        f"{counted(len(left_out), 'frame')} left out with images that cannot be read: "
        f"{some(left_out, most=_MOST)} ({why})"
    )
