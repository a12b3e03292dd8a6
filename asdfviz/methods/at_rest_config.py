"""Options of what lies still (`AtRest`)."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.errors import MethodError


@dataclass(frozen=True)
class AtRestConfig:
    """When a part lies still, and how it is told then."""

    enabled: bool = True
    """On or off."""
    sure: float = 0.3
    """Poses that score less are not asked."""
    agree: float = 0.004
    """Corners that are off by this speak half as much for a motion of the camera, metres;"""
    unmoved: float = 0.93
    """it stands still where that is this much as probable as the best motion, 0 to 1,"""
    least: float = 0.005
    """or where that moves what rests by less than this in the median, metres: poses err by as much."""
    moved: float = 0.008
    """A part whose middle is farther than this from where it lay has moved, metres,"""
    turned: float = 0.011
    """or farther than this if it is turned otherwise: the middle is not where it turns,"""
    patience: int = 3
    """once it has in so many frames in a row."""
    same_deg: float = 12.0
    """Rotations that differ by less are one;"""
    fades: float = 0.98
    """what a frame said of them counts so much less with every frame more, 0 to 1."""
    enough: int = 6
    """Frames that must have found it there,"""
    share: float = 0.35
    """and this share of them as it is told, 0 to 1,"""
    lately: int = 8
    """one of the last so many, too: else it is turning in its place."""
    absent: int = 15
    """For so many frames one that is not found is expected where it lay."""
    otherwise_deg: float = 4.0
    """It is told otherwise than it was found where that turns it by this,"""
    otherwise: float = 0.003
    """or moves it by this, metres, and only within"""
    shaken: int = 10
    """so many frames after the camera has moved: before a camera that stands still poses are steady, and
    what turns one is a reason to do so."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        above = ("sure", "agree", "moved", "turned", "same_deg", "patience", "enough", "fades")
        zero_or_more = ("unmoved", "least", "share", "lately", "absent", "otherwise_deg")
        for name in (*above, *zero_or_more, "otherwise", "shaken"):
            value = getattr(self, name)
            if value < 0 or (name in above and value == 0):
                more = "more than 0" if name in above else "0 or more"
                raise MethodError(f"at_rest.{name} is {value:g}, use {more}")
        for name in ("unmoved", "share", "fades"):
            if getattr(self, name) > 1:
                raise MethodError(f"at_rest.{name} is {getattr(self, name):g}, use 1 or less")
