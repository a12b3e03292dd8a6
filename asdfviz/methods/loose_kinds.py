"""What is noted of the loose parts of one kind: the nouns of `loose_parts`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.methods.approaches import Approaches
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.state.joined_spots import JoinedSpots
from asdfviz.state.twins import loose_in_states


@dataclass(slots=True, eq=False)
class Spot:
    """Where a part of some kind was found loose."""

    middle: Vector
    """In the frame of what lies still, metres."""
    frames: int = 0
    """In which one was there."""
    is_seen: bool = False
    """In the last frame."""
    last: int = 0
    """The last of them, by number."""
    empty: int = 0
    """In how many frames since it was seen to be gone from there."""


@dataclass(slots=True, eq=False)
class Kind:
    """The twins of one part, or a part that has none."""

    names: tuple[str, ...]
    loose: tuple[int, ...]
    """How many of them are loose in each state."""
    places: tuple[Transform, ...]
    """T_base_part of all of them in all states."""
    approaches: Approaches
    """Of anything to those."""
    found: list[int]
    """In how many frames one or more, two or more, ... were found loose,"""
    gone: list[int]
    """for how many they have not been since,"""
    last: list[int]
    """in which they were last, by number,"""
    left: list[float]
    """and what share of the way to a place what is missing since then had left."""
    frames_far: list[int]
    """In how many frames one or more, two or more, ... surely were far from any place, less those in which
    they were not."""
    ways: list[float] = field(default_factory=list[float])
    """Of those that were found loose in the last frame, how far they were from any place, metres,"""
    far: float = 0.0
    """and how far one ever was."""
    spots: list[Spot] = field(default_factory=list[Spot])

    seen_far: int = 0
    """How many of them surely are far from any place in the last frame."""

    def see_far(self, count: int) -> None:
        """Take in how many of them surely are far from any place in a frame."""
        self.seen_far = count
        self.frames_far = [
            frames + 1 if count > k else max(frames - 1, 0)
            for k, frames in enumerate(self.frames_far)
        ]

    def far_for(self, frames: int) -> int:
        """How many of them are there now, and have been in so many frames."""
        return sum(self.frames_far[k] >= frames for k in range(self.seen_far))

    def resting(self, frames: int, likely: Sequence[Vector], *, within: float) -> int:
        """How many lie where one lay for so many frames, surely or not.

        Args:
            frames: which make a spot.
            likely: middles of those that are not surely found, the spots' frame, metres.
            within: so near to a spot they lie there, metres.
        """
        return sum(
            spot.frames >= frames
            and (spot.is_seen or any(np.linalg.norm(spot.middle - at) <= within for at in likely))
            for spot in self.spots
        )

    def lie_nowhere_else(self, frames: int) -> None:
        """All of them are found: where none is now, none is hidden either, as if seen for so many frames."""
        for spot in self.spots:
            if not spot.is_seen:
                spot.empty = max(spot.empty, frames)


def kind_of(
    assembly: Assembly, names: tuple[str, ...], spots: JoinedSpots, *, config: LooseConfig
) -> Kind:
    """Nothing is known yet of the twins that have these names."""
    return Kind(
        names=names,
        loose=loose_in_states(assembly, names),
        places=tuple(T for name in names for T in spots.places.get(name, ())),
        approaches=Approaches(assembly, names, config=config),
        found=[0] * len(names),
        gone=[0] * len(names),
        last=[0] * len(names),
        left=[1.0] * len(names),
        frames_far=[0] * len(names),
    )
