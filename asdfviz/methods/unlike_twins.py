"""Of two like parts the one that looks quite unlike the other is another thing of their shape.

Not in the paper. A detector knows a screw by its shape and takes one that lies there by chance, pale where
the assembly's are black. Once one of them is surely found, its colour tells: the light differs
from place to place, but hardly by a factor of two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply
from asdfviz.methods.seen_colors import SeenSurface, log_colors
from asdfviz.state.twins import renamed, twin_groups

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

    frames: int = 4
    """Frames after which this is believed, in which it lay still."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.unlike, self.stranger, self.frames) <= 0:
            raise MethodError(
                f"unlike_twins.unlike is {self.unlike:g}, stranger {self.stranger:g} and frames "
                f"{self.frames}: all must be above 0"
            )


class UnlikeTwins:
    """Remembers the colours of like parts in one sequence."""

    def __init__(self, assembly: Assembly, *, config: UnlikeTwinsConfig) -> None:
        """Begin a sequence."""
        self._config, self._parts = config, assembly.parts
        self._others = {
            name: tuple(other for other in group if other != name)
            for group in twin_groups(assembly)
            for name in group
            if config.enabled and len(group) > 1
        }
        self._surfaces = {name: SeenSurface(self._parts[name].mesh) for name in self._others}
        self._known: dict[str, float] = {}
        self._unlike: dict[str, dict[int, Vector]] = {}
        """Where something unlike was taken for a part, by frame; so many as tell, since it looked right."""

    def see(self, frame: Frame, sure: Mapping[str, Transform]) -> None:
        """Remember how parts look that are surely at these poses T_camera_part.

        Only as far as light and shadow change it: else it would be another thing.
        """
        for name in self._others.keys() & sure.keys():
            bright = self._brightness(frame, name, sure[name])
            if (
                bright is not None
                and abs(bright - self._known.get(name, bright)) < self._config.unlike
            ):
                self._known[name] = bright

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._known = renamed(self._known, names)
        self._unlike = renamed(self._unlike, names)

    def strangers(self, frame: Frame, poses: Mapping[str, Transform]) -> frozenset[str]:
        """Those of some poses T_camera_part at which something lies that is not the part.

        A glimpse does not tell, nor does what moves: a hand may hold it.
        """
        found: set[str] = set()
        for name in self._others.keys() & poses.keys():
            is_unlike = self._is_unlike(frame, name, poses[name])
            if is_unlike is None:
                continue
            at = apply(poses[name], self._parts[name].middle[None])[0]
            before = self._unlike.get(name, {})
            here = {i: p for i, p in before.items() if np.linalg.norm(p - at) < SAME_PLACE}
            if not is_unlike:  # what was seen elsewhere may still be another thing
                self._unlike[name] = {i: p for i, p in before.items() if i not in here}
                continue
            told = [*{**here, frame.index: at}.items()]
            self._unlike[name] = dict(told[-self._config.frames :])
            if len(here) >= self._config.frames:
                found.add(name)
        return frozenset(found)

    def forget(self, names: frozenset[str]) -> None:
        """What was taken for these parts were others."""
        for name in names & self._known.keys():
            del self._known[name]

    def _is_unlike(self, frame: Frame, name: str, T_camera_part: Transform) -> bool | None:
        """Whether what is there is another thing; None where that cannot be seen."""
        known = [self._known[other] for other in self._others[name] if other in self._known]
        bright = self._brightness(frame, name, T_camera_part) if known else None
        if bright is None:
            return None
        told = float(log_colors(self._parts[name].color).mean())
        return any(
            abs(bright - other) > self._config.unlike
            and abs(bright - told) > abs(other - told) + self._config.stranger
            for other in known
        )

    def _brightness(self, frame: Frame, name: str, T_camera_part: Transform) -> float | None:
        """Of what can be seen of a part, median logarithm; None where that is too little."""
        seen = self._surfaces[name].seen(frame, T_camera_part)
        return None if seen is None else float(seen.mean())
