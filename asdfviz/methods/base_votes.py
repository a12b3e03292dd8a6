"""Where the base part is: where its own pose says, where it was, or where the parts that it carries say.

Not in the paper, which takes the base's pose as it is found. Everything joined is compared with the base,
so where the parts that it carries hide most of it and something else is taken for it, all is wrong at
once. Three kinds of hypotheses are compared by what they make of one frame's poses: its own pose is right;
it is still where it was; a part that a state joins is right, and the base is where it is joined to that.
The last two say that its own pose is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from asdfviz.datatypes import Frame, PoseEstimate, State
from asdfviz.geometry.camera import depth_gaps
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.methods.base_votes_config import BaseVotesConfig
from asdfviz.methods.group_poses import GroupPoses
from asdfviz.methods.one_place import OnePlace
from asdfviz.methods.part_poses import shape_fit
from asdfviz.pose.depth_fit import DepthFit
from asdfviz.state.joints import deviation
from asdfviz.state.relative_pose import RelativePoseConfig, joined_or_not

_LEAST = 1e-3
"""Every state has this probability at least, and every pose is wrong and right with it."""
_NEVER = 1e-9
"""Nor does a base that was not seen for thousands of frames become impossible where it was."""


class _Claim(NamedTuple):
    """A place of the base."""

    base: PoseEstimate
    value: float
    """Log probability."""
    support: float
    """Log odds of the likeliest state to nothing being joined, by the other parts."""


class BaseVotes:
    """Tells the base's place in one sequence."""

    def __init__(
        self,
        group: GroupPoses,
        *,
        places: RelativePoseConfig,
        config: BaseVotesConfig,
    ) -> None:
        """Keep what the parts' poses are compared with.

        Args:
            group: of the base and what it carries.
            places: how near to its place a joined part's pose is.
            config: when the base's own pose is not believed.
        """
        self._assembly, self._joints = group.assembly, group.places
        self._places, self._config = places, config
        self._shape = group.shapes[group.assembly.base]
        self._one_place = OnePlace(group.assembly)
        self._last: PoseEstimate | None = None
        self._still = 1.0
        """Probability that the base is still there, if nothing else is known since it was seen there."""
        self._told: PoseEstimate | None = None
        self._is_backed = True
        """Whether it was told of the last frame by what was seen in it."""
        self._is_hidden = False
        self.overruled = False
        """Whether what was taken for the base in the last frame is something else."""

    def told(
        self, poses: Mapping[str, PoseEstimate], belief: Scores | None, frame: Frame
    ) -> dict[str, PoseEstimate]:
        """The poses, the base's where it most probably is.

        Args:
            poses: of the parts, each by itself.
            belief: in the states before this frame, None where there is none yet.
            frame: with depth, or the base may always be where it was.
        """
        self._told, self._is_backed, self.overruled, self._is_hidden = None, True, False, False
        name, config = self._assembly.base, self._config
        if belief is None or not config.enabled:
            return dict(poses)
        own, others = poses.get(name), {n: pose for n, pose in poses.items() if n != name}
        odds, right = np.maximum(belief, _LEAST), self._own_right(own, poses)
        wrong = math.log(1.0 - right)
        claims, is_gone = list[_Claim](), False
        if self._last is not None:
            is_gone = self._is_gone(self._last.T_camera_part, frame)
            self._still *= 1.0 - (config.leap_gone if is_gone else config.leap)
            claims.append(self._claim(self._last, others, odds, wrong))
        if own is not None:
            claims.append(self._claim(own, others, odds, config.lead + math.log(right)))
        for base, prior, rest, joining in self._by_parts(others, odds):
            claim = self._claim(base, rest, joining, wrong + prior)
            if claim.support >= config.support or self._is_at_last(base):
                claims.append(claim)
        if not claims:
            return dict(poses)
        best = max(claims, key=lambda one: one.value).base
        near = [
            (one, self._fit(one.base, frame)) for one in claims if self._are_near(one.base, best)
        ]
        told, found = max(near, key=lambda one: one[0].value + self._worth(*one))
        self._told = told.base
        self.overruled = own is not None and not self._are_near(own, told.base)
        if told.base is not self._last:
            return {**others, name: told.base}
        is_shown = not is_gone and found is not None and found.visible >= config.visible
        self._is_hidden = not is_shown
        self._is_backed = is_shown or told.support > 0
        if not is_shown and told.support < config.support:
            return others
        return {**others, name: replace(told.base, stage="group")}

    @property
    def place(self) -> Transform | None:
        """Where the base was told to be in this frame, also where it is too hidden to be told so."""
        return None if self._told is None else self._told.T_camera_part

    @property
    def may_be(self) -> Callable[[Transform], bool] | None:
        """Whether the base may be there, by what was told of this frame; None: nothing was."""
        if self._told is None:
            return None
        return partial(self._is_near, self._told.T_camera_part)

    @property
    def hidden(self) -> PoseEstimate | None:
        """The base where it was told to be though it is hidden; None where it is in sight, or unknown."""
        return self._told if self._is_hidden else None

    def preferred(
        self, poses: Mapping[str, PoseEstimate], told: PoseEstimate | None, *, least: float
    ) -> dict[str, PoseEstimate]:
        """The poses, the base's own only near where it was told to be.

        Args:
            poses: of the parts in the same frame, settled.
            told: what `told` made of the base's pose; taken where it is by others and its own is not sure.
            least: score from which that is sure.
        """
        name, may_be = self._assembly.base, self.may_be
        own, result = poses.get(name), dict(poses)
        if own is not None and may_be is not None and not may_be(own.T_camera_part):
            own = None
            del result[name]
        if (own is None or own.score < least) and told is not None and told.stage == "group":
            result[name] = told
        return result

    def mended(self, T_camera_base: Transform) -> None:
        """What was told of this frame is the base, but in this pose: it was taken for turned otherwise."""
        if self._told is not None:
            self._told = replace(self._told, T_camera_part=T_camera_base)

    def _is_at_last(self, base: PoseEstimate) -> bool:
        return self._last is not None and self._are_near(base, self._last)

    def _are_near(self, a: PoseEstimate, b: PoseEstimate) -> bool:
        return self._is_near(a.T_camera_part, b.T_camera_part)

    def _fit(self, base: PoseEstimate, frame: Frame) -> DepthFit | None:
        return shape_fit(base.T_camera_part, self._shape, frame, margin=self._config.margin)

    def _worth(self, claim: _Claim, found: DepthFit | None) -> float:
        """What agreement with depth is worth, log odds; where it was and is hidden there is none to find."""
        config = self._config
        seen = 0.0 if found is None else min(found.visible / config.visible, 1.0)
        stays = config.stays * (1.0 - seen) if claim.base is self._last else 0.0
        return stays + (0.0 if found is None else config.fit * found.share)

    def rename(self, names: Mapping[str, str]) -> None:
        """Twins go by other names from now on: what was called the base is forgotten if it is none."""
        if names.get(self._assembly.base, self._assembly.base) != self._assembly.base:
            self._last, self._told, self._still = None, None, 1.0

    def keep(self, base: PoseEstimate | None) -> None:
        """Remember where the base turned out to be in this frame."""
        may_be = self.may_be
        if base is None or (may_be is not None and not may_be(base.T_camera_part)):
            base = self._told
        if base is not None:
            self._last, self._still = base, 1.0 if self._is_backed else self._still

    def _is_gone(self, T_camera_base: Transform, frame: Frame) -> bool:
        if frame.depth is None:
            return False
        gaps = depth_gaps(apply(T_camera_base, self._shape.surface), frame.depth, frame.camera.K)
        through = np.count_nonzero(gaps > self._config.see_through)
        return bool(through >= self._config.gone * len(self._shape.surface))

    def _own_right(self, own: PoseEstimate | None, poses: Mapping[str, PoseEstimate]) -> float:
        """The probability that the base's own pose is its place."""
        if own is None:
            return _LEAST
        right = self._places.in_place.probability(own.score)
        Ts = {n: pose.T_camera_part for n, pose in poses.items()}
        if own.part in self._one_place.intruders(Ts, {n: p.score for n, p in poses.items()}):
            right *= self._config.shared
        return min(max(right, _LEAST), 1.0 - _LEAST)

    def _by_parts(
        self, others: Mapping[str, PoseEstimate], odds: Scores
    ) -> Iterator[tuple[PoseEstimate, float, Mapping[str, PoseEstimate], Scores]]:
        """Where parts say the base is: log prior, the poses that witness it, and states with their odds."""
        told = set[tuple[str, bytes]]()
        likely = [s for s in self._assembly.states if odds[s.index] >= self._config.least]
        for state, (part, pose) in product(likely, others.items()):
            alike = self._assembly.parts[part].symmetries
            if part not in state.T_base_part or alike.is_symmetric:
                continue
            T_base_part = self._joined_at(part, pose, state)
            if (part, T_base_part.tobytes()) in told:
                continue
            told.add((part, T_base_part.tobytes()))
            T_camera_base = pose.T_camera_part @ inverse(T_base_part)
            base = PoseEstimate(self._assembly.base, T_camera_base, pose.score, "group")
            right = max(self._places.in_place.probability(pose.score), _LEAST)
            rest = {n: p for n, p in others.items() if n != part}
            joins = np.array([part in s.T_base_part for s in self._assembly.states])
            yield base, math.log(right), rest, np.where(joins, odds, 0.0)

    def _joined_at(self, part: str, pose: PoseEstimate, state: State) -> Transform:
        """T_base_part where a state holds a part.

        Along its joint it tells nothing of the base: where it agrees with where that was, it lies in
        its joint as it lies there, not as it was seen last.
        """
        joint, near = state.joints.get(part), None
        if joint is not None and self._last is not None:
            T_base_part = inverse(self._last.T_camera_part) @ pose.T_camera_part
            near = self._joints.nearest(part, T_base_part, state.T_base_part[part], joint)
        return self._joints.last(part, state) if near is None else near

    def _claim(
        self, base: PoseEstimate, others: Mapping[str, PoseEstimate], odds: Scores, prior: float
    ) -> _Claim:
        """What a place of the base is worth.

        Args:
            base: there.
            others: parts that witness it.
            odds: of the states in which it may be there.
            prior: log probability of it, before they are asked and apart from where it was.
        """
        with np.errstate(divide="ignore"):
            log_odds = np.log(odds)
        support = 0.0
        told = joined_or_not({**others, base.part: base}, self._assembly, config=self._places)
        if told is not None:
            support = float(told[0][int(odds.argmax())]) - told[1]
            log_odds = log_odds + told[0]
        moved = self._moved(base.T_camera_part)
        return _Claim(base, prior + moved + float(np.logaddexp.reduce(log_odds)), support)

    def _moved(self, T_camera_base: Transform) -> float:
        """Log probability that the base is so far from where it was."""
        if self._last is None:
            return 0.0
        is_there = self._is_near(T_camera_base, self._last.T_camera_part)
        return math.log(max(self._still if is_there else 1.0 - self._still, _NEVER))

    def _is_near(self, T_a: Transform, T_b: Transform) -> bool:
        base = self._assembly.parts[self._assembly.base]
        off = deviation(T_a, T_b, center_part=base.middle, symmetries=base.symmetries)
        return off.within(self._config.apart, self._config.turned_deg)
