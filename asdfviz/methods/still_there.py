"""What already stood somewhere while a part was surely elsewhere is not that part.

Not in the paper. While a hand hides a part, a detector that must find it takes the next thing of its
colour and size. Such a thing mostly lay there all along, and the pictures of its place then and now show
that; a part that was put there changes them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np
from jaxtyping import UInt8

from asdfviz.datatypes import Assembly, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, apply_to_point, point_distance
from asdfviz.state.twins import renamed, twin_groups

AWAY = 0.015
"""Poses nearer to each other than this are in one place, metres."""
RECENT = 0.2
"""Weight of a frame in the mean of the last ones."""
SPOTS = 4
"""Of so many places for each part those are remembered where one lay longest."""


@dataclass(frozen=True)
class StillThereConfig:
    """When two pictures of a place show the same; a moved camera or light changes all places."""

    enabled: bool = True
    """On or off."""
    apart: float = 1.0
    """Of two places farther apart than this times the part's diameter one alone can be the part's."""
    side: float = 0.8
    """Of the square that is compared, as a share of the part's diameter."""
    depth: float = 0.006
    """A pixel whose depth changes by less, metres,"""
    color: float = 60.0
    """and red, green and blue by less than this, of 255, shows the same: shadows and moving arms that
    smear change colours alone."""
    color_alone: float = 14.0
    """The same where no depth was measured."""
    share: float = 0.85
    """Least share of such pixels."""
    memory: int = 400
    """After so many frames a picture says nothing any more."""
    better: float = 0.15
    """What is found with a score that is higher by this than where the part lay may be the part, 0 to 1."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            MethodError: the share is none.
        """
        if not 0 < self.share <= 1:
            raise MethodError(f"still_there.share is {self.share:g}, use more than 0, at most 1")


class _Spots:
    """Where parts that cannot be told apart lay."""

    def __init__(self, parts: int) -> None:
        """Begin without any; so many parts lay there."""
        self._most = SPOTS * parts
        self._spots: list[tuple[Vector, int]] = []
        """And in how many frames one was there; the last one first."""

    def see(self, place: Vector) -> None:
        """One lies at a place, in the camera's frame, metres."""
        known = [(spot, frames) for spot, frames in self._spots if _apart(spot, place) <= AWAY]
        others = [one for one in self._spots if _apart(one[0], place) > AWAY]
        kept = sorted(others, key=lambda one: -one[1])[: self._most - 1]
        self._spots = [(place, 1 + max((frames for _, frames in known), default=0)), *kept]

    def are_near(self, place: Vector) -> bool:
        """Whether one ever lay there."""
        return any(_apart(spot, place) <= AWAY for spot, _ in self._spots)


class StillThere:
    """Frames in which parts were last surely where they were tracked."""

    def __init__(self, assembly: Assembly, *, config: StillThereConfig) -> None:
        """Start without frames."""
        self._parts = assembly.parts
        kinds = {names: _Spots(len(names)) for names in twin_groups(assembly) if len(names) > 1}
        self._spots = {name: spots for names, spots in kinds.items() for name in names}
        """Of every part that has twins, where any of them lay."""
        self._config = config
        self._then: dict[str, tuple[Frame, int]] = {}
        """And the number of each."""
        self.lay: dict[str, Transform] = {}
        """Where parts surely were, T_camera_part, but not while they were held."""
        self._scores: dict[str, float] = {}
        """With what scores parts were found there, in the mean of the last frames."""
        self._frames = 0
        """That were seen; numbers of files may leave out any."""

    def see(
        self,
        frame: Frame,
        sure: Mapping[str, Transform],
        *,
        held: Collection[str] = (),
        scores: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Keep a frame for parts that surely are where they are in it; called for every frame.

        Args:
            frame: the picture.
            sure: poses T_camera_part of those parts.
            held: parts that a state joins: they lie nowhere.
            scores: of the boxes that parts were found in.
        """
        self._frames += 1
        self._then |= dict.fromkeys(sure, (frame, self._frames))
        lying = {name: T for name, T in sure.items() if name not in held}
        self.lay |= lying
        for name in lying.keys() & scores.keys():
            before = self._scores.get(name, scores[name])
            self._scores[name] = before + RECENT * (scores[name] - before)
        for name in lying.keys() & self._spots.keys():
            self._spots[name].see(apply_to_point(lying[name], self._parts[name].middle))

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._then, self.lay = renamed(self._then, names), renamed(self.lay, names)
        self._scores = renamed(self._scores, names)

    def others(
        self,
        frame: Frame,
        proposed: Mapping[str, Transform],
        last: Mapping[str, Transform],
        hidden: Callable[[Frame, frozenset[str]], frozenset[str]],
        *,
        scores: Mapping[str, float] = MappingProxyType({}),
    ) -> frozenset[str]:
        """Parts out of sight that are proposed where something else stands.

        Where the part or a twin of it ever lay it may be the part: which is which does not show, and may
        have been taken for otherwise before.

        Args:
            frame: the new frame.
            proposed: poses T_camera_part in it.
            last: those of tracked parts, where they last surely were.
            hidden: says which of some parts cannot be seen there now.
            scores: of the boxes that they are proposed from.
        """
        if not self._config.enabled:
            return frozenset()
        known = [
            name
            for name, T in proposed.items()
            if name in last and name in self._then and not self._is_a_twin(name, T)
        ]
        known = [name for name in known if not self._is_better(name, scores)]
        suspect = {n for n in known if self._is_other(n, frame, proposed[n], last[n])}
        return hidden(frame, frozenset(suspect)) if suspect else frozenset()

    def _is_better(self, name: str, scores: Mapping[str, float]) -> bool:
        known = name in scores and name in self._scores
        return known and scores[name] >= self._scores[name] + self._config.better

    def _is_a_twin(self, name: str, T_camera_part: Transform) -> bool:
        spots = self._spots.get(name)
        place = apply_to_point(T_camera_part, self._parts[name].middle)
        return spots is not None and spots.are_near(place)

    def _is_other(self, name: str, frame: Frame, T_new: Transform, T_last: Transform) -> bool:
        config, part = self._config, self._parts[name]
        middle, (then, number) = part.mesh.middle, self._then[name]
        if self._frames - number >= config.memory:
            return False
        if point_distance(T_new, T_last, middle) < config.apart * part.diameter:
            return False
        place = apply(T_new, middle[None])
        half = 0.5 * config.side * part.diameter * frame.camera.K[0, 0] / max(place[0, 2], 0.01)
        u, v = project(place, frame.camera.K)[0]
        height, width = frame.rgb.shape[:2]
        rows = slice(*np.clip([round(v - half), round(v + half) + 1], 0, height))
        columns = slice(*np.clip([round(u - half), round(u + half) + 1], 0, width))
        return self._shows_the_same(then, frame, rows, columns)

    def _shows_the_same(self, then: Frame, now: Frame, rows: slice, columns: slice) -> bool:
        before, after = then.rgb[rows, columns], now.rgb[rows, columns]
        if before.size == 0:
            return False
        change = np.abs(_smooth(after).astype(np.int16) - _smooth(before)).max(axis=2)
        same = change < self._config.color_alone
        if then.depth is not None and now.depth is not None:
            z_before, z_after = then.depth[rows, columns], now.depth[rows, columns]
            rests = np.abs(z_after - z_before) < self._config.depth
            measured = (z_before > 0) & (z_after > 0)
            same = (measured & rests & (change < self._config.color)) | (~measured & same)
        return bool(same.mean() >= self._config.share)


def _apart(a: Vector, b: Vector) -> float:
    return float(np.linalg.norm(a - b))


def _smooth(rgb: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Without most of the camera's noise."""
    return np.asarray(cv2.blur(np.ascontiguousarray(rgb), (3, 3)))
