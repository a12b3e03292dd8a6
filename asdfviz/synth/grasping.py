"""Where and how a hand takes a part: a thumb and a fingertip on both sides of it, the palm outside.

A grip holds for a whole move: the hand is rigid to the part, so the grip has to do at the start and
at the goal, without going through the table or through what lies there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.pose.resting import sphere
from asdfviz.synth.assets import Cloud
from asdfviz.synth.hands import GRASPS, hand_mesh
from asdfviz.synth.layout import Outfit
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import Solid, depth, out_of_reach
from asdfviz.synth.pinching import pinches
from asdfviz.synth.ways import Body

BACK = 0.06
"""How far a hand draws back from a part before it goes elsewhere, metres."""
DEEPEST = 0.0025
"""Fingers press into what they hold by this much at most, metres."""
LOWEST = 0.001
"""Height over the table that hands keep, metres."""
_HAND_POINTS, _MEASURED = 900, 120
_LOOSENING = (0.0, 0.2, 0.45, 0.75)
"""Shares of the way back at which a hand may not go through what it held."""
_SHARES = (0.0, 0.25, 0.5, 1.0)
"""Shares of the way back at which a hand may not go through what is near."""
_FEW = 7
"""Every so manieth point is looked at first."""
_TRIED, _MORE = 80, 160
"""Grips that are tried: the most comfortable ones, and if none of these does, so many of the rest."""


Worth: TypeAlias = Callable[
    [Float64[np.ndarray, "n 4 4"], Int64[np.ndarray, "n"]], Float64[np.ndarray, "n"]
]
"""Of hands T_part_hand with their shapes."""


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """A hand on a part."""

    grasp: int
    """Index into GRASPS."""
    T_part_hand: Transform
    """Rigid: size and side of the hand come on top (`Outfit` scales it)."""
    badness: float
    """How far the hand goes through parts or the table beyond what is allowed, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """A moment at which a grip has to do."""

    T_world_part: Transform
    others: tuple[Body, ...]
    """What is near, world."""


def scaled(T_world_hand: Transform, outfit: Outfit) -> Transform:
    """The pose of a hand's mesh: mirrored for a left hand, and of the person's size."""
    side = -1.0 if outfit.mirrored else 1.0
    return T_world_hand @ np.diag([side * outfit.size, outfit.size, outfit.size, 1.0])


def backed(T_world_hand: Transform, outfit: Outfit, grasp: int, way: float = BACK) -> Transform:
    """The hand drawn back along its fingers, off what it holds."""
    out = -(T_world_hand[:3, :3] @ outfit.worn(hand_mesh(grasp).entry))
    return moved(T_world_hand, way * out)


def find_grip(
    solid: Solid, holds: Sequence[Hold], shoulder: Vector, outfit: Outfit,
    rng: np.random.Generator, *, limit: float = np.inf, also: Worth | None = None,
) -> Grip | None:  # fmt: skip
    """The most comfortable grip that does at every hold; the least bad one if none does.

    Args:
        solid: the part, its own frame.
        holds: where the part is grasped and let go.
        shoulder: where the arm comes from, world.
        outfit: the person's hand; its shape is chosen here.
        rng: chooses among equally good ones.
        limit: None is found where every grip is as bad as this, metres.
        also: what makes a grip good besides comfort, which is about 1 at best.
    """
    poses, grasps, fit = pinches(solid, outfit, rng)
    comfort = np.full(len(poses), np.inf)
    for hold in holds:
        R = hold.T_world_part[:3, :3] @ poses[:, :3, :3]
        t = poses[:, :3, 3] @ hold.T_world_part[:3, :3].T + hold.T_world_part[:3, 3]
        comfort = np.minimum(comfort, _comfort(R, t, grasps, shoulder, outfit))
    worth = fit + comfort + 0.05 * rng.random(len(poses))
    if also is not None:
        worth += also(poses, grasps)
    best: Grip | None = None
    hands = {grasp: _Leaving.of(grasp, outfit) for grasp in sorted({int(g) for g in grasps})}
    order = np.argsort(-worth)
    rest = order[_TRIED : len(order) // 2]
    spread = rest[:: max(1, len(rest) // _MORE)]
    for k in np.concatenate([order[:_TRIED], spread]).tolist():
        bad = _badness(solid, hands[int(grasps[k])], poses[k], holds, limit)
        if bad < limit:
            best, limit = Grip(int(grasps[k]), poses[k], bad), bad
        if limit <= 0:
            break
    return best


def _comfort(
    R: Float64[np.ndarray, "n 3 3"],
    t: Float64[np.ndarray, "n 3"],
    grasps: Int64[np.ndarray, "n"],
    shoulder: Vector,
    outfit: Outfit,
) -> Float64[np.ndarray, "n"]:
    """About 1 for an arm that comes straight from the shoulder; far less for one under the table."""
    worth = np.empty(len(R))
    for grasp in sorted({int(g) for g in grasps}):
        mine = np.nonzero(grasps == grasp)[0]
        wrist = GRASPS[grasp].wrist
        arm = R[mine] @ outfit.worn(np.array([0.0, -np.cos(wrist), np.sin(wrist)]))
        wish = shoulder - t[mine]
        straight = (arm * wish).sum(axis=1) / np.linalg.norm(wish, axis=1)
        outline = outfit.worn(arm_outline(grasp))
        low = (R[mine, 2] @ outline.T * outfit.size).min(axis=1) + t[mine, 2] - LOWEST
        back_of_hand = np.minimum(R[mine, 2, 2], 0.6)
        worth[mine] = straight + 0.4 * back_of_hand + np.minimum(low, 0.0) * 100
    return worth


@cache
def arm_outline(grasp: int) -> Points:
    """The outermost points of a hand with its arm."""
    vertices = hand_mesh(grasp).mesh.vertices
    return vertices[np.unique((vertices @ sphere(60).T).argmax(axis=0))]


@dataclass(frozen=True, slots=True, eq=False)
class _Leaving:
    """A hand at several places as it draws back from what it holds, rigid hand frame."""

    off: Cloud
    """Some of its surface while it still loosens."""
    away: Cloud
    """The same on its way off, as far as others may be met."""
    outline: Cloud
    """The outermost points of hand and arm, there too."""

    @classmethod
    def of(cls, grasp: int, outfit: Outfit) -> _Leaving:
        """Of a hand's shape and size."""

        def at(points: Points, shares: Sequence[float]) -> Cloud:
            poses = [backed(np.eye(4), outfit, grasp, share * BACK) for share in shares]
            return np.concatenate([apply(scaled(T, outfit), points) for T in poses])

        points = hand_points(grasp)
        return cls(at(points, _LOOSENING), at(points, _SHARES), at(arm_outline(grasp), _SHARES))


def _badness(
    solid: Solid, hand: _Leaving, T_part_hand: Transform, holds: Sequence[Hold], limit: float
) -> float:
    """How far the hand goes through the part, the table and the others beyond what is allowed."""
    bad = 0.0
    for step in (_FEW, 1):  # few points tell most of the bad ones
        if bad < limit:
            off = apply(T_part_hand, hand.off[::step])
            bad = max(0.0, _too_deep(off, solid, 0.0, limit))
            bad = _in_others(hand, T_part_hand, holds, limit, bad, step)
    return bad


def _in_others(
    hand: _Leaving,
    T_part_hand: Transform,
    holds: Sequence[Hold],
    limit: float,
    bad: float,
    step: int,
) -> float:
    away = hand.away[::step]
    middle = (away.min(axis=0) + away.max(axis=0))[None] / 2
    radius = np.linalg.norm(away - middle, axis=1).max(keepdims=True)
    for hold in holds:
        T = hold.T_world_part @ T_part_hand
        low = min(float((p @ T[2, :3]).min()) for p in (away, hand.outline)) + float(T[2, 3])
        bad = max(bad, LOWEST - low)
        for other in hold.others:
            if bad >= limit:
                return bad
            T_other_hand = inverse(other.T) @ T
            if not out_of_reach(apply(T_other_hand, middle), radius, other.solid)[0]:
                inner = apply(T_other_hand, away)
                bad = max(bad, _too_deep(inner, other.solid, bad, limit))
    return bad


def _too_deep(points: Points, solid: Solid, bad: float, limit: float) -> float:
    """Depth beyond what is allowed, metres, exact where it is between what is bad already and the limit."""
    least, enough = DEEPEST + bad, DEEPEST + limit
    return depth(points, solid, most=_MEASURED, least=least, enough=enough) - DEEPEST


@cache
def hand_points(grasp: int) -> Points:
    """Some of a hand's surface, without the arm beyond the sleeve's reach."""
    hand = hand_mesh(grasp)
    near = hand.mesh.vertices[hand.along_arm < 0.16]
    return near[:: max(1, len(near) // _HAND_POINTS)]


def dressed(outfit: Outfit, grasp: int) -> Outfit:
    """The same person's hand in another shape."""
    return replace(outfit, grasp=grasp)
