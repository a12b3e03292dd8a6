"""What would stand in a part for a moment: hands give way by millimetres, parts pass between two frames.

A grip is chosen for the ends of a move and some places between them; a hand may still brush a part on
its way. An empty one gives way as far as it has to; one that holds something slips along it a little.
A clip goes over a neck that is wider than the clip: it bends, which rigid meshes cannot. It does so at
once, between two frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import backed, scaled
from asdfviz.synth.hands import hand_mesh
from asdfviz.synth.layout import Outfit
from asdfviz.synth.motion import blend, moved
from asdfviz.synth.penetration import Solid, depth, out_of_reach
from asdfviz.synth.ways import Body, is_free

ALLOWED = 0.0042
"""Soft fingers give way by this much, metres."""
_STEPS = tuple(k / 1000 for k in range(1, 11))
"""How far an empty hand goes at most, and by what steps, metres."""
_SLIP = 5
"""So many of these steps fingers slip on what they hold: they still touch it."""
_LAST, _TOO_DEEP = 3, 0.0048
"""In so many moments before it is let go they may slip once more, as on a short pin that is pushed home,
where they would be deeper than this, metres."""
_PATCH = 0.03
"""Side of the cells that cut a hand's surface into patches, metres."""

SNAPPED = 0.0008
"""Parts stand in one another by this much at most while one moves, metres, where that can be."""
_SHARES = tuple(k / 10 for k in range(1, 10))


def snapped(
    moments: Sequence[Moment], solids: Mapping[str, Solid], *, step: float
) -> tuple[Moment, ...]:
    """The moments with what is carried a little earlier or later where it would stand in a part.

    Args:
        moments: the frames of a script.
        solids: of all parts.
        step: what is carried moves no farther than this from frame to frame, metres.
    """
    passed = list(moments)
    for k in range(1, len(moments) - 1):
        now, name = moments[k], moments[k].held
        if name is None or name in now.attached:
            continue
        T = now.T_world_part[name]
        others = [Body(solids[n], T_n) for n, T_n in now.T_world_part.items() if n != name]
        if is_free(Body(solids[name], T), others, SNAPPED):
            continue
        ends = passed[k - 1].T_world_part[name], moments[k + 1].T_world_part[name]
        for way in (blend(T, end, share) for share in _SHARES for end in ends):
            far = max(float(np.linalg.norm(way[:3, 3] - end[:3, 3])) for end in ends)
            if far > step:
                continue
            if is_free(Body(solids[name], way), others, SNAPPED):
                passed[k] = _carried(now, name, way)
                break
    return tuple(passed)


def _carried(moment: Moment, name: str, T_world_part: Transform) -> Moment:
    """The moment with the held part elsewhere, and the hand with it."""
    hand, poses = moment.T_world_hand, {**moment.T_world_part, name: T_world_part}
    if hand is not None:
        hand = T_world_part @ inverse(moment.T_world_part[name]) @ hand
    return replace(moment, T_world_part=poses, T_world_hand=hand)


def given_way(
    moments: Sequence[Moment], solids: Mapping[str, Solid], outfit: Outfit
) -> tuple[Moment, ...]:
    """The moments with hands drawn back where they would stand in parts.

    Args:
        moments: the frames of a script.
        solids: of all parts.
        outfit: whose hand it is.
    """
    cleared: list[Moment] = []
    for _, run in groupby(
        enumerate(moments), key=lambda k: k[0] if k[1].held is None else k[1].held
    ):
        hold = _cleared([moment for _, moment in run], solids, outfit)
        last = hold[:0] if hold[0].held is None else hold[-_LAST:]
        cleared += hold[: len(hold) - len(last)]
        for moment in last:
            again = _deepest(moment, solids, outfit) > _TOO_DEEP
            cleared += _cleared([moment], solids, outfit) if again else [moment]
    return tuple(cleared)


def _cleared(
    hold: Sequence[Moment], solids: Mapping[str, Solid], outfit: Outfit
) -> Sequence[Moment]:
    """An empty hand's moment, or all moments of a hold: fingers slip before they close."""
    if any(moment.T_world_hand is None for moment in hold):
        return hold
    depths = [_deepest(moment, solids, outfit) for moment in hold]
    worst, least = int(np.argmax(depths)), max(depths)
    if least <= ALLOWED:
        return hold
    ways = _ways_off(hold[worst], outfit)
    held, best = hold[worst].held, hold
    doubted = [moment for moment, d in zip(hold, depths, strict=True) if d > ALLOWED]
    for step in _STEPS if held is None else _STEPS[:_SLIP]:
        for way in ways:
            if least <= ALLOWED:
                return best
            off = moved(np.eye(4), step * way)
            if held is not None:
                T = hold[worst].T_world_part[held]
                off = inverse(T) @ off @ T
            # Few moments tell most of what does not do.
            if max(_deepest(_slipped(m, off), solids, outfit) for m in doubted) < least:
                slipped = [_slipped(moment, off) for moment in hold]
                deep = max(_deepest(moment, solids, outfit) for moment in slipped)
                best, least = (slipped, deep) if deep < least else (best, least)
    return best


def _slipped(moment: Moment, off: Transform) -> Moment:
    """The moment with the hand moved, in the frame of what it holds if it does, else of the world."""
    T = np.eye(4) if moment.held is None else moment.T_world_part[moment.held]
    hand = moment.T_world_hand
    return replace(moment, T_world_hand=None if hand is None else T @ off @ inverse(T) @ hand)


def _ways_off(moment: Moment, outfit: Outfit) -> list[Vector]:
    """Unit vectors: back, up, to both sides across the pinch, and between these."""
    hand, up = moment.T_world_hand, np.array([0.0, 0.0, 1.0])
    if hand is None:
        return []
    back = backed(hand, outfit, moment.grasp, 1.0)[:3, 3] - hand[:3, 3]
    back /= np.linalg.norm(back)
    side = np.cross(back, hand[:3, :3] @ outfit.worn(hand_mesh(moment.grasp).pinch))
    ways = (back, up, back + up, side, -side, back + side, back - side, up + side, up - side)
    return [way / np.linalg.norm(way) for way in ways]


def _deepest(moment: Moment, solids: Mapping[str, Solid], outfit: Outfit) -> float:
    """How deep the hand stands in any part, metres; up to ALLOWED it may be told as any other up to this."""
    if moment.T_world_hand is None:
        return 0.0
    patches = _patches(moment.grasp)
    T_world_mesh = scaled(moment.T_world_hand, outfit)
    world, middles = apply(T_world_mesh, patches.points), apply(T_world_mesh, patches.middles)
    radii = patches.radii * outfit.size
    most = 0.0
    for name, T in moment.T_world_part.items():
        T_part_world, solid = inverse(T), solids[name]
        near = ~out_of_reach(apply(T_part_world, middles), radii, solid)[patches.of]
        if near.any():
            inner = apply(T_part_world, world[near])
            most = max(most, depth(inner, solid, least=max(most, ALLOWED)))
    return most


@dataclass(frozen=True, slots=True, eq=False)
class _Patches:
    """The surface of a hand in pieces, hand frame, metres: most are far from any part."""

    points: Points
    """All corners of the mesh: a thin rod passes between the fewer ones that grips are chosen by."""
    of: Int64[np.ndarray, "n"]
    """The patch of each point."""
    middles: Float64[np.ndarray, "p 3"]
    radii: Float64[np.ndarray, "p"]
    """Of balls round the patches, with a little more against rounding."""


@cache
def _patches(grasp: int) -> _Patches:
    points = hand_mesh(grasp).mesh.vertices
    _, of, counts = np.unique(
        np.floor(points / _PATCH), axis=0, return_inverse=True, return_counts=True
    )
    sums = np.stack([np.bincount(of, axis) for axis in points.T], axis=1)
    middles = sums / counts[:, None]
    radii = np.zeros(len(middles))
    np.maximum.at(radii, of, np.linalg.norm(points - middles[of], axis=1))
    return _Patches(points, of, middles, radii + 1e-6)
