"""Hands that would stand in a part for a moment give way by millimetres, back or up.

A grip is chosen for the ends of a move and some places between them; an empty hand may still brush a
part on its way. One that holds something stays: it is rigid to what it holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from asdfviz.geometry.shapes import Points, Transform
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import backed, hand_points, scaled
from asdfviz.synth.hands import hand_mesh
from asdfviz.synth.layout import Outfit
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import Solid, depth

ALLOWED = 0.0042
"""Soft fingers give way by this much, metres."""
DOUBTED = 0.0025
"""Where some points of a hand are deeper than this in a part all of them are looked at, metres."""
_STEPS = tuple(k / 1000 for k in range(1, 5))
"""How far a hand goes at most, and by what steps, metres."""


def given_way(
    moments: Sequence[Moment], solids: Mapping[str, Solid], outfit: Outfit
) -> tuple[Moment, ...]:
    """The moments with hands drawn back where they would stand in parts.

    Args:
        moments: the frames of a script.
        solids: of all parts.
        outfit: whose hand it is.
    """
    return tuple(_cleared(moment, solids, outfit) for moment in moments)


def _cleared(moment: Moment, solids: Mapping[str, Solid], outfit: Outfit) -> Moment:
    T_world_hand = moment.T_world_hand
    if T_world_hand is None or moment.held is not None:
        return moment
    some, all_points = hand_points(moment.grasp), hand_mesh(moment.grasp).mesh.vertices
    if _deepest(some, T_world_hand, moment, solids, outfit) < DOUBTED:
        return moment
    best, least = T_world_hand, _deepest(all_points, T_world_hand, moment, solids, outfit)
    back = backed(T_world_hand, outfit, moment.grasp, 1.0)[:3, 3] - T_world_hand[:3, 3]
    up = np.array([0.0, 0.0, 1.0])
    for step in _STEPS:
        for way in (back, up, (back + up) / np.linalg.norm(back + up)):
            if least <= ALLOWED:
                break
            T_off = moved(T_world_hand, step * way)
            deep = _deepest(all_points, T_off, moment, solids, outfit)
            if deep < least:
                best, least = T_off, deep
    return moment if best is T_world_hand else replace(moment, T_world_hand=best)


def _deepest(
    points: Points,
    T_world_hand: Transform,
    moment: Moment,
    solids: Mapping[str, Solid],
    outfit: Outfit,
) -> float:
    """How deep a hand stands in any part, metres."""
    world = apply(scaled(T_world_hand, outfit), points)
    return max(
        depth(apply(inverse(T), world), solids[name]) for name, T in moment.T_world_part.items()
    )
