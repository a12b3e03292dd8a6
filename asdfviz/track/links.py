"""How one part hangs on another while both are tracked: fixed, or moving in a joint's range.

Joints of one link are geared together: they have one freedom in common, the share of their ranges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Joint
from asdfviz.geometry.shapes import Rotation, Scores, Transform, Vector
from asdfviz.geometry.symmetry import Symmetries, nearest_symmetric, symmetric_angle
from asdfviz.geometry.transforms import (
    limited_rotation,
    rotation_about,
    rotation_angle,
    transform_from,
    turns_freely,
)

NEARER = 1e-3
"""Another pose that looks the same is taken only where it comes nearer to a joint's range by this, radians."""


class Freedom(NamedTuple):
    """One number by which a joint moves."""

    screw: Float64[np.ndarray, 6]
    """Motion (rotation, translation) in the root's frame for a unit of it."""
    turn: float
    """Radians for a unit of it,"""
    slide: float
    """and metres."""
    shared: str = ""
    """Its link, if the number is the share of the ranges that all its joints have in common."""


@dataclass(slots=True, eq=False)
class Link:
    """A part at `T_root_member` = motion @ `T_nominal`; poses and joint are in the centres' frames."""

    member: int
    """Place in the tracker's list of parts."""
    T_nominal: Transform
    joint: Joint | None = None
    slide: float = 0.0
    """Travel so far, metres."""
    turn: float = 0.0
    """Turn so far, radians; not of a ball."""
    R_ball: Rotation = field(default_factory=lambda: np.eye(3))
    freedoms: list[Freedom] = field(init=False)
    """What the joint leaves free, turn before slide; nothing where it is fixed."""

    def __post_init__(self) -> None:
        self.freedoms = self._free()

    def _free(self) -> list[Freedom]:
        joint = self.joint
        if joint is None:
            return []
        if joint.kind == "ball":
            return [Freedom(_turn_about(axis, joint.origin), 1.0, 0.0) for axis in np.eye(3)]
        turn, slide = _turn_about(joint.axis, joint.origin), np.append(np.zeros(3), joint.axis)
        angle, way = self._geared
        found: list[Freedom] = []
        if self._turns and not angle:
            found.append(Freedom(turn, 1.0, 0.0))
        if self._slides and not way:
            found.append(Freedom(slide, 0.0, 1.0))
        if angle or way:
            found.append(Freedom(angle * turn + way * slide, angle, way, joint.link))
        return found

    def move(self, step: Scores) -> None:
        """Add a step of the joint's freedoms, in their order, held to its range."""
        joint = self.joint
        if joint is None:
            return
        if joint.kind == "ball":
            angle = float(np.linalg.norm(step))
            R = rotation_about(step, angle) @ self.R_ball if angle > 1e-9 else self.R_ball
            # Beyond the range the ball stays where it was rather than creep along the rim.
            if rotation_angle(R) <= _ball_limit(joint):
                self.R_ball = R
            return
        for freedom, by in zip(self.freedoms, step, strict=True):
            self.turn = float(np.clip(self.turn + by * freedom.turn, *joint.turn))
            self.slide = float(np.clip(self.slide + by * freedom.slide, *joint.slide))

    @property
    def share(self) -> float | None:
        """How far along its ranges a geared joint is, 0 to 1; None where it is not geared."""
        angle, way = self._geared
        if self.joint is None or not (angle or way):
            return None
        slid, turned = self.slide - self.joint.slide[0], self.turn - self.joint.turn[0]
        return slid / way if way else turned / angle

    @share.setter
    def share(self, share: float) -> None:
        angle, way = self._geared
        if self.joint is not None and angle:
            self.turn = self.joint.turn[0] + share * angle
        if self.joint is not None and way:
            self.slide = self.joint.slide[0] + share * way

    @property
    def T_root_member(self) -> Transform:
        """Where the part is now, in the root's frame."""
        joint = self.joint
        if joint is None:
            return self.T_nominal
        R = self.R_ball if joint.kind == "ball" else rotation_about(joint.axis, self.turn)
        T_motion = transform_from(R, joint.origin - R @ joint.origin + self.slide * joint.axis)
        return T_motion @ self.T_nominal

    def adopt(
        self,
        T_root_member: Transform,
        symmetries: Symmetries = Symmetries(),  # noqa: B008 - frozen
    ) -> None:
        """Set the joint to where an observed pose, or one that looks the same, comes nearest to its range.

        Args:
            T_root_member: observed.
            symmetries: of the part, in its centre's frame.
        """
        if self.joint is None:
            return
        self._adopt(T_root_member, self.joint)
        if not symmetries.is_symmetric:
            return
        best = self.turn, self.slide, self.R_ball
        least = symmetric_angle(self.T_root_member, T_root_member, symmetries)
        T_near = nearest_symmetric(T_root_member, self.T_nominal, symmetries)
        round_ = Symmetries(continuous=symmetries.continuous)
        for T_equal in (T_near, *(T_near @ S for S in symmetries.discrete)):
            self._adopt(T_equal, self.joint)
            off = symmetric_angle(self.T_root_member, T_equal, round_)
            if off < least - NEARER:
                best, least = (self.turn, self.slide, self.R_ball), off
        self.turn, self.slide, self.R_ball = best

    def _adopt(self, T_root_member: Transform, joint: Joint) -> None:
        R_motion = T_root_member[:3, :3] @ self.T_nominal[:3, :3].T
        if joint.kind == "ball":
            self.R_ball = limited_rotation(R_motion, joint.turn)
            return
        if self._turns:
            skew = R_motion - R_motion.T
            axial = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
            d = joint.axis
            twist = float(np.arctan2(d @ axial, np.trace(R_motion) - d @ R_motion @ d))
            turns = twist + 2 * np.pi * np.arange(-3, 4)
            held = np.clip(turns, *joint.turn)
            self.turn = float(held[np.abs(held - turns).argmin()])
        if self._slides:
            self.slide = 0.0
            travel = T_root_member[:3, 3] - self.T_root_member[:3, 3]
            self.slide = float(np.clip(travel @ joint.axis, *joint.slide))

    @property
    def _turns(self) -> bool:
        return self.joint is not None and self.joint.kind in ("revolute", "cylindrical")

    @property
    def _slides(self) -> bool:
        return self.joint is not None and self.joint.kind in ("prismatic", "cylindrical")

    @property
    def _geared(self) -> tuple[float, float]:
        """Turn and slide, radians and metres, for all of what the joint's link shares; 0 without."""
        joint = self.joint
        if joint is None or not joint.link:
            return 0.0, 0.0
        angle, way = _width(joint.turn), _width(joint.slide)
        is_told = self._turns and not turns_freely(joint.turn)
        return angle if is_told else 0.0, way if self._slides else 0.0


def gear(links: Sequence[Link]) -> None:
    """Set the joints of every link to one share of their ranges: what most of those that slide say.

    A turn tells it less well, as parts that look alike in several turns may be taken for each other;
    it counts where nothing slides.
    """
    told: dict[str, dict[bool, list[float]]] = {}
    for link in links:
        share, joint = link.share, link.joint
        if share is not None and joint is not None:
            slides = _width(joint.slide) > 0
            told.setdefault(joint.link, {True: [], False: []})[slides].append(share)
    for link in links:
        if link.joint is not None and link.joint.link in told:
            slid, turned = told[link.joint.link][True], told[link.joint.link][False]
            link.share = float(np.median(slid or turned))


def _width(range_: tuple[float, float]) -> float:
    return range_[1] - range_[0]


def _ball_limit(joint: Joint) -> float:
    return max(abs(joint.turn[0]), abs(joint.turn[1])) or np.pi


def _turn_about(axis: Vector, origin: Vector) -> Float64[np.ndarray, 6]:
    return np.concatenate([axis, np.cross(origin, axis)])
