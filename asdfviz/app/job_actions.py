"""What a person can ask for that works in the background: methods, tracking, judging, exporting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Direction = Literal["back", "both", "forward"]


@dataclass(frozen=True, slots=True)
class AskOptions:
    """Show the options of a method before it is run."""

    method: str


@dataclass(frozen=True, slots=True)
class RunMethod:
    """Run a method on this sequence in the background."""

    method: str
    options: Mapping[str, str] | None = None
    """What differs from the method's defaults, as text, by dotted name; None for what was last chosen."""


@dataclass(frozen=True, slots=True)
class StopRun:
    """Stop the running method; what is done so far is kept."""


@dataclass(frozen=True, slots=True)
class Evaluate:
    """Judge every run against the truth, corrected where it was corrected."""


@dataclass(frozen=True, slots=True)
class Export:
    """Write poses and states as a BOP scene."""

    unchecked: bool = False
    """Also those of a run that nobody checked."""


@dataclass(frozen=True, slots=True)
class TrackPart:
    """Carry the selected part's pose from this frame to those before, those after, or both."""

    direction: Direction


@dataclass(frozen=True, slots=True)
class FitPart:
    """Settle the selected part in this frame by its contours and depth."""


@dataclass(frozen=True, slots=True)
class StopTracking:
    """Stop carrying or settling poses; nothing is changed then."""
