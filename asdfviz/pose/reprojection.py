"""Robust, weighted Levenberg-Marquardt on the reprojection error, several starts at once.

OpenCV's refinement knows neither weights nor robust losses. All starts are carried as one batch,
so that trying the mirrored twin of every pose costs little more than trying one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Intrinsics, Pixels, Points, Scores, Transform
from asdfviz.geometry.transforms import orthonormalized

Poses: TypeAlias = Float64[np.ndarray, "b 4 4"]
"""A batch of T_camera_part."""
Costs: TypeAlias = Float64[np.ndarray, "b"]
"""One number a pose."""
ITERATIONS = 10
NEAREST = 0.01
"""Points nearer to the camera plane than this, metres, make a pose impossible."""


def minimize_reprojection(
    starts: Sequence[Transform],
    keypoints_part: Points,
    keypoints_px: Pixels,
    K: Intrinsics,
    *,
    scale_px: float,
    scores: Scores | None = None,
) -> Transform | None:
    """Return the refined T_camera_part of lowest cost over all starts; None without a possible one.

    The cost is sum_i score_i * log(1 + (r_i / scale)^2), Cauchy's, with r_i in pixels.
    """
    if not starts:
        return None
    weights = np.ones(len(keypoints_px)) if scores is None else np.clip(scores, 0.05, 1.0)
    problem = _Problem(keypoints_part, keypoints_px, K, weights, scale_px)
    Ts_camera_part = np.stack(starts)
    cost = problem.cost(Ts_camera_part)
    Ts_camera_part, cost = Ts_camera_part[np.isfinite(cost)], cost[np.isfinite(cost)]
    if not len(cost):
        return None
    damping = np.full(len(cost), 1e-3)
    for iteration in range(ITERATIONS):
        if iteration == 3:  # by now only the starts near the best can still win
            hopeful = cost <= 1.5 * cost.min()
            Ts_camera_part, cost, damping = Ts_camera_part[hopeful], cost[hopeful], damping[hopeful]
        trial = problem.stepped(Ts_camera_part, damping)
        trial_cost = problem.cost(trial)
        better = trial_cost < cost
        converged = better.any() and (trial_cost > (1 - 1e-3) * cost)[better].all()
        Ts_camera_part = np.where(better[:, None, None], trial, Ts_camera_part)
        cost = np.where(better, trial_cost, cost)
        damping = np.clip(np.where(better, damping * 0.2, damping * 10), 1e-9, 1e6)
        if converged:
            break
    return orthonormalized(Ts_camera_part[int(cost.argmin())])


class _Problem:
    """The data of one part; evaluates a batch of poses."""

    def __init__(
        self, points: Points, pixels: Pixels, K: Intrinsics, weights: Scores, scale: float
    ) -> None:
        self.points, self.pixels, self.K = points, pixels, K
        self.weights, self.scale = weights, scale

    def cost(self, Ts_camera_part: Poses) -> Costs:
        residual, points_camera, _ = self._residuals(Ts_camera_part)
        squared = (residual**2).sum(axis=2) / self.scale**2
        cost = (self.weights * np.log1p(squared)).sum(axis=1)
        possible = points_camera[..., 2].min(axis=1) > NEAREST
        return np.where(possible & np.isfinite(cost), cost, np.inf)

    def stepped(self, Ts_camera_part: Poses, damping: Costs) -> Poses:
        """One damped Gauss-Newton step of every pose."""
        residual, points_camera, rotated = self._residuals(Ts_camera_part)
        squared = (residual**2).sum(axis=2) / self.scale**2
        weight = self.weights / (1 + squared)
        J = self._jacobian(points_camera, rotated)
        weighted = (J * weight[..., None, None]).reshape(len(J), -1, 6).transpose(0, 2, 1)
        H = weighted @ J.reshape(len(J), -1, 6)
        g = weighted @ residual.reshape(len(J), -1, 1)
        diagonal = np.einsum("bii->bi", H)
        damped = H + np.eye(6) * (damping[:, None] * diagonal + 1e-12)[:, None, :]
        return _moved(Ts_camera_part, _solved(damped, -g))

    def _residuals(
        self, Ts_camera_part: Poses
    ) -> tuple[
        Float64[np.ndarray, "b n 2"], Float64[np.ndarray, "b n 3"], Float64[np.ndarray, "b n 3"]
    ]:
        rotated = self.points @ Ts_camera_part[:, :3, :3].transpose(0, 2, 1)
        points_camera = rotated + Ts_camera_part[:, None, :3, 3]
        z = np.maximum(points_camera[..., 2:], NEAREST)
        projected = points_camera[..., :2] / z @ self.K[:2, :2].T + self.K[:2, 2]
        return projected - self.pixels, points_camera, rotated

    def _jacobian(
        self, points_camera: Float64[np.ndarray, "b n 3"], rotated: Float64[np.ndarray, "b n 3"]
    ) -> Float64[np.ndarray, "b n 2 6"]:
        """Derivative of a pixel by a turn about the part's origin and by a shift, camera axes."""
        z = np.maximum(points_camera[..., 2], NEAREST)
        by_point = np.zeros((*points_camera.shape[:2], 2, 3))
        by_point[..., :, :2] = self.K[:2, :2] / z[..., None, None]
        slopes = points_camera[..., :2] @ self.K[:2, :2].T
        by_point[..., :, 2] = -slopes / (z**2)[..., None]
        x, y, z = (rotated[..., None, i] for i in range(3))
        bx, by, bz = (by_point[..., i] for i in range(3))
        by_turn = np.stack([y * bz - z * by, z * bx - x * bz, x * by - y * bx], axis=3)
        return np.concatenate([by_turn, by_point], axis=3)


def _solved(
    matrices: Float64[np.ndarray, "b k k"], right: Float64[np.ndarray, "b k m"]
) -> Float64[np.ndarray, "b k m"]:
    return np.linalg.solve(matrices, right)


def _moved(Ts_camera_part: Poses, delta: Float64[np.ndarray, "b 6 1"]) -> Poses:
    """Turn by Cayley's map, which is a rotation for any argument and the turn itself for small ones."""
    half = np.zeros((len(delta), 3, 3))
    x, y, z = np.clip(delta[:, :3, 0], -0.7, 0.7).T / 2
    half[:, 0, 1], half[:, 0, 2], half[:, 1, 2] = -z, y, -x
    half -= half.transpose(0, 2, 1)
    turn = _solved(np.eye(3) - half, np.eye(3) + half)
    moved = Ts_camera_part.copy()
    moved[:, :3, :3] = turn @ Ts_camera_part[:, :3, :3]
    moved[:, :3, 3] += delta[:, 3:, 0]
    return moved
