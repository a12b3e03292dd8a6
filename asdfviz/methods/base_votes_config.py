"""Options of where the base is told to be."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.errors import MethodError


@dataclass(frozen=True)
class BaseVotesConfig:
    """When the base is not where its own pose says."""

    enabled: bool = True
    """On or off."""
    known_turns: bool = True
    """Whether a pose of its own is told turned otherwise, where its turn was found wrong before."""
    leap: float = 0.003
    """Probability that it is elsewhere in the next frame though depth does not say so,"""
    apart: float = 0.035
    """which is farther away than this, metres,"""
    turned_deg: float = 30.0
    """or turned by more than this, degrees."""
    gone: float = 0.35
    """when it does: so much of its surface would be seen through,"""
    see_through: float = 0.012
    """by more than this, metres,"""
    leap_gone: float = 0.1
    """and then."""
    shared: float = 0.2
    """How probable its pose is, of what its score says, where a surer part is in the same place."""
    least: float = 0.2
    """Less probable states tell no places of the base."""
    fit: float = 5.0
    """Log odds for a pose whose surface agrees with all of the depth readings, among those near the
    likeliest,"""
    margin: float = 0.008
    """which agree when they are this near, metres."""
    stays: float = 1.0
    """Log odds for it being where it was, among the places near that, where all of it is hidden there."""
    visible: float = 0.15
    """Where it was, at least this much of its surface is not hidden by something nearer, and it is not
    gone, or other parts back it; else it is absent."""
    support: float = 1.0
    """Log odds for the state and against nothing being joined with which the others must back the part
    that says where the base is."""
    lead: float = 1.0
    """Log odds by which it must be likelier elsewhere to be put there."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        for option in ("leap", "leap_gone", "shared"):
            value = getattr(self, option)
            if not 0 < value <= 1:
                raise MethodError(
                    f"base_votes.{option} is {value:g}: use a probability above 0, at most 1"
                )
        if not (self.stays >= 0 and self.visible > 0):
            raise MethodError(
                f"base_votes.stays is {self.stays:g} and visible {self.visible:g}: "
                "stays must be 0 or more, visible above 0"
            )
