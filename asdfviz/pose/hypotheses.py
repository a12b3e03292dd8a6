"""From several possible rotations of a part to one pose: scored by outline and depth, the best refined.

What is seen comes as a small square view along the ray through the detected box (the crop of the
network that proposed the rotations, or any other): the part's visible outline and, for methods that
use it, the measured depth in the same cells. A translation follows for every rotation from the box:
its middle gives the ray, its size the distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import (
    Rotation,
    Scores,
    Transform,
    Vector,
)
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.pose.hypothesis_kernels import agreement, plane_fit, surface_fit
from asdfviz.pose.part_view import PartView, Surface
from asdfviz.pose.table import SunkConfig, depth_in_table

Poses: TypeAlias = Float64[np.ndarray, "c 4 4"]
"""T_view_part of candidates."""
Findings: TypeAlias = Float64[np.ndarray, "c 4"]
"""As `agreement` gives them: overlap, depth agreement, readings, median gap."""

TURNS = (0.12, 0.05)
"""Without depth a pose is refined by turns of these, radians, and shifts of like effect."""


@dataclass(frozen=True)
class HypothesisConfig:
    """How rotations are scored and refined; the paper has no such step."""

    count: int = 20
    """Rotations that are scored."""
    refined: int = 2
    """The best of them that are refined."""
    depth_weight: float = 1.0
    """Weight of the depth's agreement against the outline's."""
    prior_weight: float = 0.3
    """Weight of a rotation's probability over that of the most probable one."""
    margin: float = 0.006
    """Readings this near to the surface agree with it, metres."""
    max_shift: float = 0.25
    """Depth moves a part no farther than this share of its distance."""
    reach: float = 0.02
    """Readings farther than this from the surface do not refine, metres."""
    steps: int = 6
    """Refinement steps by depth."""
    min_readings: int = 12
    """Fewer depth readings than this say nothing."""
    min_overlap: float = 0.15
    """A pose whose outline agrees less is no pose, 0 to 1."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.count < 1 or self.refined < 1:
            raise MethodError("hypotheses.count and hypotheses.refined must be 1 or more")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A possible pose."""

    R_camera_part: Rotation
    probability: float
    distance: float | None = None
    """From the camera along the view's axis, metres, where the box cannot give it."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """The pose that agrees best."""

    T_camera_part: Transform
    agreement: float
    """0 to 1: how well outline and depth agree."""
    refined: bool
    """Whether depth had a say."""
    likely: float = 1.0
    """Probability of the rotation that it began with, over that of the most probable one."""


def settle(
    candidates: list[Candidate],
    surface: Surface,
    view: PartView,
    *,
    config: HypothesisConfig,
    sunk: SunkConfig | None = None,
) -> list[Settled]:
    """Score all candidates, refine the best few and return those that agree, the winner first.

    Nothing is returned where not even the winner agrees.

    Args:
        candidates: rotations, the most probable first.
        surface: of the part.
        view: what is seen of it.
        config: how they are compared.
        sunk: what it means to stand in the view's table; None: nothing.
    """
    if not candidates:
        return []
    chosen = candidates[: config.count]
    Rs_view_part = view.R_camera_view.T @ np.stack([c.R_camera_part for c in chosen])
    Ts = _placed(Rs_view_part, chosen, surface, view)
    prior = np.array([c.probability for c in chosen])
    prior = prior / max(prior.max(), 1e-12)
    Ts, found = _on_depth(Ts, surface, view, config)
    score = _scores(found, config) + config.prior_weight * prior - _sunk(Ts, surface, view, sunk)
    best = np.argsort(-score)[: config.refined]
    refined = np.stack([_refined(Ts[i], surface, view, config) for i in best])
    both = np.concatenate([refined, Ts[best]])
    found = np.concatenate([_agreement(refined, surface, view, config), found[best]])
    agreed = _scores(found, config)
    score = agreed + config.prior_weight * np.tile(prior[best], 2)
    score -= _sunk(both, surface, view, sunk)
    T_camera_view = transform_from(view.R_camera_view, np.zeros(3))
    settled: list[Settled] = []
    for place in np.argsort(-score, kind="stable"):
        if found[place, 0] < config.min_overlap:
            if not settled:
                return []  # nothing agrees where even the best does not
            continue
        has_depth = bool(found[place, 2] >= config.min_readings)
        reached = float(agreed[place]) / _most(config, has_depth)
        T_camera_part = T_camera_view @ both[place]
        likely = float(prior[best][place % len(best)])
        settled.append(Settled(T_camera_part, float(np.clip(reached, 0, 1)), has_depth, likely))
    return settled


def _placed(
    Rs_view_part: Float64[np.ndarray, "c 3 3"],
    chosen: list[Candidate],
    surface: Surface,
    view: PartView,
) -> Poses:
    """The poses whose projected corners fill the box: its middle and, unless given, its size."""
    turned = np.einsum("cij,kj->cki", Rs_view_part, surface.corners)
    center = (view.outline.shape[0] - 1) / 2
    box = (view.box_xyxy - center) / view.focal
    middle, diagonal = (box[:2] + box[2:]) / 2, max(float(np.linalg.norm(box[2:] - box[:2])), 1e-6)
    low, high = turned.min(axis=1), turned.max(axis=1)
    inner = (low + high) / 2
    z: Scores = np.linalg.norm((high - low)[:, :2], axis=1) / diagonal
    given = np.array([c.distance is not None for c in chosen])
    told = np.array([c.distance or 0.0 for c in chosen])
    z = np.where(given, told + inner[:, 2], z)
    t = z[:, None] * np.append(middle, 1.0) - inner
    for _ in range(3):
        seen = turned + t[:, None]
        flat = seen[..., :2] / np.maximum(seen[..., 2:], 0.01)
        low, high = flat.min(axis=1), flat.max(axis=1)
        ratio = np.linalg.norm(high - low, axis=1) / diagonal
        t[:, 2] += np.where(given, 0.0, (t + inner)[:, 2] * (ratio - 1))
        t[:, :2] += (middle - (low + high) / 2) * (t + inner)[:, 2:]
    Ts = np.tile(np.eye(4), (len(chosen), 1, 1))
    Ts[:, :3, :3], Ts[:, :3, 3] = Rs_view_part, t
    return Ts


def _agreement(Ts: Poses, surface: Surface, view: PartView, config: HypothesisConfig) -> Findings:
    return agreement(surface.points, Ts, view.focal, view.outline, view.measured, config.margin)


def _scores(found: Findings, config: HypothesisConfig) -> Scores:
    counted = found[:, 2] >= config.min_readings
    return found[:, 0] + config.depth_weight * found[:, 1] * counted


def _sunk(Ts: Poses, surface: Surface, view: PartView, config: SunkConfig | None) -> Scores:
    """What speaks against poses that have the part in the table."""
    if view.table is None or config is None:
        return np.zeros(len(Ts))
    deep = depth_in_table(Ts, surface.corners, view.table, depth=view.measured, K=view.K)
    return config.weight * config.share(deep, surface.corners)


def _most(config: HypothesisConfig, has_depth: bool) -> float:
    return 1.0 + config.depth_weight * has_depth


def _on_depth(
    Ts: Poses, surface: Surface, view: PartView, config: HypothesisConfig
) -> tuple[Poses, Findings]:
    """Slide every pose along its ray by the median gap to the readings."""
    found = _agreement(Ts, surface, view, config)
    z, gap = Ts[:, 2, 3], found[:, 3]
    known = np.isfinite(gap) & (np.abs(gap) < config.max_shift * z)
    if not known.any():
        return Ts, found
    moved = Ts.copy()
    moved[known, :3, 3] *= (1 + gap[known] / z[known])[:, None]
    return moved, _agreement(moved, surface, view, config)


def _refined(
    T_view_part: Transform, surface: Surface, view: PartView, config: HypothesisConfig
) -> Transform:
    """By depth where there is enough of it, by the outline otherwise."""
    if int((view.measured > 0).sum()) < config.min_readings:
        return _by_outline(T_view_part, surface, view, config)
    T_fitted = surface_fit(
        surface.points,
        surface.normals,
        np.ascontiguousarray(T_view_part),
        view.focal,
        view.outline,
        view.measured,
        config.reach,
        config.steps,
    )
    middle = surface.corners.mean(axis=0)
    return plane_fit(
        surface.points,
        T_fitted,
        view.focal,
        view.outline,
        view.measured,
        config.margin,
        config.depth_weight,
        config.min_readings,
        middle,
        float(np.linalg.norm(surface.corners - middle, axis=1).max()),
    )


def _by_outline(
    T_view_part: Transform, surface: Surface, view: PartView, config: HypothesisConfig
) -> Transform:
    """Try small turns and shifts, keep what makes the outlines agree better, with shrinking steps."""
    best, best_score = T_view_part, -1.0
    z = float(T_view_part[2, 3])
    for angle in TURNS:
        for _ in range(2):
            trials = [best]
            for axis in np.eye(3):
                for sign in (-1.0, 1.0):
                    trials.append(_turned(best, sign * angle * axis, np.zeros(3)))
                    step = z * (angle if axis[2] else 0.15 * angle)
                    trials.append(_turned(best, np.zeros(3), sign * step * axis))
            score = _agreement(np.stack(trials), surface, view, config)[:, 0]
            place = int(score.argmax())
            if score[place] <= best_score + 1e-6:
                break
            best, best_score = trials[place], float(score[place])
    return best


def _turned(T: Transform, turn: Vector, shift: Vector) -> Transform:
    """Turn about the part's own origin, camera axes, and shift."""
    angle = float(np.linalg.norm(turn))
    R = rotation_about(turn, min(angle, 0.5)) if angle > 1e-9 else np.eye(3)
    return transform_from(R @ T[:3, :3], T[:3, 3] + shift)
