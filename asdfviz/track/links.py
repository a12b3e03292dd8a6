"""How one part hangs on another while both are tracked: fixed, or moving in a joint's range."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Joint
from asdfviz.geometry.shapes import Rotation, Scores, Transform, Vector
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from


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

    @property
    def freedoms(self) -> int:
        """Numbers that the joint has: 0 where it is fixed."""
        kinds = {"prismatic": 1, "revolute": 1, "cylindrical": 2, "ball": 3}
        return 0 if self.joint is None else kinds[self.joint.kind]

    def screws(self) -> list[Float64[np.ndarray, 6]]:
        """Unit motions (rotation, translation) in the root's frame, turn before slide."""
        joint = self.joint
        if joint is None:
            return []
        if joint.kind == "ball":
            return [_turn_about(axis, joint.origin) for axis in np.eye(3)]
        found: list[np.ndarray] = []
        if joint.kind in ("revolute", "cylindrical"):
            found.append(_turn_about(joint.axis, joint.origin))
        if joint.kind in ("prismatic", "cylindrical"):
            found.append(np.concatenate([np.zeros(3), joint.axis]))
        return found

    def move(self, step: Scores) -> None:
        """Add a step of the joint's freedoms, in the order of `screws`, held to its range."""
        joint = self.joint
        if joint is None:
            return
        if joint.kind == "ball":
            angle = float(np.linalg.norm(step))
            R = rotation_about(step, angle) @ self.R_ball if angle > 1e-9 else self.R_ball
            limit = max(abs(joint.turn[0]), abs(joint.turn[1])) or np.pi
            # Beyond the range the ball stays where it was rather than creep along the rim.
            if rotation_angle(R) <= limit:
                self.R_ball = R
            return
        if joint.kind in ("revolute", "cylindrical"):
            self.turn = float(np.clip(self.turn + step[0], *joint.turn))
        if joint.kind in ("prismatic", "cylindrical"):
            self.slide = float(np.clip(self.slide + step[-1], *joint.slide))

    @property
    def T_root_member(self) -> Transform:
        """Where the part is now, in the root's frame."""
        joint = self.joint
        if joint is None:
            return self.T_nominal
        R = self.R_ball if joint.kind == "ball" else rotation_about(joint.axis, self.turn)
        T_motion = transform_from(R, joint.origin - R @ joint.origin + self.slide * joint.axis)
        return T_motion @ self.T_nominal

    def adopt(self, T_root_member: Transform) -> None:
        """Set the joint to where an observed pose comes nearest to its range."""
        joint = self.joint
        if joint is None:
            return
        R_motion = T_root_member[:3, :3] @ self.T_nominal[:3, :3].T
        if joint.kind == "ball":
            limit = max(abs(joint.turn[0]), abs(joint.turn[1])) or np.pi
            self.R_ball = R_motion if rotation_angle(R_motion) <= limit else np.eye(3)
            return
        if joint.kind in ("revolute", "cylindrical"):
            skew = R_motion - R_motion.T
            axial = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
            d = joint.axis
            twist = float(np.arctan2(d @ axial, np.trace(R_motion) - d @ R_motion @ d))
            turns = twist + 2 * np.pi * np.arange(-3, 4)
            held = np.clip(turns, *joint.turn)
            self.turn = float(held[np.abs(held - turns).argmin()])
        if joint.kind in ("prismatic", "cylindrical"):
            self.slide = 0.0
            travel = T_root_member[:3, 3] - self.T_root_member[:3, 3]
            self.slide = float(np.clip(travel @ joint.axis, *joint.slide))


def _turn_about(axis: Vector, origin: Vector) -> Float64[np.ndarray, 6]:
    return np.concatenate([axis, np.cross(origin, axis)])
