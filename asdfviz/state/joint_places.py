"""Where joined parts are within the freedom of their joints: as last seen, or where they may be.

Parts whose joints are equal hang on one another and move as one (a screw, its handle and its cap);
joints of one link are all at the same share of their ranges. So one part that is seen tells of others
that are not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Joint, PoseEstimate, State
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import nearest_symmetric
from asdfviz.geometry.transforms import (
    apply_to_point,
    cross,
    inverse,
    point_distance,
    transform_from,
    turn_about,
    turns_freely,
)
from asdfviz.state.joints import nearest_in_joint, off_nominal, spread_of

_Key: TypeAlias = tuple[object, ...]
TURNS = 12
"""Turns that are tried where nothing tells how far a part is turned."""
PARALLEL = 0.999
"""Cosine from which two axes are parallel."""
ON_AXIS = 0.001
"""Distance up to which they are the same, metres."""
SLIDES = 5
"""Slides that are tried likewise."""
MOVED = 0.005
"""A part that is seen farther from where it was before, metres, may not have been seen well."""


@dataclass(frozen=True)
class JointPlacesConfig:
    """When a part's own pose counts as in its joint."""

    distance: float = 0.02
    """A pose farther from what the joint allows is not in it, metres."""
    angle_deg: float = 30.0
    """And one turned farther, degrees; symmetric poses count as the same."""


class JointPlaces:
    """What was seen of an assembly's joints; one for each sequence."""

    def __init__(self, assembly: Assembly, *, config: JointPlacesConfig | None = None) -> None:
        self._assembly = assembly
        self._config = config or JointPlacesConfig()
        self._seen: dict[_Key, Transform] = {}
        """By joint, the motion that was seen: T_base_part = motion @ the nominal one,"""
        self._settled: dict[_Key, Transform] = {}
        """and the one that agreed best with the picture, of those that were possible last."""
        self._fresh = set[_Key]()
        """Joints of which the last frame showed a part in its place."""
        self._travel: dict[str, float] = {}
        """By link, the share of its ranges at which its joints are."""
        self._reaches: dict[tuple[str, bytes, int], float] = {}
        """By part, its nominal place and joint, what `reach` found."""
        self._held = {
            (name, T.tobytes(), _key(state.joints[name])): (name, T, state.joints[name])
            for state in assembly.states
            for name, T in state.T_base_part.items()
            if name in state.joints
        }

    def copy(self) -> JointPlaces:
        """Another that has seen the same so far."""
        other = copy(self)
        other._seen, other._travel = dict(self._seen), dict(self._travel)
        other._settled = dict(self._settled)
        return other

    def see(self, T_camera_base: Transform, poses: Mapping[str, PoseEstimate]) -> None:
        """Remember the joints of the parts that are seen in them.

        Args:
            T_camera_base: where the base is.
            poses: of the parts, where they were found.
        """
        fresh = self._fresh = set[_Key]()
        for name, T_nominal, joint in self._held.values():
            own = poses.get(name)
            if own is None:
                continue
            key = _key(joint)
            T_own = inverse(T_camera_base) @ own.T_camera_part
            T_place = self.nearest(name, T_own, T_nominal, joint)
            if T_place is None:
                continue
            if key in fresh and self._is_round(name, T_nominal, joint):
                continue  # another part has told how far all of them are turned
            fresh.add(key)
            self._seen[key] = T_place @ inverse(T_nominal)
            low, high = joint.slide
            if joint.link and high > low:
                middle = self._assembly.parts[name].middle
                along = (
                    apply_to_point(T_place, middle) - apply_to_point(T_nominal, middle)
                ) @ joint.axis
                self._travel[joint.link] = float(np.clip((along - low) / (high - low), 0, 1))

    def nearest(
        self, name: str, T_base_part: Transform, T_nominal: Transform, joint: Joint
    ) -> Transform | None:
        """The place in a joint that is nearest to an observed pose; None where that is not in it."""
        part = self._assembly.parts[name]
        reach = self.reach(name, T_nominal, joint) + self._config.distance
        if point_distance(T_base_part, T_nominal, part.middle) > reach:
            return None
        off = off_nominal(T_base_part, part, T_nominal, joint)
        if not off.within(self._config.distance, self._config.angle_deg):
            return None
        known = self._seen.get(_key(joint))
        T_last = T_nominal if known is None else known @ T_nominal
        T_near = nearest_symmetric(T_base_part, T_last, part.symmetries)
        return nearest_in_joint(
            T_near, T_nominal, joint, center_part=part.middle, spread=spread_of(part)
        )

    def reach(self, name: str, T_nominal: Transform, joint: Joint | None) -> float:
        """How far a part's middle in the joint is from the nominal one at most, metres, whichever of
        its poses that look the same is told; without a joint, those alone."""
        key = (name, T_nominal.tobytes(), id(joint))
        known = self._reaches.get(key)
        if known is not None:
            return known
        part = self._assembly.parts[name]
        reach = 0.0 if joint is None else max(abs(joint.slide[0]), abs(joint.slide[1]))
        if joint is not None and joint.kind != "prismatic":
            arm = apply_to_point(T_nominal, part.middle) - joint.origin
            reach += 2 * float(np.linalg.norm(arm))
        swings = (point_distance(S, np.eye(4), part.middle) for S in part.symmetries.discrete)
        reach += max(swings, default=0.0)
        for axis in part.symmetries.continuous:
            reach += 2 * float(np.linalg.norm(np.cross(part.middle - axis.offset, axis.direction)))
        self._reaches[key] = reach
        return reach

    def last(self, name: str, state: State) -> Transform:
        """T_base_part where the part was last seen in its joint, or the state's own."""
        T_nominal, joint = state.T_base_part[name], state.joints.get(name)
        known = None if joint is None else self._seen.get(_key(joint))
        return T_nominal if known is None else known @ T_nominal

    def settle(self, names: Sequence[str], state: State, Ts_base_part: Sequence[Transform]) -> None:
        """Remember where parts that move as one turned out to be, of several places possible."""
        joint = state.joints.get(names[0])
        if joint is not None:
            motion = Ts_base_part[0] @ inverse(state.T_base_part[names[0]])
            self._settled[_key(joint)] = motion
            if _key(joint) in self._seen:
                self._seen[_key(joint)] = motion

    def together(self, state: State) -> list[tuple[str, ...]]:
        """The joined parts of a state, those that move as one together."""
        groups: dict[_Key, tuple[str, ...]] = {}
        for name in state.attached:
            joint = state.joints.get(name)
            key = (name,) if joint is None else _key(joint)
            groups[key] = (*groups.get(key, ()), name)
        return list(groups.values())

    def possible(self, names: Sequence[str], state: State) -> list[list[Transform]]:
        """Where parts that move as one may be: one place each, or several where not all is known.

        A turn that was seen is only one of several: a round bar that was taken for turned otherwise
        is in its joint as well. What was seen far from where it was before may still be there, and what
        slides may be anywhere once it is seen no more: a hand pushed it on when it saw it last.

        Args:
            names: of the parts, as `together` gives them.
            state: that joins them.

        Returns:
            Alternatives, the first as last seen if that is known; in each T_base_part of every part.
        """
        joint = state.joints.get(names[0])
        nominal = [state.T_base_part[name] for name in names]
        if joint is None:
            return [nominal]
        known = self._seen.get(_key(joint))
        before = self._before(names[0], state, joint)
        if joint.kind == "ball":
            motions = [np.eye(4) if known is None else known, *before]
            return [[T_motion @ T for T in nominal] for T_motion in motions]
        are_round = all(
            self._is_round(name, T, joint) for name, T in zip(names, nominal, strict=True)
        )
        motions = self._unseen(joint) if known is None else [known]
        if known is not None and _turns_freely(joint) and not are_round:
            motions += [_turn(joint, angle) @ known for angle in _angles()[1:]]
        if known is not None and _key(joint) not in self._fresh and joint.slide[0] < joint.slide[1]:
            motions += self._unseen(joint)  # it may have been pushed on since
        motions += before
        return [[T_motion @ T for T in nominal] for T_motion in motions]

    def _before(self, name: str, state: State, joint: Joint) -> list[Transform]:
        """The motion that agreed best before, where a part was seen elsewhere since."""
        known, before = (motions.get(_key(joint)) for motions in (self._seen, self._settled))
        if known is None or before is None:
            return []
        T_nominal, middle = state.T_base_part[name], self._assembly.parts[name].middle
        is_far = point_distance(known @ T_nominal, before @ T_nominal, middle) > MOVED
        return [before] if is_far else []

    def _is_round(self, name: str, T_nominal: Transform, joint: Joint) -> bool:
        """Whether the part looks the same however it is turned in the joint."""
        symmetries = self._assembly.parts[name].symmetries
        ball = symmetries.ball_middle
        if ball is not None:
            arm = apply_to_point(T_nominal, ball) - joint.origin
            return math.hypot(*cross(arm, joint.axis).tolist()) < ON_AXIS
        for axis in symmetries.continuous:
            direction = T_nominal[:3, :3] @ axis.direction
            middle = apply_to_point(T_nominal, axis.offset)
            beside = math.hypot(*cross(middle - joint.origin, joint.axis).tolist())
            along = abs(float(direction @ joint.axis))
            if along > PARALLEL * math.hypot(*direction.tolist()) and beside < ON_AXIS:
                return True
        return False

    def _unseen(self, joint: Joint) -> list[Transform]:
        """Motions of a joint of which nothing was seen but, perhaps, its link."""
        travel = self._travel.get(joint.link) if joint.link else None
        shares = np.linspace(0.1, 0.9, SLIDES) if travel is None else np.array([travel])
        if joint.slide == (0.0, 0.0) and travel is None:
            shares = shares[:1]
        found: list[Transform] = []
        for share in shares:
            slide = joint.slide[0] + share * (joint.slide[1] - joint.slide[0])
            T_slide = transform_from(np.eye(3), slide * joint.axis)
            if not _turns_freely(joint):
                angle = joint.turn[0] + share * (joint.turn[1] - joint.turn[0])
                found.append(T_slide @ _turn(joint, angle if travel is not None else 0.0))
            elif travel is None:
                found.append(T_slide)
            else:
                found += [T_slide @ _turn(joint, angle) for angle in _angles()]
        return found


def _turns_freely(joint: Joint) -> bool:
    return joint.kind in ("revolute", "cylindrical") and turns_freely(joint.turn)


def _turn(joint: Joint, angle: float) -> Transform:
    return turn_about(joint.axis, joint.origin, angle)


def _angles() -> list[float]:
    return [2 * np.pi * i / TURNS for i in range(TURNS)]


def _key(joint: Joint) -> _Key:
    """Equal for joints that move as one."""
    where = (joint.axis.tobytes(), joint.origin.tobytes())
    return (joint.kind, *where, joint.slide, joint.turn, joint.link)
