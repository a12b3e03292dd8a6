"""Paths of parts and hands: how fast they may be, and poses along a route frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from

_EASE = 1.12
"""An eased start and end is faster in the middle by a tenth, which more frames make up for."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The farthest that something moves between two frames."""

    step: float
    """Metres."""
    turn: float
    """Radians."""

    def cost(self, T_a: Transform, T_b: Transform) -> float:
        """Frames that the way between two poses takes."""
        length = float(np.linalg.norm(T_b[:3, 3] - T_a[:3, 3]))
        return max(length / self.step, rotation_angle(T_a[:3, :3].T @ T_b[:3, :3]) / self.turn)

    def halved(self) -> Limits:
        """Half as fast."""
        return Limits(self.step / 2, self.turn / 2)


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast hands and parts move, and how much of it one frame may see."""

    speed: float = 0.25
    """Of carried parts, metres a second."""
    turn: float = 2.0
    """Of carried parts, radians a second."""
    hand_speed: float = 0.85
    """Of empty hands, metres a second."""
    step: float = 0.025
    """Of carried parts, metres a frame at most: at low rates people work slower."""
    frame_turn: float = 0.2
    """Of carried parts, radians a frame at most (12 degrees)."""
    hand_step: float = 0.085
    """Of empty hands, metres a frame at most."""

    def parts(self, fps: float) -> Limits:
        """Limits of carried parts at a frame rate (1/s)."""
        return Limits(min(self.speed / fps, self.step), min(self.turn / fps, self.frame_turn))

    def hands(self, fps: float) -> Limits:
        """Limits of empty hands at a frame rate (1/s)."""
        return Limits(min(self.hand_speed / fps, self.hand_step), min(8.0 / fps, 0.9))


def blend(T_a: Transform, T_b: Transform, share: float) -> Transform:
    """The pose between two poses: straight translation, shortest rotation."""
    R = T_a[:3, :3].T @ T_b[:3, :3]
    angle = rotation_angle(R)
    t = (1 - share) * T_a[:3, 3] + share * T_b[:3, 3]
    if angle < 1e-9:
        return transform_from(T_a[:3, :3].copy(), t)
    return transform_from(T_a[:3, :3] @ rotation_about(_axis(R, angle), angle * share), t)


def _axis(R: Float64[np.ndarray, "3 3"], angle: float) -> Vector:
    if angle < np.pi - 1e-4:
        return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    # Half a turn: the axis is the eigenvector of eigenvalue 1, read off R + I.
    columns = R + np.eye(3)
    return columns[:, int(np.linalg.norm(columns, axis=0).argmax())]


def frames_needed(stops: Sequence[Transform], limits: Limits) -> int:
    """The least number of frames in which a route can be travelled."""
    cost = sum(limits.cost(a, b) for a, b in pairwise(stops))
    return max(1, int(np.ceil(cost * _EASE)))


def travel(stops: Sequence[Transform], limits: Limits, *, count: int) -> list[Transform]:
    """World poses along a route, one a frame, eased at both ends; the last one is the last stop.

    Args:
        stops: where the route begins, bends and ends; the first one is not repeated.
        limits: weigh turning against moving.
        count: frames.
    """
    costs = [limits.cost(a, b) for a, b in pairwise(stops)]
    ends = np.concatenate([[0.0], np.cumsum(costs)])
    shares = np.arange(1, count + 1) / count
    eased = shares - 0.1 / (2 * np.pi) * np.sin(2 * np.pi * shares)
    path: list[Transform] = []
    times: list[float] = (eased * ends[-1]).tolist()
    for time in times:
        leg = int(np.clip(np.searchsorted(ends, time, side="right") - 1, 0, len(costs) - 1))
        share = (time - ends[leg]) / max(costs[leg], 1e-9)
        path.append(blend(stops[leg], stops[leg + 1], float(np.clip(share, 0, 1))))
    path[-1] = stops[-1].copy()
    return path


def moved(T: Transform, shift: Vector) -> Transform:
    """The pose shifted in the world."""
    return transform_from(T[:3, :3], T[:3, 3] + shift)
