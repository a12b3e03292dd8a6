"""Which frames a run has in common with what it is shown on or judged by."""

from __future__ import annotations

from collections.abc import Iterable

from asdfviz.datatypes import Run
from asdfviz.errors import RunError


def shared_frames(run: Run, frames: Iterable[int], *, source: object, other: object) -> list[int]:
    """Return the frame numbers that a run holds as well, in the order in which they are given.

    Args:
        run: what a method said.
        frames: of a sequence or of its truth.
        source: the run's folder or file, for the message.
        other: what the frames are of, likewise.

    Raises:
        RunError: there are none.
    """
    held = {prediction.frame_index for prediction in run.predictions}
    numbers = list(frames)
    shared = [index for index in numbers if index in held]
    if not shared:
        raise RunError(
            f"{source} holds {_span(held)}, {other} {_span(numbers)}: they share none, so the run is "
            f"of another sequence, or of other frames (it was made on {run.sequence})"
        )
    return shared


def _span(frames: Iterable[int]) -> str:
    known = sorted(frames)
    if not known:
        return "no frames"
    first, last = known[0], known[-1]
    return f"frame {first}" if first == last else f"frames {first} to {last}"
