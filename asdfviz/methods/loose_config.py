"""Options of `loose_parts`."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.errors import MethodError


@dataclass(frozen=True)
class LooseConfig:
    """When a small part counts as joined, and when as loose."""

    enabled: bool = True
    """On or off."""
    small_px: float = 10.0
    """A part that is gone counts as joined only if it is thinner in the picture than this where it would
    be, or the others leave less than the square of it to be seen there, pixels: of those that show more
    that place tells more."""
    blurred_px: float = 20.0
    """The same before a camera that moves, whose pictures are blurred; there only what lies still is
    loose (`AtRest`): what is small is found now here, now there."""
    found: float = 0.5
    """Score from which a part is found,"""
    likely: float = 0.3
    """from which one that is not may all the same be what lies where it lay,"""
    sure: float = 0.8
    """and from which it surely is where its pose has it."""
    away: float = 0.015
    """A part is loose if it is farther than this from where any state has it, and lies where it lay if
    it is nearer to that than this, metres."""
    enough: int = 10
    """Frames in which it must have been found, or have lain in one place, before it says anything."""
    wait: int = 10
    """Frames for which it may be gone in a hand at least,"""
    shortest: float = 0.5
    """or such a share of them, if no more of its way was left when it was last seen,"""
    carried: float = 0.5
    """and for so much of the time of a step, as the sequence itself tells it, if it was taken from where
    it lay: what was last seen on its way has only the rest of that before it."""
    gain: float = 0.5
    """Log odds of being joined for each frame more,"""
    most: float = 4.0
    """but no more than this."""
    most_shown: float = 2.0
    """Of a part that shows more where it is joined no more than this, and only where who brought it was seen
    to leave."""
    there: float = 2.0
    """Log odds of being loose where it lies where it lay."""
    far: float = 0.08
    """A part that is farther than this from any place, metres, in `steady` frames more than it is not,"""
    far_sure: float = 0.8
    """by poses that score so much,"""
    seen_far: float = 4.0
    """is loose with these log odds, also if a state had it joined already: it was taken out again, or never
    was in."""
    in_front: float = 0.015
    """What is nearer than where it lay by this hides it, metres: then it is not gone,"""
    empty: int = 5
    """unless it was seen to be gone in so many frames before."""
    about: float = 0.06
    """Something comes to a place where a part is joined if depth shows it about there, so much farther than
    half the part's size, metres,"""
    nearer: float = 0.012
    """nearer to the camera than what was there by more than this, metres,"""
    came: float = 0.08
    """in this share of what is looked at, 0 to 1,"""
    again: int = 2
    """in so many frames one after another."""
    steady: int = 3
    """A part that surely lies loose in so many frames one after another is not joined: from then on
    something has to come there,"""
    busy: float = 0.4
    """where a frame in which who came is still there counts as so much of one, 0 to 1,"""
    speed: float = 0.75
    """not sooner than a hand brings it, metres a second."""
    close: float = 0.13
    """A part that is seen on its way nearer to its place than this has come there itself, metres."""
    within: float = 0.18
    """Who brings a part there is no farther before it than this, metres; what is only passes,"""
    rest: float = 0.25
    """and has left when no more is hidden of what was hidden most, 0 to 1:"""
    left: float = 3.0
    """without the part, so that each frame since then counts as so many since it was gone."""
    untouched: float = 1.0
    """Log odds of not being joined as long as nothing did,"""
    patience: int = 60
    """in so many frames at most: it may not have been seen to come."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        for option in ("enough", "wait", "empty", "steady", "patience", "again"):
            if getattr(self, option) < 1:
                raise MethodError(f"loose.{option} is {getattr(self, option)}, use 1 or more")
        for option in (
            "gain",
            "most",
            "there",
            "carried",
            "small_px",
            "blurred_px",
            "untouched",
            "shortest",
            "rest",
            "left",
            "most_shown",
            "busy",
            "seen_far",
            "far",
            "far_sure",
            "likely",
        ):
            if not getattr(self, option) >= 0:
                raise MethodError(f"loose.{option} is {getattr(self, option):g}, use 0 or more")
        for option in ("about", "nearer", "came", "speed", "close", "within"):
            if not getattr(self, option) > 0:
                raise MethodError(f"loose.{option} is {getattr(self, option):g}, use more than 0")
