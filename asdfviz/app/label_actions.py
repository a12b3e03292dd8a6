"""What a person can say of the state of frames, and of which frames: one of them or a marked range."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SetState:
    """Set the state (an index of the assembly, errors included) of the frame or the marked range."""

    state: int


@dataclass(frozen=True, slots=True)
class NextState:
    """Set the state that comes after (1) or before (-1) the one of the frame shown, for the same."""

    by: int


@dataclass(frozen=True, slots=True)
class NextError:
    """Set the first error that can follow the step of the frame shown, then the next one, for the same."""


@dataclass(frozen=True, slots=True)
class RepeatState:
    """Set the state that was last set here once more, for the frame or the marked range."""


@dataclass(frozen=True, slots=True)
class ClearState:
    """Take the state label of the frame or the marked range away."""


@dataclass(frozen=True, slots=True)
class SetRange:
    """Mark frames, first to last, and show one of them."""

    first: int
    last: int
    place: int | None = None
    """Show this one; the nearest to the frame shown where it is None."""


@dataclass(frozen=True, slots=True)
class MarkRange:
    """Begin a range at this frame, or end it here."""
