"""What a person can ask of poses: dragged, typed, placed, by the state; and where one is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from asdfviz.geometry.shapes import Transform


@dataclass(frozen=True, slots=True, eq=False)
class MovePart:
    """A part was dragged to a pose; only the last of a drag is kept as an edit."""

    part: str
    T_camera_part: Transform
    place: int
    """Of the frame in which the drag was begun."""
    done: bool


@dataclass(frozen=True, slots=True)
class Hold:
    """Stop playing, at a frame's place: somebody begins to type there, or did."""

    place: int


@dataclass(frozen=True, slots=True)
class TypePose:
    """Figures of a part's pose were typed."""

    part: str
    place: int
    """Of the frame whose pose they stood in."""
    options: Mapping[str, str]
    """What was changed, as it was typed, by the names in `typed_pose.FIGURES`."""


@dataclass(frozen=True, slots=True)
class PlacePart:
    """Put the selected part into the frame: where a pixel says, else where the state joins it, else
    in the middle of the view.
    """

    u: float | None = None
    v: float | None = None


@dataclass(frozen=True, slots=True)
class PlaceJoined:
    """Put every joined part without a pose where the state has it, in the frame or the marked range."""


@dataclass(frozen=True, slots=True)
class ToGap:
    """Go to the next (1) or previous (-1) frame in which the selected part, or any, has no pose."""

    direction: int
