"""Paths of parts and hands: rests, lifts, carries, insertions, as poses frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast hands and parts may move between two frames."""

    step: float = 0.024
    """Metres a frame."""
    turn: float = 0.2
    """Radians a frame (12 degrees)."""
    reach: float = 0.085
    """Metres a frame of an empty hand."""


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


def carry(
    start: Transform,
    goal: Transform,
    *,
    leave: Vector,
    arrive: Vector,
    clear: float,
    pace: Pace,
    stretch: float = 1.0,
) -> list[Transform]:
    """World poses of a carried part, one a frame, the last one being the goal.

    The part leaves its place along `leave`, rises to `clear` while it crosses over and turns, sinks and comes home along `arrive`.

    Args:
        start: pose at which it lies.
        goal: pose to reach.
        leave: way out of the start, metres (world).
        arrive: way from the goal outwards, metres (world).
        clear: height of the part's origin over the goal, metres.
        pace: limits.
        stretch: factor on the number of frames.
    """
    out, home = start.copy(), goal.copy()
    out[:3, 3] += leave
    home[:3, 3] += arrive
    above_goal = home.copy()
    above_goal[2, 3] = max(clear, home[2, 3])
    stops = [start, out, above_goal, home, goal]
    costs = [
        max(
            float(np.linalg.norm(b[:3, 3] - a[:3, 3])) / pace.step,
            rotation_angle(a[:3, :3].T @ b[:3, :3]) / pace.turn,
        )
        for a, b in pairwise(stops)
    ]
    ends = np.concatenate([[0.0], np.cumsum(costs)])
    # An eased start and end is faster in the middle by a tenth, which the count makes up for.
    count = max(3, int(np.ceil(ends[-1] * 1.12 * stretch)))
    shares = np.arange(1, count + 1) / count
    eased = shares - 0.1 / (2 * np.pi) * np.sin(2 * np.pi * shares)
    path: list[Transform] = []
    times: list[float] = (eased * ends[-1]).tolist()
    for time in times:
        leg = int(np.clip(np.searchsorted(ends, time, side="right") - 1, 0, len(costs) - 1))
        share = (time - ends[leg]) / max(costs[leg], 1e-9)
        path.append(blend(stops[leg], stops[leg + 1], float(np.clip(share, 0, 1))))
    path[-1] = goal
    return path


def reach(start: Vector, goal: Vector, *, pace: Pace, stretch: float = 1.0) -> list[Vector]:
    """Points of an empty hand's way, in a flat arc, the last one being the goal."""
    length = float(np.linalg.norm(goal - start))
    count = max(2, int(np.ceil(length / pace.reach * stretch)))
    points: list[Vector] = []
    for share in np.arange(1, count + 1) / count:
        eased = share * share * (3 - 2 * share)
        lift = 0.05 * np.sin(np.pi * eased) * min(1.0, length / 0.2)
        points.append((1 - eased) * start + eased * goal + np.array([0.0, 0.0, lift]))
    return points


def slide(
    start: Transform, shift: Vector, turn: float, *, pace: Pace, stretch: float = 1.0
) -> list[Transform]:
    """A thing pushed over the table: shifted and turned about the vertical through its own origin."""
    R = rotation_about(np.array([0.0, 0.0, 1.0]), turn)
    goal = transform_from(R @ start[:3, :3], start[:3, 3] + shift)
    cost = max(float(np.linalg.norm(shift)) / pace.step, abs(turn) / pace.turn)
    count = max(2, int(np.ceil(cost * 1.12 * stretch)))
    return [blend(start, goal, k / count) for k in range(1, count + 1)]
