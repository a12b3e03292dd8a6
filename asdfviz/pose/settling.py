"""Compiled heart of `hypotheses`: rotations become poses, the best few are refined and compared.

One call without Python's lock for a part, so that several parts are settled at once.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel
from asdfviz.pose.depth_kernels import deepest
from asdfviz.pose.hypothesis_kernels import agreement, plane_fit, slid, surface_fit, turn
from asdfviz.pose.placing import placed

TURNS = (0.12, 0.05)
"""Without depth a pose is refined by turns of these, radians, and shifts of like effect."""


@kernel
@no_type_check
def settled(Rs, distances, prior, body, seen, table, limits, count):
    """The best few poses refined, and then as they were.

    Returns of each of these T_view_part, what `agreement` says, that as one number, the number by
    which they compare, and which of the rotations it came of.

    Args:
        Rs: R_view_part, (c, 3, 3).
        distances: as for `placed`.
        prior: probabilities over that of the most probable one.
        body: points, normals and corners of the part, metres.
        seen: focal, outline, depth and box of the view, cells and metres.
        table: normal and offset in the view; the most that standing in it counts, how deep is free,
            and how much deeper counts for all of it, metres.
        limits: of `HypothesisConfig`: max_shift, margin, depth_weight, prior_weight, reach, steps and
            min_readings.
        count: so many are refined.
    """
    points, _, corners = body
    focal, outline, measured, box = seen
    max_shift, margin, depth_weight, prior_weight, _, _, min_readings = limits
    Ts = placed(Rs, distances, corners, (box - (outline.shape[0] - 1) / 2) / focal)
    Ts = slid(points, Ts, focal, outline, measured, max_shift)
    found = agreement(points, Ts, focal, outline, measured, margin)
    told = _one(found, depth_weight, min_readings)
    score = told + prior_weight * prior - _against(Ts, corners, seen, table)
    best = np.argsort(-score)[:count]
    both = np.empty((2 * len(best), 4, 4))
    for k in range(len(best)):
        both[k] = _refined(Ts[best[k]], body, seen, limits)
        both[len(best) + k] = Ts[best[k]]
    which = np.concatenate((best, best))
    found = np.concatenate(
        (agreement(points, both[: len(best)], focal, outline, measured, margin), found[best])
    )
    told = _one(found, depth_weight, min_readings)
    score = told + prior_weight * prior[which] - _against(both, corners, seen, table)
    return both, found, told, score, which


@kernel
@no_type_check
def _one(found, depth_weight, min_readings):
    """Overlap, and agreement of depth where there are enough readings."""
    return found[:, 0] + depth_weight * found[:, 1] * (found[:, 2] >= min_readings)


@kernel
@no_type_check
def _against(Ts, corners, seen, table):
    """What speaks against poses that have the part in the table."""
    focal, outline, measured, _ = seen
    normal, offset, weight, free, full = table
    if weight <= 0.0:
        return np.zeros(len(Ts))
    center = (outline.shape[0] - 1) / 2
    K = np.array([[focal, 0.0, center], [0.0, focal, center], [0.0, 0.0, 1.0]])
    deep = deepest(Ts, corners, (normal, offset), measured, K)
    return weight * np.minimum(np.maximum(deep - free, 0.0) / full, 1.0)


@kernel
@no_type_check
def _refined(T_view_part, body, seen, limits):
    """By depth where there is enough of it, by the outline otherwise."""
    points, normals, corners = body
    focal, outline, measured, _ = seen
    _, margin, depth_weight, _, reach, steps, min_readings = limits
    if (measured > 0).sum() < min_readings:
        return _by_outline(points, T_view_part, focal, outline, measured, margin)
    T = surface_fit(points, normals, T_view_part, focal, outline, measured, reach, int(steps))
    middle = np.empty(3)
    for a in range(3):
        middle[a] = corners[:, a].mean()
    radius = np.sqrt(((corners - middle) ** 2).sum(axis=1).max())
    return plane_fit(
        points, T, focal, outline, measured, margin, depth_weight, min_readings, middle, radius
    )


@kernel
@no_type_check
def _by_outline(points, T_view_part, focal, outline, measured, margin):
    """Try small turns and shifts, keep what makes the outlines agree better, with shrinking steps."""
    best, most = T_view_part.copy(), -1.0
    z = T_view_part[2, 3]
    trials = np.empty((13, 4, 4))
    for angle in TURNS:
        for _ in range(2):
            trials[:] = best
            for axis in range(3):
                way = np.zeros(3)
                way[axis] = 1.0
                step = z * (angle if axis == 2 else 0.15 * angle)
                for side in range(2):
                    sign = 2.0 * side - 1.0
                    place = 1 + 4 * axis + 2 * side
                    turn(trials[place], way, sign * angle)
                    trials[place + 1, axis, 3] += sign * step
            score = agreement(points, trials, focal, outline, measured, margin)[:, 0]
            place = score.argmax()
            if score[place] <= most + 1e-6:
                break
            best, most = trials[place].copy(), score[place]
    return best
