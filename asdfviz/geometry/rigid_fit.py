"""The rigid transform that takes points onto others as well as can be, though some of them went elsewhere.

Kabsch's solution (A solution for the best rotation to relate two sets of vectors, 1976), weighted anew
by how far points are off (Geman and McClure's weights), from several starts at once.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Points, Scores, Transform

Several: TypeAlias = Float64[np.ndarray, "m 4 4"]
Rows: TypeAlias = Float64[np.ndarray, "m n"]
"""A value of each point for each of several transforms."""

ROUNDS = (4.0, 2.0, 1.0, 1.0)
"""Scales of the weights from round to round, in units of `scale`."""


def rigid_fit(points_a: Points, points_b: Points, weights: Scores) -> Transform:
    """T_b_a that takes the points of frame a to those of frame b with the least squares left.

    Args:
        points_a: three or more that are not on one line.
        points_b: the same ones in frame b.
        weights: of the points, none below 0.
    """
    return _fitted(points_a, points_b, weights[None])[0]


def robust_fit(
    points_a: Points,
    points_b: Points,
    weights: Scores,
    starts: Several,
    *,
    scale: float,
) -> tuple[Transform, float]:
    """T_b_a by which most of the weight agrees, and the share of it that does.

    Args:
        points_a: three or more that are not on one line.
        points_b: the same ones in frame b.
        weights: of the points, above 0.
        starts: T_b_a from which it is sought.
        scale: a point that is off by this counts half, metres.
    """
    Ts = starts
    for wider in ROUNDS:
        share = _agreeing(points_a, points_b, Ts, wider * scale)
        Ts = _fitted(points_a, points_b, weights * share**2)
    agree = agreement(points_a, points_b, weights, Ts, scale=scale)
    best = int(agree.argmax())
    return Ts[best], float(agree[best])


def agreement(
    points_a: Points, points_b: Points, weights: Scores, T_b_as: Several, *, scale: float
) -> Float64[np.ndarray, "m"]:
    """Share of the weight that agrees with each transform, 0 to 1; see `robust_fit`."""
    return _agreeing(points_a, points_b, T_b_as, scale) @ (weights / weights.sum())


def _agreeing(points_a: Points, points_b: Points, T_b_as: Several, scale: float) -> Rows:
    """1 where a point is where a transform takes it, 1/2 where it is off by the scale."""
    moved = np.einsum("nij,pj->npi", T_b_as[:, :3, :3], points_a) + T_b_as[:, None, :3, 3]
    squared = ((moved - points_b) ** 2).sum(axis=2)
    return 1.0 / (1.0 + squared / scale**2)


def _fitted(points_a: Points, points_b: Points, weights: Rows) -> Several:
    """The least squares' transform for each row of weights."""
    w = weights / weights.sum(axis=1, keepdims=True)
    middle_a, middle_b = w @ points_a, w @ points_b
    H = np.einsum("np,pi,pj->nij", w, points_a, points_b)
    U, _, Vt = np.linalg.svd(H - middle_a[:, :, None] * middle_b[:, None, :])
    V, Ut = Vt.transpose(0, 2, 1), U.transpose(0, 2, 1)
    V[:, :, 2] *= np.sign(np.linalg.det(V @ Ut))[:, None]
    Ts = np.tile(np.eye(4), (len(w), 1, 1))
    Ts[:, :3, :3] = V @ Ut
    Ts[:, :3, 3] = middle_b - np.einsum("nij,nj->ni", Ts[:, :3, :3], middle_a)
    return Ts
