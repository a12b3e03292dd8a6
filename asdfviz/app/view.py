"""One person's view of the workspace, and the facts that its rules depend on. Data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from asdfviz.app import actions as act
from asdfviz.app.ar import Window, rest_centre
from asdfviz.app.page_actions import Mode
from asdfviz.geometry.shapes import Intrinsics

STEPS_MM = (0.2, 1.0, 5.0, 20.0)
"""Fine, normal, coarse, large: of a nudge in millimetres,"""
STEPS_DEG = (0.2, 1.0, 5.0, 45.0)
"""and of a turn in degrees: a part that was just placed may lie on another side."""
STEP_NAMES = ("fine", "normal", "coarse", "large")
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0)
TRUTH = "truth"
"""Name of the truth's layer; runs' layers bear their ids."""


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """What of the workspace the view's rules depend on."""

    count: int
    """Frames."""
    parts: tuple[str, ...]
    boundaries: tuple[int, ...]
    """First frames of every segment of the timeline."""
    runs: tuple[str, ...]
    """Ids, in the order of the list."""
    preferred: str | None
    """The run to draw first."""
    has_truth: bool
    is_corrected: bool
    """Whether anybody corrected anything: what is drawn then stays."""
    K: Intrinsics
    size_wh: tuple[int, int]

    @property
    def layers(self) -> tuple[str, ...]:
        """What a number key may show or hide, in order."""
        return (*self.runs, TRUTH) if self.has_truth else self.runs


@dataclass(frozen=True, slots=True)
class View:
    """One person's view."""

    page: str = ""
    """Tells the browser tab from others; undo takes back what was done in it."""
    place: int = 0
    """Of the frame shown, 0 to count - 1."""
    playing: bool = False
    speed: float = 1.0
    mode: Mode = "ar"
    zoom: float = 1.0
    centre: tuple[float, float] | None = None
    """Pixel in the middle of the AR view; None for straight ahead."""
    turns: int = 0
    """Counts up whenever the camera has to be placed anew."""
    aspect: float = 1.6
    opacity: float = 0.65
    overlay: bool = True
    xray: bool = False
    boxes: bool = False
    keypoints: bool = False
    gizmo: act.Gizmo = "move"
    hidden: frozenset[str] = frozenset()
    """Parts that are not drawn."""
    layers: frozenset[str] = frozenset()
    """Runs (or the truth) whose outlines are drawn as well."""
    base: str | None = None
    """The run (or the truth) whose poses are shown where nothing was corrected."""
    chosen: bool = False
    """Whether a person chose the base, or a part as it lies there."""
    selected: str | None = None
    step: int = 1
    marked: tuple[int, int] | None = None
    """Places that a state is set for while one of them is shown, first to last."""
    marking: int | None = None
    """Where a range was begun by key."""
    served: bool = False
    """Whether the keys go through states for the marked range, which ends with the next frame."""
    labelled: tuple[int, int] | None = None
    """The marked range that a state was just set for, until another frame is shown."""
    state: int | None = None
    """The state (an index of the assembly) that was set last."""
    tab: act.Tab = "sequence"
    keys: bool = False
    welcome: bool = False
    together: bool = False
    """Whether parts that are joined move as one."""
    asking: str | None = None
    """The method whose options are shown."""
    options: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    """What was changed of methods' options, by method and dotted name."""

    @property
    def range_here(self) -> tuple[int, int] | None:
        """The marked range while the frame shown is in it: elsewhere nobody thinks of it."""
        inside = self.marked is not None and self.marked[0] <= self.place <= self.marked[1]
        return self.marked if inside else None

    @property
    def joined(self) -> tuple[int, int]:
        """First and last place in which joined parts would be placed."""
        return self.range_here or self.labelled or (self.place, self.place)

    @property
    def frames(self) -> tuple[int, int]:
        """First and last place that a state would be set for."""
        return self.range_here or (self.place, self.place)


def window_of(view: View, facts: Facts) -> Window:
    """The window that the view is seen in."""
    return Window(facts.K, facts.size_wh, view.aspect)


def centre_of(view: View, facts: Facts) -> tuple[float, float]:
    """The pixel in the middle of the AR view."""
    return view.centre or rest_centre(facts.K)
