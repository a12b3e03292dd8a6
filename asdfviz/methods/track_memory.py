"""What a tracking method remembers of one part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_angle
from asdfviz.methods.place_support import PlaceSupport

FOUND = 1.0
"""Support of a place from which the detector is taken to have found the part there."""
YOUNG = 5
"""Frames in which a part must have been sure before its pose has a start on others."""

JUMP = 0.8
"""Nothing turns so far from one frame to the next (radians): it was taken for turned otherwise, and
would be turned back if that were carried on."""


@dataclass(slots=True, eq=False)
class Rival:
    """Another pose of a tracked part that fits about as well."""

    T_track_rival: Transform
    """From the tracked pose to it, in the part's own axes."""
    ahead: float
    """How much better it fitted in the last frame, none below 0; what is farther ahead takes its
    place."""
    lead: float = 0.0
    """How much better it fitted so far, summed over frames."""


@dataclass(slots=True, eq=False)
class Track:
    """What is remembered of one part."""

    T_now: Transform
    """Where it is taken to be: the last pose that the tracker was sure of, or where others have it since."""
    T_sure: Transform | None = None
    """The last pose that the tracker was sure of, if it ever was."""
    T_before: Transform | None = None
    """The one a frame earlier, if it was sure of both."""
    unsure: int = 0
    """Frames since it was sure."""
    missing: int = 0
    """Those of them in a row in which nothing hid it."""
    age: int = 0
    """Frames in which it was sure."""
    T_expected: Transform | None = None
    """Where it is in the new frame if it lies still, as others tell how the camera moved."""
    rival: Rival | None = None
    """The pose that is watched."""
    explore: bool = True
    """Whether other turns of a pose that is sure may be tried."""
    joined: bool = False
    """Whether the base held it in the last frame."""
    disowned: int = 0
    """By so many frames more the networks spoke against it than for it."""
    unlike: int = 0
    """Frames in which the state held it, depth agreed, and its colours alone did not."""
    support: PlaceSupport = field(default_factory=PlaceSupport)
    """What the detector says of its place."""

    @property
    def is_new(self) -> bool:
        """Whether it was sure too seldom yet to be believed."""
        return self.age < YOUNG

    @property
    def is_established(self) -> bool:
        """Whether it was sure often enough, where the detector had it, too."""
        return not self.is_new and self.support.own >= FOUND

    def take(self, T_found: Transform) -> None:
        """Take in a pose of which the tracker is sure; what was turned at once goes on in no direction."""
        turn = rotation_angle(self.T_now[:3, :3].T @ T_found[:3, :3])
        goes_on = self.age > 0 and not self.unsure and turn < JUMP
        self.T_before = self.T_now if goes_on else None
        self.T_now, self.T_sure, self.age = T_found, T_found, self.age + 1
        self.unsure = self.missing = 0


def with_turned_axes(track: Track, T_part_turned: Transform) -> Track:
    """The same of a part whose axes are others that look the same: T_part_turned are these, seen from it."""

    def turned(T: Transform | None) -> Transform | None:
        return None if T is None else T @ T_part_turned

    before, sure = turned(track.T_before), turned(track.T_sure)
    now = track.T_now @ T_part_turned
    return replace(track, T_now=now, T_before=before, T_sure=sure, rival=None)


def surely_placed(tracks: Mapping[str, Track]) -> tuple[str, ...]:
    """Parts that are established and fitted the picture in the last frame."""
    return tuple(n for n, track in tracks.items() if track.is_established and not track.unsure)
