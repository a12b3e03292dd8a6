"""Whether anything came near the places where a part is joined, since it was last seen loose.

Not in the paper. A part that is seen nowhere may be in a hand, and for how long it is none can say. But a
hand that joins it has to come to its place, which depth shows: as long as nothing did, it is not joined.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Frame, State
from asdfviz.geometry.camera import nearest_pixels
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.state.twins import loose_in_states

Place: TypeAlias = Callable[[str, State], Transform]
"""T_base_part where a state joins a part."""

READINGS = 12
"""Of depth in so many rows and columns about a place."""
PASSING = 0.5
"""What hides more than this of it far before it only passes, 0 to 1."""
FREE = 0.2
"""Where less than this of it is not hidden for good, it counts as this, 0 to 1."""
FADES = 0.005
"""What stays where it came to is part of what was there before, by so much a frame, metres."""


class _Sight(NamedTuple):
    """Of the places of a part: how much of what is about one, and could be seen, is hidden, 0 to 1."""

    beside: float
    """By something near it,"""
    may_be: float
    """which may also be where depth is blind,"""
    before: float
    """and also by what is nearer to the camera, and only passes."""


@dataclass(slots=True, eq=False)
class _Visit:
    """Of a hand to a place: who brings a part comes, stays for a while, and goes without it."""

    peak: float = 0.0
    """How much of what is about the place it hid most, 0 to 1,"""
    stayed: int = 0
    """in how many frames it was there,"""
    left: int = 0
    """and for how many it has been gone again."""
    is_early: bool = False
    """Whether what is there came before the part can have been brought."""
    is_on: bool = False
    """Whether it is there in this frame."""

    def see(
        self,
        sight: _Sight,
        is_loose: bool,
        is_away: bool,
        may_bring: bool,
        *,
        config: LooseConfig,
    ) -> None:
        """Take a frame; once the hand was surely seen to leave, who comes next matters no more.

        Args:
            sight: of the place.
            is_loose: whether the part was found loose: then it was not left there,
            is_away: and not even near: then who is there brings something else.
            may_bring: whether the part can be there by now.
            config: when that says something.
        """
        there, least = sight.beside, max(config.came, config.rest * self.peak)
        self.is_on, self.left = False, 0 if is_loose else self.left
        if self.left >= config.steady:
            self.left += 1
        elif sight.before < least:
            self.is_early = False
            self.left += self.stayed >= config.steady
        elif self.is_early or not may_bring:
            self.is_early = True
        elif there >= least:
            self.peak, self.stayed, self.left = max(self.peak, there), self.stayed + 1, 0
            self.is_on = True
        if is_away:
            self.peak, self.stayed = 0.0, 0


@dataclass(slots=True, eq=False)
class _Watch:
    """The places of the part that is joined next."""

    places: list[tuple[str, State]]
    """That is, parts and states that join them there."""
    before: Float64[np.ndarray, "places readings"] | None = None
    """How much farther than each place depth was, metres, when the part was seen loose."""
    shares: Float64[np.ndarray, "places"] | None = None
    """How much of what is about each place something was nearer at least since then, 0 to 1."""
    row: int = 0
    """In how many frames one after another it was,"""
    gone: int = 0
    """for how many it has not been,"""
    arrives: float = 0.0
    """and when one that was taken then may be in its place at the earliest, seconds,"""
    rests: int = 0
    """In how many frames one after another it was seen to lie where it lay, surely or not,"""
    came: int = 0
    """in how many something was near it since then,"""
    since: float | None = 0.0
    """and for how many something may have come near it since; None: nothing did."""
    visit: _Visit = field(default_factory=_Visit)
    """And whether it left again."""


class Approaches:
    """To the places of one kind of part in one sequence."""

    def __init__(self, assembly: Assembly, names: Sequence[str], *, config: LooseConfig) -> None:
        """Begin a sequence; `names` are of the twins."""
        self._config, part = config, assembly.parts[names[0]]
        self._middle, reach = part.middle, part.diameter / 2 + config.about
        ticks = np.linspace(-reach, reach, READINGS)
        self._about = np.zeros((READINGS**2, 3))
        self._about[:, 0], self._about[:, 1] = np.tile(ticks, READINGS), np.repeat(ticks, READINGS)
        counts = loose_in_states(assembly, names)
        states = list(zip(assembly.states, counts, strict=True))
        self._watches: list[_Watch] = []
        for k in range(len(names)):
            now, then = ([s for s, n in states if n == loose] for loose in (k + 1, k))
            known = _places(now, names)
            places = _places(then, names)
            new = [place for key, place in places.items() if key not in known]
            self._watches.append(_Watch(new or list(places.values())))

    def step(
        self,
        T_camera_base: Transform,
        frame: Frame,
        place: Place,
        *,
        lying: int,
        resting: int,
        found: int,
        moving: Sequence[Vector],
        way: float,
        unsure: bool,
    ) -> None:
        """Look at the places.

        Args:
            T_camera_base: where the base is.
            frame: with depth.
            place: T_base_part where a state joins a part, by what is known of its joint.
            lying: how many of the parts surely lie loose in it.
            resting: how many lie in it, surely or not.
            found: how many were found loose in it.
            moving: middles of those that are loose and do not surely lie, the camera's frame, metres.
            way: how far the nearest loose one is from any place, metres: so far one has to be carried.
            unsure: whether places are known too roughly: then something may always have come there.
        """
        for k, watch in enumerate(self._watches):
            if not watch.places:
                continue
            Ts = [T_camera_base @ place(name, state) for name, state in watch.places]
            middles = np.array([apply_to_point(T, self._middle) for T in Ts])
            sight = self._look(watch, middles, frame, is_lying=lying > k)
            watch.rests = watch.rests + 1 if resting > k else 0
            if watch.row > 0 or watch.rests >= self._config.again:
                watch.visit = _Visit()
                watch.arrives = frame.time + way / self._config.speed
            if watch.row >= self._config.steady:
                watch.since = None
            may_bring = frame.time >= watch.arrives
            is_there = may_bring and sight.may_be >= self._config.came
            watch.came = watch.came + 1 if is_there else 0
            apart = np.linalg.norm(np.reshape(moving, (-1, 1, 3)) - middles, axis=2)
            near = apart < self._config.close
            watch.gone = watch.gone + 1 if watch.row == 0 else 0
            may_have = unsure or near.any() or watch.gone > self._config.patience
            if watch.row == 0 and not unsure:
                is_loose = found > k
                is_away = is_loose and len(moving) > 0 and not near.any()
                watch.visit.see(sight, is_loose, is_away, may_bring, config=self._config)
            if watch.since is not None:
                # What passes before a place tells nothing of it; who still is there may not be done.
                is_passing = sight.before - sight.may_be >= PASSING
                is_busy = watch.visit.is_on and not unsure
                watch.since += 0.0 if is_passing else self._config.busy if is_busy else 1.0
            elif watch.row == 0 and (may_have or watch.came >= self._config.again):
                watch.since = 0.0

    def _look(self, watch: _Watch, middles: Points, frame: Frame, *, is_lying: bool) -> _Sight:
        """What is in front of the places that was not since the part was seen to lie."""
        seen = self._readings(middles, frame)
        before = seen if watch.before is None else watch.before
        watch.row = watch.row + 1 if is_lying else 0
        shares = np.nan_to_num(self._shares(seen, before), nan=1.0)
        least = shares if watch.shares is None or watch.row else watch.shares
        watch.shares = np.minimum(shares, least)
        watch.before = np.fmax(seen, before - FADES if watch.row else before)
        beside = self._shares(seen, before, within=self._config.within)
        unseen, may_be = (np.nan_to_num(beside, nan=told) for told in (0.0, 1.0))
        # Behind what has come before it for good nothing is seen to come.
        free = np.maximum(1.0 - watch.shares, FREE)
        told = [(one - watch.shares) / free for one in (unseen, may_be, shares)]
        return _Sight(*(float(np.max(one)) for one in told))

    def frames(self, k: int) -> float | None:
        """For how many frames something may have come near where the part of number k is joined; None:
        nothing did."""
        return self._watches[k].since

    def left(self, k: int) -> int:
        """For how many frames what came near where the part of number k is joined has been gone again."""
        return self._watches[k].visit.left

    def _shares(
        self,
        seen: Float64[np.ndarray, "places readings"],
        before: Float64[np.ndarray, "places readings"],
        *,
        within: float = math.inf,
    ) -> Float64[np.ndarray, "places"]:
        """Of what is about each place, how much something is nearer at than what was there; NaN where that
        is not known.

        Args:
            seen: as `_readings` gives them,
            before: and as it gave them then.
            within: what is farther before the place than this does not count, metres.
        """
        known = np.isfinite(seen) & np.isfinite(before)
        nearer = np.where(known, before - seen, 0.0) > self._config.nearer
        nearer &= np.where(known, seen, 0.0) > -within
        count = known.sum(axis=1)
        shares = nearer.sum(axis=1) / np.maximum(count, 1)
        return np.where(2 * count < known.shape[1], np.nan, shares)

    def _readings(self, middles: Points, frame: Frame) -> Float64[np.ndarray, "places readings"]:
        """How much farther than each place depth is about it, metres; NaN where it is blind."""
        assert frame.depth is not None
        points = (middles[:, None] + self._about).reshape(-1, 3)
        inside, rows, columns = nearest_pixels(points, frame.camera.K, frame.depth.shape)
        depth = frame.depth[rows, columns].astype(np.float64)
        gaps = np.full(len(points), np.nan)
        gaps[inside] = np.where(depth > 0, depth - points[inside, 2], np.nan)
        return gaps.reshape(len(middles), -1)


def _places(states: Sequence[State], names: Sequence[str]) -> dict[bytes, tuple[str, State]]:
    """The different places of these parts."""
    return {s.T_base_part[n].tobytes(): (n, s) for s in states for n in names if n in s.T_base_part}
