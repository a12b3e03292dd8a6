"""Small parts that lie where they lay, or no longer do: a witness for the state.

Not in the paper. A pin of a few pixels shows nothing once it is in, neither to the crop network nor in
depth, so its step goes unseen, and what is joined after it looks like an error. But as long as it lay on
the table it was found there. Once it is not for longer than a hand takes to carry it, it is joined; and
what still lies there is not, whatever its place in the group looks like.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.transforms import apply_to_point, inverse
from asdfviz.methods.approaches import Place
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.loose_kinds import Kind, Spot, kind_of
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.registration import projected_box
from asdfviz.state.joined_spots import JoinedSpots
from asdfviz.state.twins import twin_groups


def _nominal(name: str, state: State) -> Transform:
    return state.T_base_part[name]


class LooseParts:
    """Counts the loose parts of one sequence."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        *,
        config: LooseConfig,
        half_done: Collection[int] = (),
    ) -> None:
        """Begin a sequence.

        Args:
            assembly: whose parts.
            shapes: of the parts.
            config: when parts count.
            half_done: states of `assembly` that only come between two of its own.
        """
        self._assembly, self._config, self._half_done = assembly, config, frozenset(half_done)
        self._corners = {name: shape.corners for name, shape in shapes.items()}
        groups = [tuple(n for n in names if n != assembly.base) for names in twin_groups(assembly)]
        self._spots = JoinedSpots(assembly)
        self._T_stage_base: Transform | None = None
        self._frames, self._step_frames = 0, 0.0
        self._kinds = [
            kind_of(assembly, names, self._spots, config=config) for names in groups if names
        ]

    def step(
        self,
        base: PoseEstimate | None,
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
        *,
        rest: AtRest,
        shown_px: Callable[[str, State], float],
        place: Place = _nominal,
        step_frames: float = 0.0,
    ) -> Scores | None:
        """Probability of every state by what lies loose; None where that says nothing.

        Args:
            base: where the base part is; if that is not known, it is taken to be where it last was.
            poses: of the parts.
            frame: with depth, or nothing is said.
            rest: what lies still, and how the camera moves; it has seen this frame.
            shown_px: in how many pixels a part shows where a state joins it.
            place: T_base_part where a state joins a part, as its joint is known; left out, as in the state.
            step_frames: how long a step takes, frames.
        """
        self._step_frames = step_frames
        if base is not None:
            self._T_stage_base = inverse(rest.T_camera_stage) @ base.T_camera_part
        if not self._config.enabled or self._T_stage_base is None or frame.depth is None:
            return None
        self._frames += 1
        T_camera_base = rest.T_camera_stage @ self._T_stage_base
        against = np.zeros(len(self._assembly.states))
        kinds = [kind for kind in self._kinds if kind.places]
        lying = [self._count(kind, T_camera_base, poses, frame, rest, place) for kind in kinds]
        for kind, there in zip(kinds, lying, strict=True):
            is_small = partial(self._is_small, kind, T_camera_base, frame, rest)
            against += self._against(kind, there, is_small, shown_px)
        if not against.any():
            return None
        scores = np.exp(against.min() - against)
        return scores / scores.sum()

    def _is_small(self, kind: Kind, T_camera_base: Transform, frame: Frame, rest: AtRest) -> bool:
        """Whether none of them shows where it is joined."""
        small_px = self._config.blurred_px if rest.is_shaken else self._config.small_px
        corners = self._corners[kind.names[0]]
        boxes = (projected_box(T_camera_base @ T, corners, frame) for T in kind.places)
        return all((box[2:] - box[:2]).min() < small_px for box in boxes)

    def _count(
        self,
        kind: Kind,
        T_camera_base: Transform,
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
        rest: AtRest,
        place: Place,
    ) -> int:
        """Note which are loose; returns how many surely lie where they lay."""
        middle = self._assembly.parts[kind.names[0]].middle
        T_stage_camera = inverse(rest.T_camera_stage)
        found = [poses[name] for name in kind.names if name in poses]
        ways = [(pose, self._way(pose, T_camera_base)) for pose in found]
        away = [(pose, way) for pose, way in ways if way > self._config.away]
        sure = [(p, way) for p, way in away if rest.lies(p.part) or not rest.is_shaken]
        loose = [
            (apply_to_point(T_stage_camera @ pose.T_camera_part, middle), pose.score)
            for pose, _ in sure
        ]
        lie = self._lying(kind, loose)
        there, away_by = sum(lie), [way for _, way in sure]
        kind.see_far(
            sum(p.score >= self._config.far_sure and way > self._config.far for p, way in sure)
        )
        moving = [pose for (pose, _), lies in zip(sure, lie, strict=True) if not lies]
        unsure = [p for p in found if p.score < self._config.found and p.stage != "group"]
        maybe = [apply_to_point(T_stage_camera @ p.T_camera_part, middle) for p in unsure]
        likely = [at for p, at in zip(unsure, maybe, strict=True) if p.score >= self._config.likely]
        kind.approaches.step(
            T_camera_base,
            frame,
            place,
            lying=there,
            resting=kind.resting(self._config.enough, likely, within=self._config.away),
            found=len(loose),
            moving=[apply_to_point(pose.T_camera_part, middle) for pose in moving],
            way=min(filter(math.isfinite, away_by), default=0.0),
            unsure=rest.is_shaken,
        )
        self._note_ways(kind, away_by)
        hidden = self._hidden(kind, frame, rest, maybe)
        for k in range(len(kind.names)):
            if len(loose) > k:
                kind.found[k] += 1
                kind.gone[k], kind.last[k] = 0, self._frames
            elif len(away) + hidden <= k:
                kind.gone[k] += 1
        return there

    def _way(self, pose: PoseEstimate, T_camera_base: Transform) -> float:
        """How far a part is from all places, metres; 0 where its pose does not say so."""
        if pose.score < self._config.found or pose.stage == "group":
            return 0.0
        return self._spots.distance(pose.part, pose.T_camera_part, T_camera_base)

    def _note_ways(self, kind: Kind, ways: list[float]) -> None:
        """Note how far those are that were found loose, and how far one was that no longer is."""
        if len(ways) < len(kind.ways):
            lay = any(
                not s.is_seen and s.last == self._frames - 1 and s.frames >= self._config.enough
                for s in kind.spots
            )
            # One that was taken from where it lay has all of its way before it; one that is never joined
            # has no end of it.
            left = 1.0 if lay or math.isinf(kind.far) else min(kind.ways) / kind.far
            kind.left[len(ways) : len(kind.ways)] = [left] * (len(kind.ways) - len(ways))
        kind.ways, kind.far = ways, max(kind.far, *ways, 0.0)

    def _lying(self, kind: Kind, loose: Sequence[tuple[Vector, float]]) -> list[bool]:
        """Which surely lie where they lay, each in a spot of its own; notes where all of them are."""
        config, lie, apart = self._config, list[bool](), np.zeros((len(loose), len(kind.spots)))
        for j, spot in enumerate(kind.spots):
            spot.is_seen = False
            apart[:, j] = [np.linalg.norm(spot.middle - point) for point, _ in loose]
        pairs = cheapest_pairs(np.minimum(apart, config.away))
        known = {i: kind.spots[j] for i, j in pairs if apart[i, j] <= config.away}
        for i, (point, score) in enumerate(loose):
            if i not in known:
                known[i] = Spot(point)
                kind.spots.append(known[i])
            spot = known[i]
            spot.is_seen, spot.frames, spot.empty = True, spot.frames + 1, 0
            spot.middle = spot.middle + (point - spot.middle) / min(spot.frames, config.enough)
            spot.last = self._frames
            lie.append(score >= config.sure and spot.frames >= config.enough)
        if len(loose) == len(kind.names):
            kind.lie_nowhere_else(config.empty)
        # What lay for a moment may be hidden since; what moves lay nowhere.
        kind.spots = [
            s for s in kind.spots if s.is_seen or s.frames >= min(config.steady, config.enough)
        ]
        return lie

    def _against(
        self,
        kind: Kind,
        there: int,
        is_small: Callable[[], bool],
        shown_px: Callable[[str, State], float],
    ) -> Scores:
        """What speaks against each state, log odds.

        Args:
            kind: of parts.
            there: how many of them surely lie where they lay.
            is_small: says whether none of them shows where it is joined,
            shown_px: and in how many pixels one does in a state.
        """
        config, most = self._config, [0.0]
        for loose, found in enumerate(kind.found):
            told, frames = 0.0, self._waited(kind, loose)
            is_long = frames > 0 and found >= config.enough
            if is_long and (is_small() or self._hides(kind, loose, shown_px)):
                told = min(config.gain * frames, config.most)
            elif is_long:
                told = min(config.gain * self._left(kind, loose), config.most_shown)
            # Where not even one is found, two are not either.
            most.append(max(told, most[-1]))
        far = kind.far_for(config.steady)
        lying = [
            max(config.there * max(there - loose, 0), config.seen_far * (far > loose))
            for loose in kind.loose
        ]
        untouched = [self._untouched(kind, loose) for loose in kind.loose]
        return np.array([most[n] for n in kind.loose]) + np.maximum(lying, untouched)

    def _untouched(self, kind: Kind, loose: int) -> float:
        """What speaks against so few being loose: nothing came near where the next one is joined."""
        enough = self._config.enough
        missing = range(loose, len(kind.names))
        is_untouched = any(
            kind.found[k] >= enough and kind.approaches.frames(k) is None for k in missing
        )
        return self._config.untouched * is_untouched

    def _waited(self, kind: Kind, k: int) -> float:
        """For how many frames the part of number k has been gone for longer than a hand carries it.

        A hand carries one after the other: what was gone before another one was taken is in its place.
        Until something came to that place it is in the hand.
        """
        gone, last, config = kind.gone[k], kind.last[k], self._config
        later = [
            spot.empty
            for other in self._kinds
            for spot in other.spots
            if spot.empty >= config.empty and spot.last > last + config.empty
        ]
        least = gone - config.wait * max(kind.left[k], config.shortest)
        carried = config.carried * self._step_frames * kind.left[k]
        waited = min(float(least), max(gone - carried, float(max(later, default=0))))
        near = kind.approaches.frames(k)
        if near is None:
            return 0.0
        return max(min(waited, near), self._left(kind, k))

    def _left(self, kind: Kind, k: int) -> float:
        """The same, by who brought it and has left."""
        return self._config.left * kind.approaches.left(k) if kind.gone[k] else 0.0

    def _hides(self, kind: Kind, loose: int, shown_px: Callable[[str, State], float]) -> bool:
        """Whether the joined ones show nowhere in the states that leave so many loose."""
        states = [s for s in self._assembly.states if kind.loose[s.index] == loose]
        # What is half done, or wrong, may show what is hidden in the end.
        whole = [s for s in states if s.index not in self._half_done and not s.is_error]
        return all(
            shown_px(name, state) < self._config.small_px**2
            for state in whole or states
            for name in kind.names
            if name in state.T_base_part
        )

    def _hidden(self, kind: Kind, frame: Frame, rest: AtRest, maybe: Sequence[Vector]) -> int:
        """How many may lie where they lay, but for what hides the place, or is unsure (`maybe`); notes
        which are gone from there."""
        count, away = 0, self._config.away
        for spot in kind.spots:
            if spot.is_seen:
                continue
            is_unsure = any(np.linalg.norm(spot.middle - point) <= away for point in maybe)
            by = self._config.in_front
            if not is_unsure and not rest.is_hidden(spot.middle, frame, by=by):
                spot.empty += 1
            elif spot.empty < self._config.empty:
                count += 1
        enough = self._config.enough
        kind.spots = [s for s in kind.spots if s.is_seen or s.frames >= enough or not s.empty]
        return count
