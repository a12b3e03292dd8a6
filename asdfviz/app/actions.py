"""What a person can ask for: one frozen dataclass an action. Callbacks make them, the session eats them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from asdfviz.app.job_actions import (
    AskOptions,
    Evaluate,
    Export,
    FitPart,
    RunMethod,
    StopRun,
    StopTracking,
    TrackPart,
)
from asdfviz.app.label_actions import (
    ClearState,
    MarkRange,
    NextError,
    NextState,
    RepeatState,
    SetRange,
    SetState,
)
from asdfviz.app.page_actions import Gizmo, Resume, Switch, Tab
from asdfviz.app.pose_actions import Hold, MovePart, PlaceJoined, PlacePart, ToGap, TypePose

Axis = Literal[0, 1, 2]
Sign = Literal[-1, 1]
GIZMOS: tuple[Gizmo, ...] = ("move", "turn", "off")
TABS: tuple[Tab, ...] = ("sequence", "methods", "annotate", "results")


@dataclass(frozen=True, slots=True)
class Seek:
    """Go to a frame's place."""

    place: int
    part: str | None = None
    """Select this part there as well, whichever tab is shown, and show the truth's outlines."""


@dataclass(frozen=True, slots=True)
class Step:
    """Go on by some frames."""

    by: int


@dataclass(frozen=True, slots=True)
class ToBoundary:
    """Go to the next (1) or previous (-1) state boundary."""

    direction: int


@dataclass(frozen=True, slots=True)
class TogglePlay:
    """Play or pause."""


@dataclass(frozen=True, slots=True)
class SetSpeed:
    """Play at a multiple of the sequence's rate."""

    speed: float


@dataclass(frozen=True, slots=True)
class ToggleView:
    """Change between AR and 3D."""


@dataclass(frozen=True, slots=True)
class Zoom:
    """Magnify about a place of the window (-1 to 1, right and down)."""

    factor: float
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True, slots=True)
class FitView:
    """Show the whole picture again, or the whole scene in 3D."""


@dataclass(frozen=True, slots=True)
class Look:
    """The viewer turned by hand; `u`, `v` is the pixel now in the middle."""

    u: float
    v: float


@dataclass(frozen=True, slots=True)
class SetOpacity:
    """How solid meshes are, 0 to 1."""

    opacity: float


@dataclass(frozen=True, slots=True)
class Toggle:
    """Switch a part of the picture on or off."""

    what: Switch


@dataclass(frozen=True, slots=True)
class SetGizmo:
    """Arrows to move, arcs to turn, or nothing to drag."""

    gizmo: Gizmo


@dataclass(frozen=True, slots=True)
class CycleGizmo:
    """Move, turn, off."""


@dataclass(frozen=True, slots=True)
class TogglePart:
    """Show or hide one part."""

    part: str


@dataclass(frozen=True, slots=True)
class ToggleLayer:
    """Show or hide the outlines of a run, or of the truth."""

    layer: str


@dataclass(frozen=True, slots=True)
class ToggleLayerAt:
    """The same, by its number in the list (from 1)."""

    number: int


@dataclass(frozen=True, slots=True)
class UseRun:
    """Take this run's poses as those that corrections start from."""

    run: str


@dataclass(frozen=True, slots=True)
class SelectPart:
    """Select a part, or nothing."""

    part: str | None


@dataclass(frozen=True, slots=True)
class NextPart:
    """Select the next (1) or previous (-1) part."""

    by: int


@dataclass(frozen=True, slots=True)
class Nudge:
    """Move the selected part by one step along a camera axis."""

    axis: Axis
    sign: Sign


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn the selected part by one step about a camera axis through its middle."""

    axis: Axis
    sign: Sign


@dataclass(frozen=True, slots=True)
class CycleStep:
    """Fine, normal, coarse, large steps."""


@dataclass(frozen=True, slots=True)
class CopyPrevious:
    """Give the selected part its pose in the frame before, or in the next one that has it."""


@dataclass(frozen=True, slots=True)
class RevertPart:
    """Drop the selected part's corrections in the frame or the marked range."""


@dataclass(frozen=True, slots=True)
class RemovePart:
    """Say that the selected part is not in the frame or the marked range."""


@dataclass(frozen=True, slots=True)
class VerifyPart:
    """Say that the selected part's pose in the frame or the marked range was looked at and is right.

    Where that is said already it is taken back.
    """


@dataclass(frozen=True, slots=True)
class Cancel:
    """Close a card, drop the range, then the selection."""


@dataclass(frozen=True, slots=True)
class Undo:
    """Take the last edit back."""


@dataclass(frozen=True, slots=True)
class Redo:
    """Do the edit again."""


@dataclass(frozen=True, slots=True)
class ShowTab:
    """Show a tab of the panel."""

    tab: Tab


@dataclass(frozen=True, slots=True)
class ToggleKeys:
    """Show or hide the sheet of keys."""


@dataclass(frozen=True, slots=True)
class DismissWelcome:
    """Close the first visit's card for good."""


@dataclass(frozen=True, slots=True)
class ByKey:
    """What a key or the palette asks for, which a card that is open keeps off."""

    action: Action


@dataclass(frozen=True, slots=True)
class Resized:
    """The window has another shape."""

    aspect: float


@dataclass(frozen=True, slots=True)
class Drifted:
    """The pinned camera is not where AR needs it."""


@dataclass(frozen=True, slots=True)
class Changed:
    """Runs, corrections or a background job changed, here or in another tab."""


Action: TypeAlias = (
    Seek | Hold | Resume | Step | ToBoundary | ToGap | TogglePlay | SetSpeed | ToggleView | Zoom | FitView | Look | SetOpacity
    | Toggle | SetGizmo | CycleGizmo | TogglePart | ToggleLayer | ToggleLayerAt | UseRun | SelectPart | NextPart | Nudge | Turn
    | CycleStep | MovePart | TypePose | CopyPrevious | PlacePart | PlaceJoined | RevertPart | RemovePart | VerifyPart | Cancel
    | SetState | NextState | NextError | RepeatState | ClearState | SetRange | MarkRange
    | Undo | Redo | ShowTab | AskOptions | RunMethod | StopRun | Evaluate | Export | TrackPart | FitPart | StopTracking | ToggleKeys | DismissWelcome
    | ByKey | Resized | Drifted | Changed
)  # fmt: skip
