"""Where and how a hand takes a part: a thumb and a fingertip on both sides of it, the palm outside.

A grip holds for a whole move: the hand is rigid to the part, so the grip has to do at the start and
at the goal, without going through the table or through what lies there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.hands import GRASPS, PINCHES, hand_mesh
from asdfviz.synth.layout import Outfit
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import Solid, depth
from asdfviz.synth.resting import sphere
from asdfviz.synth.ways import Body

BACK = 0.06
"""How far a hand draws back from a part before it goes elsewhere, metres."""
DEEPEST = 0.0025
"""Fingers press into what they hold by this much at most, metres."""
LOWEST = 0.001
"""Height over the table that hands keep, metres."""
_SPOTS, _ROLLS, _HAND_POINTS, _MEASURED = 100, 24, 900, 40
_LEAVING = (0.0, 0.25, 0.5, 1.0)
"""Shares of the way back at which a hand may not go through what is near."""
_TRIED, _MORE = 80, 160
"""Grips that are tried: the most comfortable ones, and if none of these does, so many of the rest."""


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
    out = -(T_world_hand[:3, :3] @ _mirrored(hand_mesh(grasp).entry, outfit))
    return moved(T_world_hand, way * out)


def find_grip(
    solid: Solid, holds: Sequence[Hold], shoulder: Vector, outfit: Outfit, rng: np.random.Generator
) -> Grip:
    """The most comfortable grip that does at every hold; the least bad one if none does.

    Args:
        solid: the part, its own frame.
        holds: where the part is grasped and let go.
        shoulder: where the arm comes from, world.
        outfit: the person's hand; its shape is chosen here.
        rng: chooses among equally good ones.
    """
    poses, grasps, fit = _candidates(_pinched(solid, rng), outfit)
    comfort = np.full(len(poses), np.inf)
    for hold in holds:
        R = hold.T_world_part[:3, :3] @ poses[:, :3, :3]
        t = poses[:, :3, 3] @ hold.T_world_part[:3, :3].T + hold.T_world_part[:3, 3]
        comfort = np.minimum(comfort, _comfort(R, t, grasps, shoulder, outfit))
    worth = fit + comfort + 0.05 * rng.random(len(poses))
    best: Grip | None = None
    order = np.argsort(-worth)
    rest = order[_TRIED : len(order) // 2]
    spread = rest[:: max(1, len(rest) // _MORE)]
    for k in np.concatenate([order[:_TRIED], spread]).tolist():
        limit = np.inf if best is None else best.badness
        bad = _badness(solid, int(grasps[k]), poses[k], holds, outfit, limit)
        if best is None or bad < best.badness:
            best = Grip(int(grasps[k]), poses[k], bad)
        if best.badness <= 0:
            break
    return best or Grip(PINCHES.start, np.eye(4), np.inf)


def _candidates(
    pairs: Sequence[tuple[Vector, Vector, float]], outfit: Outfit
) -> tuple[Float64[np.ndarray, "n 4 4"], Int64[np.ndarray, "n"], Float64[np.ndarray, "n"]]:
    """T_part_hand from all sides of each pinched spot, hand shapes, how well these fit (1 is best)."""
    poses: list[Float64[np.ndarray, "_ 4 4"]] = []
    grasps: list[int] = []
    worth: list[float] = []
    for middle, axis, width in pairs:
        grasp = _fitting(width, outfit)
        hand = hand_mesh(grasp)
        frame = _frame(_mirrored(hand.pinch, outfit), _mirrored(hand.entry, outfit))
        around = _around(middle, axis, frame)
        poses.append(around)
        grasps += [grasp] * len(around)
        worth += [1.0 - 60 * abs(width - hand.gap * outfit.size)] * len(around)
    return np.concatenate(poses), np.array(grasps), np.array(worth)


def _mirrored(v: Float64[np.ndarray, "*n 3"], outfit: Outfit) -> Float64[np.ndarray, "*n 3"]:
    """A vector or several of the right hand as the worn hand has them."""
    return v * [-1.0, 1.0, 1.0] if outfit.mirrored else v


def _fitting(width: float, outfit: Outfit) -> int:
    gaps = np.array([hand_mesh(g).gap for g in PINCHES]) * outfit.size
    # Soft fingertips give way a little, so a hand a bit too narrow is better than one too wide.
    return PINCHES[int(np.abs(gaps - (width - 0.001)).argmin())]


def _pinched(solid: Solid, rng: np.random.Generator) -> list[tuple[Vector, Vector, float]]:
    """Spots where a part is narrow: middle, axis across, width (part frame, metres)."""
    widest = max(hand_mesh(g).gap for g in PINCHES) * 1.05
    a, b, c = (solid.triangles[:, k] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(area, 1e-18)[:, None]
    picked = rng.choice(len(area), size=_SPOTS, p=area / area.sum())
    share = rng.random((2, _SPOTS, 1))
    share = np.where(share.sum(axis=0) > 1, 1 - share, share)
    spots = a[picked] + share[0] * (b - a)[picked] + share[1] * (c - a)[picked]
    found: list[tuple[Vector, Vector, float]] = []
    for spot, normal in zip(spots, normals[picked], strict=True):
        width, far = _opposite(spot, -normal, solid, normals)
        if 0.002 < width < widest and normals[far] @ normal < -0.75:
            found.append((spot - 0.5 * width * normal, normal, width))
    if found:
        return found
    size = solid.high - solid.low
    middle, narrow = solid.middle, int(size.argmin())
    return [(middle, np.eye(3)[narrow], float(size[narrow]))]


def _opposite(
    spot: Vector, inwards: Vector, solid: Solid, normals: Float64[np.ndarray, "f 3"]
) -> tuple[float, int]:
    """Thickness of the part behind a spot of its surface, and the triangle on the other side."""
    a, b, c = (solid.triangles[:, k] for k in range(3))
    down = normals @ inwards
    t = ((a - spot) * normals).sum(axis=1) / np.where(np.abs(down) < 1e-9, np.inf, down)
    hit = spot + t[:, None] * inwards
    ok = (down > 1e-9) & (t > 1e-4)
    for p, q in ((a, b), (b, c), (c, a)):
        ok &= (np.cross(q - p, hit - p) * normals).sum(axis=1) >= -1e-12
    t = np.where(ok, t, np.inf)
    return float(t.min()), int(t.argmin())


def _frame(pinch: Vector, entry: Vector) -> Float64[np.ndarray, "3 3"]:
    return np.stack([pinch, entry, np.cross(pinch, entry)], axis=1)


def _around(
    middle: Vector, axis: Vector, hand: Float64[np.ndarray, "3 3"]
) -> Float64[np.ndarray, "n 4 4"]:
    """Hands whose fingertips meet the axis, from all sides and both ways round."""
    side = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    side /= np.linalg.norm(side)
    angle = np.arange(_ROLLS)[:, None] * 2 * np.pi / _ROLLS
    entry = np.cos(angle) * side + np.sin(angle) * np.cross(axis, side)
    poses = np.tile(np.eye(4), (2 * _ROLLS, 1, 1))
    for start, sign in ((0, 1.0), (_ROLLS, -1.0)):
        pinch = np.broadcast_to(sign * axis, entry.shape)
        frames = np.stack([pinch, entry, np.cross(pinch, entry)], axis=2)
        poses[start : start + _ROLLS, :3, :3] = frames @ hand.T
    poses[:, :3, 3] = middle
    return poses


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
        arm = R[mine] @ _mirrored(np.array([0.0, -np.cos(wrist), np.sin(wrist)]), outfit)
        wish = shoulder - t[mine]
        straight = (arm * wish).sum(axis=1) / np.linalg.norm(wish, axis=1)
        outline = _mirrored(arm_outline(grasp), outfit)
        low = (R[mine, 2] @ outline.T * outfit.size).min(axis=1) + t[mine, 2] - LOWEST
        back_of_hand = np.minimum(R[mine, 2, 2], 0.6)
        worth[mine] = straight + 0.4 * back_of_hand + np.minimum(low, 0.0) * 100
    return worth


@cache
def arm_outline(grasp: int) -> Points:
    """The outermost points of a hand with its arm."""
    vertices = hand_mesh(grasp).mesh.vertices
    return vertices[np.unique((vertices @ sphere(60).T).argmax(axis=0))]


def _badness(
    solid: Solid,
    grasp: int,
    T_part_hand: Transform,
    holds: Sequence[Hold],
    outfit: Outfit,
    limit: float,
) -> float:
    """How far the hand goes through the part, the table and the others beyond what is allowed."""
    points = hand_points(grasp)
    bad = depth(apply(scaled(T_part_hand, outfit), points), solid, most=_MEASURED) - DEEPEST
    for share in (0.2, 0.45, 0.75):
        back = apply(scaled(backed(T_part_hand, outfit, grasp, share * BACK), outfit), points)
        bad = max(bad, depth(back, solid, most=_MEASURED) - DEEPEST)
    bad = max(bad, 0.0)
    for hold in holds:
        if bad >= limit:
            return bad
        T = hold.T_world_part @ T_part_hand
        for pose in (backed(T, outfit, grasp, share * BACK) for share in _LEAVING):
            world = apply(scaled(pose, outfit), points)
            arm = apply(scaled(pose, outfit), arm_outline(grasp))
            bad = max(bad, LOWEST - min(float(world[:, 2].min()), float(arm[:, 2].min())))
            for other in hold.others:
                if bad < limit:
                    inner = apply(inverse(other.T), world)
                    bad = max(bad, depth(inner, other.solid, most=_MEASURED) - DEEPEST)
    return bad


@cache
def hand_points(grasp: int) -> Points:
    """Some of a hand's surface, without the arm beyond the sleeve's reach."""
    hand = hand_mesh(grasp)
    near = hand.mesh.vertices[hand.along_arm < 0.16]
    return near[:: max(1, len(near) // _HAND_POINTS)]


def dressed(outfit: Outfit, grasp: int) -> Outfit:
    """The same person's hand in another shape."""
    return replace(outfit, grasp=grasp)
