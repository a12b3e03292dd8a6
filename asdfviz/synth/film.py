"""From acts (who moves where) to moments (one a frame), with as many frames as somebody wishes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
from jaxtyping import Int64

from asdfviz.datatypes import State
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import inverse, transform_from
from asdfviz.synth.motion import Limits, travel


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame of the script."""

    T_world_part: Mapping[str, Transform]
    attached: tuple[str, ...]
    state: State
    """The state that the truth names."""
    T_world_hand: Transform | None
    """Rigid; `grasping.scaled` makes the mesh's pose of it."""
    held: str | None
    """The part between the fingers, or the one that moves by itself where there are no hands."""
    grasp: int = 0
    """Shape of the hand, an index into GRASPS."""


@dataclass(frozen=True, slots=True, eq=False)
class Act:
    """A stretch of the script in which one thing moves, or nothing."""

    stops: tuple[Transform, ...]
    """World poses of the held part, else of the hand; empty if neither is there."""
    poses: Mapping[str, Transform]
    """T_world_part of everything when it begins."""
    attached: tuple[str, ...]
    state: State
    limits: Limits
    frames: int
    """As many as its pace needs."""
    least: int
    """As many as it can do with."""
    held: str | None = None
    riders: Mapping[str, Transform] = field(default_factory=dict[str, Transform])
    """T_held_part of what moves with the held part."""
    T_part_hand: Transform | None = None
    grasp: int = 0
    pivot: Vector = field(default_factory=lambda: np.zeros(3))
    """The point (frame of what moves) whose way is straight: the middle of a part."""

    def shoot(self, count: int) -> list[Moment]:
        """The act in `count` frames."""
        if not self.stops:
            return [self._moment(self.poses, None)] * count
        if len(self.stops) == 1:
            way = [self.stops[0]] * count
        else:
            middle = transform_from(np.eye(3), self.pivot)
            stops = [T @ middle for T in self.stops]
            way = [T @ inverse(middle) for T in travel(stops, self.limits, count=count)]
        return [self._at(T) for T in way]

    def _at(self, T: Transform) -> Moment:
        if self.held is None:
            return self._moment(self.poses, T)
        riders = {name: T @ T_held_part for name, T_held_part in self.riders.items()}
        poses = {**self.poses, self.held: T, **riders}
        return self._moment(poses, None if self.T_part_hand is None else T @ self.T_part_hand)

    def _moment(self, poses: Mapping[str, Transform], hand: Transform | None) -> Moment:
        return Moment(dict(poses), self.attached, self.state, hand, self.held, self.grasp)


def film(
    acts: Sequence[Act], *, frames: int | None, frames_per_state: int | None
) -> tuple[Moment, ...]:
    """All moments of a script.

    Args:
        acts: in order.
        frames: wished in all; what the paces need by default. Hands hurry and waits get short where
            that is too many; fewer than held parts need at their limits is not possible.
        frames_per_state: wished for every run of one state, under the same condition.
    """
    counts = np.array([act.frames for act in acts])
    least = np.array([act.least for act in acts])
    if frames_per_state is not None:
        for start, stop in _runs(acts):
            part = slice(start, stop)
            counts[part] = share_out(frames_per_state, counts[part], least[part])
    if frames is not None:
        counts = share_out(frames, counts, least)
    moments = [m for act, n in zip(acts, counts.tolist(), strict=True) for m in act.shoot(n)]
    return tuple(moments)


def _runs(acts: Sequence[Act]) -> list[tuple[int, int]]:
    """Start and end of every run of acts with one state."""
    runs: list[tuple[int, int]] = []
    start = 0
    for _, members in groupby(acts, key=lambda act: act.state.name):
        count = len(list(members))
        runs.append((start, start + count))
        start += count
    return runs


def share_out(
    total: int, natural: Int64[np.ndarray, "n"], least: Int64[np.ndarray, "n"]
) -> Int64[np.ndarray, "n"]:
    """Frames of each act so that they sum up to `total`, in proportion to what each would like.

    Where `total` is less than the sum of `least`, that sum is what comes out.
    """
    room = total - int(least.sum())
    if room <= 0:
        return least.copy()
    wish = natural.astype(float) if total > int(natural.sum()) else (natural - least).astype(float)
    if wish.sum() == 0:
        wish = np.ones(len(natural))
    base = natural if total > int(natural.sum()) else least
    exact = wish / wish.sum() * (total - int(base.sum()))
    counts = base + np.floor(exact).astype(int)
    left = total - int(counts.sum())
    counts[np.argsort(-(exact - np.floor(exact)), kind="stable")[:left]] += 1
    return counts
