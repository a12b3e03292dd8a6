"""Small parts that lie where they lay, or no longer do: a witness for the state.

Not in the paper. A pin of a few pixels shows nothing once it is in, neither to the crop network nor in
depth, so its step goes unseen, and what is joined after it looks like an error. But as long as it lay on
the table it was found there. Once it is not for longer than a hand takes to carry it, it is joined; and
what still lies there is not, whatever its place in the group looks like.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.geometry.camera import nearest_pixels
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.transforms import apply_to_point, inverse
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.registration import projected_box
from asdfviz.state.joined_spots import JoinedSpots
from asdfviz.state.twins import loose_in_states, twin_groups


@dataclass(slots=True, eq=False)
class _Spot:
    """Where a part of some kind was found loose."""

    middle: Vector
    """In the frame of what lies still, metres."""
    frames: int = 0
    """In which one was there."""
    is_seen: bool = False
    """In the last frame."""
    empty: int = 0
    """In how many frames since it was seen to be gone from there."""


@dataclass(slots=True, eq=False)
class _Kind:
    """The twins of one part, or a part that has none."""

    names: tuple[str, ...]
    loose: tuple[int, ...]
    """How many of them are loose in each state."""
    places: tuple[Transform, ...]
    """T_base_part of all of them in all states."""
    found: list[int]
    """In how many frames one or more, two or more, ... were found loose,"""
    gone: list[int]
    """and for how many they have not been since."""
    spots: list[_Spot] = field(default_factory=list[_Spot])


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
        self._kinds = [_kind(assembly, names, self._spots) for names in groups if names]

    def step(
        self,
        base: PoseEstimate | None,
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
        *,
        rest: AtRest,
        shown_px: Callable[[str, State], float],
    ) -> Scores | None:
        """Probability of every state by what lies loose; None where that says nothing.

        Args:
            base: where the base part is; if that is not known, it is taken to be where it last was.
            poses: of the parts.
            frame: with depth, or nothing is said.
            rest: what lies still, and how the camera moves; it has seen this frame.
            shown_px: in how many pixels a part shows where a state joins it.
        """
        if base is not None:
            self._T_stage_base = inverse(rest.T_camera_stage) @ base.T_camera_part
        if not self._config.enabled or self._T_stage_base is None or frame.depth is None:
            return None
        T_camera_base = rest.T_camera_stage @ self._T_stage_base
        against = np.zeros(len(self._assembly.states))
        for kind in self._kinds:
            if kind.places:
                there = self._count(kind, T_camera_base, poses, frame, rest)
                is_small = partial(self._is_small, kind, T_camera_base, frame, rest)
                against += self._against(kind, there, is_small, shown_px)
        if not against.any():
            return None
        scores = np.exp(against.min() - against)
        return scores / scores.sum()

    def _is_small(self, kind: _Kind, T_camera_base: Transform, frame: Frame, rest: AtRest) -> bool:
        """Whether none of them shows where it is joined."""
        small_px = self._config.blurred_px if rest.is_shaken else self._config.small_px
        corners = self._corners[kind.names[0]]
        boxes = (projected_box(T_camera_base @ T, corners, frame) for T in kind.places)
        return all((box[2:] - box[:2]).min() < small_px for box in boxes)

    def _count(
        self,
        kind: _Kind,
        T_camera_base: Transform,
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
        rest: AtRest,
    ) -> int:
        """Note which are loose; returns how many surely lie where they lay."""
        middle = self._assembly.parts[kind.names[0]].middle
        T_stage_camera = inverse(rest.T_camera_stage)
        found = [poses[name] for name in kind.names if name in poses]
        away = [pose for pose in found if self._is_away(pose, T_camera_base)]
        loose = [
            (apply_to_point(T_stage_camera @ pose.T_camera_part, middle), pose.score)
            for pose in away
            if rest.lies(pose.part) or not rest.is_shaken
        ]
        there = self._lying(kind, loose)
        hidden = self._hidden(kind, frame, rest)
        for k in range(len(kind.names)):
            if len(loose) > k:
                kind.found[k] += 1
                kind.gone[k] = 0
            elif len(away) + hidden <= k:
                kind.gone[k] += 1
        return there

    def _is_away(self, pose: PoseEstimate, T_camera_base: Transform) -> bool:
        config, T = self._config, pose.T_camera_part
        return (
            pose.score >= config.found
            and pose.stage != "group"
            and self._spots.distance(pose.part, T, T_camera_base) > config.away
        )

    def _lying(self, kind: _Kind, loose: Sequence[tuple[Vector, float]]) -> int:
        """How many surely lie where they lay, each in a spot of its own; notes where all of them are."""
        config, there, apart = self._config, 0, np.zeros((len(loose), len(kind.spots)))
        for j, spot in enumerate(kind.spots):
            spot.is_seen = False
            apart[:, j] = [np.linalg.norm(spot.middle - point) for point, _ in loose]
        pairs = cheapest_pairs(np.minimum(apart, config.away))
        known = {i: kind.spots[j] for i, j in pairs if apart[i, j] <= config.away}
        for i, (point, score) in enumerate(loose):
            if i not in known:
                known[i] = _Spot(point)
                kind.spots.append(known[i])
            spot = known[i]
            spot.middle, spot.is_seen, spot.frames, spot.empty = point, True, spot.frames + 1, 0
            there += score >= config.sure and spot.frames >= config.enough
        kind.spots = [s for s in kind.spots if s.is_seen or s.frames >= config.enough]
        return there

    def _against(
        self,
        kind: _Kind,
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
        for loose, (found, gone) in enumerate(zip(kind.found, kind.gone, strict=True)):
            told, is_long = 0.0, gone > config.wait and found >= config.enough
            if is_long and (is_small() or self._hides(kind, loose, shown_px)):
                told = min(config.gain * (gone - config.wait), config.most)
            # Where not even one is found, two are not either.
            most.append(max(told, most[-1]))
        return np.array(
            [most[loose] + config.there * max(there - loose, 0) for loose in kind.loose]
        )

    def _hides(self, kind: _Kind, loose: int, shown_px: Callable[[str, State], float]) -> bool:
        """Whether the joined ones show nowhere in the states that leave so many loose."""
        states = [s for s in self._assembly.states if kind.loose[s.index] == loose]
        # What is half done may show what is hidden in the end.
        whole = [s for s in states if s.index not in self._half_done]
        return all(
            shown_px(name, state) < self._config.small_px**2
            for state in whole or states
            for name in kind.names
            if name in state.T_base_part
        )

    def _hidden(self, kind: _Kind, frame: Frame, rest: AtRest) -> int:
        """How many may lie where they lay, but for what hides the place; notes which are gone from there."""
        count = 0
        for spot in kind.spots:
            if spot.is_seen:
                continue
            if not self._is_hidden(spot.middle, frame, rest):
                spot.empty += 1
            elif spot.empty < self._config.empty:
                count += 1
        return count

    def _is_hidden(self, point_stage: Vector, frame: Frame, rest: AtRest) -> bool:
        """Whether something stands in front of a point, or it is out of view."""
        assert frame.depth is not None
        point = apply_to_point(rest.T_camera_stage, point_stage)
        inside, row, column = nearest_pixels(point[None], frame.camera.K, frame.depth.shape)
        if not inside[0]:
            return True
        return 0 < frame.depth[row[0], column[0]].item() < point[2].item() - self._config.in_front


def _kind(assembly: Assembly, names: tuple[str, ...], spots: JoinedSpots) -> _Kind:
    places = tuple(T for name in names for T in spots.places.get(name, ()))
    return _Kind(
        names, loose_in_states(assembly, names), places, [0] * len(names), [0] * len(names)
    )
