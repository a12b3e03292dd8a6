"""Of two like parts the one that looks quite unlike the other is another thing of their shape.

Not in the paper. A detector knows a screw by its shape and takes one that lies there by chance, pale where
the assembly's are black, or green where they are grey. Once one of them is surely found, its colour tells:
the light differs from place to place, but hardly by a factor of two, and less in tint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.methods.seen_colors import SeenSurface, log_colors, tint
from asdfviz.state.twins import renamed, twin_groups

Apart: TypeAlias = Callable[[Vector, Vector], float]
"""How far two colours differ."""

MOST = 10
"""A mean is over about so many frames."""
FORGOTTEN = 300
"""What was not seen for so many frames lies there no more."""
SAME_PLACE = 0.015
"""What is found this near to where it was lies still, metres."""


@dataclass(frozen=True)
class UnlikeTwinsConfig:
    """How unlike is too unlike; logarithms of brightness."""

    enabled: bool = True
    """On or off."""
    unlike: float = 0.6
    """A part that differs more from one like it, of which the tracker is sure, is another thing: in three
    rendered sequences twins differed by 0.45 at most, and by 0.8 from a bolt taken for one of them;"""
    stranger: float = 0.5
    """but only if the assembly's colour speaks against it by this much more than against the other."""
    tint: float = 0.25
    """The same of the tint, which is what the channels' logarithms differ by among themselves, in the mean
    of the frames in which it lay there: of twins on three tables it differed by 0.2 at most in 95 of 100
    frames, and by 0.33 to 0.43 from a thing of dark green;"""
    strange_tint: float = 0.15
    """and the assembly's."""
    frames: int = 4
    """Frames after which this is believed, in which it lay still."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        shares = (self.unlike, self.stranger, self.tint, self.strange_tint)
        if min(*shares, self.frames) <= 0:
            raise MethodError(
                f"unlike_twins.unlike is {self.unlike:g}, stranger {self.stranger:g}, "
                f"tint {self.tint:g}, strange-tint {self.strange_tint:g} and frames "
                f"{self.frames}: all must be above 0"
            )


@dataclass(slots=True, eq=False)
class _Look:
    """What something looks like: one frame in another light is not that."""

    color: Vector
    """Mean logarithms."""
    count: int = 0
    """Of frames in that mean."""

    def see(self, color: Vector) -> None:
        """Take a frame into the mean."""
        self.count += 1
        self.color = self.color + (color - self.color) / min(self.count, MOST)


@dataclass(slots=True, eq=False)
class _Spot:
    """Where something was taken for one of like parts, whatever it was called."""

    middle: Vector
    look: _Look
    last: int = -1
    """The last frame in that."""
    unlike: set[int] = field(default_factory=set[int])
    """In which it was too bright or dark for one, since it last was not."""

    def see(self, color: Vector, index: int, *, is_unlike: bool) -> None:
        """Take a frame into the mean, one that was taken before not again."""
        if index > self.last:
            self.last = index
            self.look.see(color)
        if is_unlike:
            self.unlike.add(index)
        else:  # what was seen elsewhere may still be another thing
            self.unlike.clear()


class UnlikeTwins:
    """Remembers the colours of like parts in one sequence."""

    def __init__(self, assembly: Assembly, *, config: UnlikeTwinsConfig) -> None:
        """Begin a sequence."""
        self._config, self._parts = config, assembly.parts
        groups = [group for group in twin_groups(assembly) if config.enabled and len(group) > 1]
        self._groups = {name: group for group in groups for name in group}
        self._surfaces = {name: SeenSurface(self._parts[name].mesh) for name in self._groups}
        self._known: dict[str, _Look] = {}
        self._spots = {group: list[_Spot]() for group in groups}

    def see(self, frame: Frame, sure: Mapping[str, Transform]) -> None:
        """Remember how parts look that are surely at these poses T_camera_part.

        Only as far as light and shadow change it: else it would be another thing.
        """
        config = self._config
        for name in self._groups.keys() & sure.keys():
            color = self._surfaces[name].seen(frame, sure[name])
            if color is None:
                continue
            known = self._known.setdefault(name, _Look(color))
            if (
                _bright_apart(color, known.color) < config.unlike
                and _tint_apart(color, known.color) < config.tint
            ):
                known.see(color)

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._known = renamed(self._known, names)

    def strangers(self, frame: Frame, poses: Mapping[str, Transform]) -> frozenset[str]:
        """Those of some poses T_camera_part at which something lies that is not the part.

        A glimpse does not tell, nor does what moves: a hand may hold it.
        """
        config, found = self._config, set[str]()
        for name in (name for name in poses if name in self._groups):
            color = self._surfaces[name].seen(frame, poses[name]) if self._known_of(name) else None
            if color is None:
                continue
            spot = self._spot_of(name, poses[name], color, frame.index)
            is_unlike = self._is_off(name, color, _bright_apart, config.unlike, config.stranger)
            spot.see(color, frame.index, is_unlike=is_unlike)
            is_tinted = spot.look.count > config.frames and self._is_off(
                name, spot.look.color, _tint_apart, config.tint, config.strange_tint
            )
            if is_tinted or len(spot.unlike) > config.frames:
                found.add(name)
        return frozenset(found)

    def forget(self, names: frozenset[str]) -> None:
        """What was taken for these parts were others."""
        for name in names & self._known.keys():
            del self._known[name]

    def _known_of(self, name: str) -> list[Vector]:
        """The colours of its twins, as far as they were surely seen."""
        others = (other for other in self._groups[name] if other != name)
        return [self._known[other].color for other in others if other in self._known]

    def _spot_of(self, name: str, T: Transform, color: Vector, index: int) -> _Spot:
        """Where a part at a pose lies, as far as it is known."""
        spots, middle = self._spots[self._groups[name]], apply_to_point(T, self._parts[name].middle)
        spots[:] = [spot for spot in spots if index - spot.last < FORGOTTEN]
        here = next((s for s in spots if np.linalg.norm(s.middle - middle) < SAME_PLACE), None)
        if here is None:
            here = _Spot(middle, _Look(color))
            spots.append(here)
        return here

    def _is_off(self, name: str, color: Vector, apart: Apart, by: float, more: float) -> bool:
        """Whether a part's colour is another one than a twin's, and the assembly's is nearer to that."""
        told = log_colors(self._parts[name].color)
        return any(
            apart(color, other) > by and apart(color, told) > apart(other, told) + more
            for other in self._known_of(name)
        )


def _bright_apart(a: Vector, b: Vector) -> float:
    return abs(float(a.mean() - b.mean()))


def _tint_apart(a: Vector, b: Vector) -> float:
    return float(np.linalg.norm(tint(a) - tint(b)))
