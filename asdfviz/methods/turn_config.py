"""Options of how it is told over time that a part is turned otherwise."""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.errors import MethodError
from asdfviz.methods.drawn_looks import DrawnConfig
from asdfviz.methods.turn_table import TurnTableConfig


@dataclass(frozen=True)
class TurnConfig:
    """When a part is believed to be turned otherwise."""

    enabled: bool = True
    """On or off."""
    a_frame: int = 4
    """Parts that are checked in a frame, one turn of each;"""
    at_first: int = 3
    """of a pose that is new so many, until each was tried once."""
    near: float = 0.0
    """Until then one is tried again each time that is no farther behind than this by what is seen."""
    visible: float = 0.5
    """Share of the part that must be seen, 0 to 1."""
    believed: float = 0.3
    """Share of the pose's confidence, by contours and depth, that another turn must have, 0 to 1."""
    lead: float = 0.35
    """A turn is right, or ruled out, that is ahead or behind by this in all, the crop network's liking
    among it,"""
    lead_seen: float = 0.35
    """or right if it is ahead by this by what is seen alone,"""
    disliked: float = 0.5
    """and by this share more of what the crop network's liking counts against it, 0 to 1;"""
    step: float = 0.12
    """no frame counts for more than this for it: a single one may deceive."""
    slack: float = 0.02
    """Taken from what every frame says for it: frames deceive alike as long as nothing moves."""
    remembered: int = 6
    """Turns that a part was in and that were wrong."""
    again: int = 12
    """Frames after which one that was ruled out is tried again, and those in which the part was."""
    known: int = 6
    """Frames for which it is kept what was found of a pose, while others say that the part is turned."""
    was: float = 0.0
    """With this lead the turn begins that a part had where it is found anew: above 0 it is tried first."""
    held: int = 6
    """if it had it for so many frames."""
    same_deg: float = 20.0
    """Poses turned less than this against each other are one."""
    table: TurnTableConfig = field(default_factory=TurnTableConfig)
    """What the table says, besides."""
    drawn: DrawnConfig = field(default_factory=DrawnConfig)
    """By what turns are compared: how they would look."""
    liked: float = 0.1
    """Weight of the crop network's preference for a turn, 0 to 1, where all of the part is seen;
    `asdf_track` alone asks it. It errs alike in all frames,"""
    liked_most: float = 0.5
    """so in all it counts for this much, or against."""
    contested: float = 0.5
    """Share of the score that is left to a pose of which another turn is ahead by what was seen, 0 to 1;
    `asdf_plus` and `asdf_track` tell it;"""
    beaten: float = 0.1
    """and by `beaten_lead` or more, 0 to 1."""
    beaten_lead: float = 0.2
    """Of 375 such poses of twelve rendered sequences 301 were turned by more than 30 degrees, of those that
    were ahead by 0.2 122 of 123; of 8,012 others 267."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.a_frame, self.at_first) < 1 or not 0 < self.step <= self.lead:
            raise MethodError(
                f"turns.a_frame is {self.a_frame}, at_first {self.at_first}, step {self.step:g} and "
                f"lead {self.lead:g}: a_frame and at_first must be 1 or more, step above 0 and no more "
                "than lead"
            )
        if min(self.lead_seen, self.disliked, self.near, self.was, self.liked_most) < 0:
            raise MethodError(
                f"turns.lead_seen is {self.lead_seen:g}, disliked {self.disliked:g}, near {self.near:g}, "
                f"was {self.was:g} and liked_most {self.liked_most:g}: use 0 or more"
            )
        if not (0 <= self.beaten <= self.contested <= 1 and self.beaten_lead > 0):
            raise MethodError(
                f"turns.contested is {self.contested:g}, beaten {self.beaten:g} and beaten_lead "
                f"{self.beaten_lead:g}: contested must be from 0 to 1, beaten from 0 to that, beaten_lead "
                "above 0"
            )
