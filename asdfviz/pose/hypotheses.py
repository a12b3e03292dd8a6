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
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.pose.hypothesis_fits import fits
from asdfviz.pose.hypothesis_kernels import agreement, slid
from asdfviz.pose.part_view import PartView, Surface
from asdfviz.pose.placing import placed
from asdfviz.pose.table import SunkConfig, depth_in_table

Poses: TypeAlias = Float64[np.ndarray, "c 4 4"]
"""T_view_part of candidates."""
Findings: TypeAlias = Float64[np.ndarray, "c 3"]
"""As `agreement` gives them: overlap, depth agreement, readings."""

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
        if min(self.count, self.refined, self.min_readings) < 1:
            raise MethodError(
                f"hypotheses.count is {self.count}, refined {self.refined} and min_readings "
                f"{self.min_readings}: all must be 1 or more"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Possible rotations, the most probable first."""

    Rs_camera_part: Float64[np.ndarray, "c 3 3"]
    probabilities: Float64[np.ndarray, "c"]
    distances: Float64[np.ndarray, "c"]
    """Depth of the part's origin along the view's axis, metres, where the box cannot give it; else NaN."""


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
    candidates: Candidates,
    surface: Surface,
    view: PartView,
    *,
    config: HypothesisConfig,
    sunk: SunkConfig | None = None,
) -> list[Settled]:
    """Score all candidates, refine the best few and return those that agree, the winner first.

    Nothing is returned where not even the winner agrees.

    Args:
        candidates: the first `config.count` of them count.
        surface: of the part.
        view: what is seen of it.
        config: how they are compared.
        sunk: what it means to stand in the view's table; None: nothing.
    """
    prior = candidates.probabilities[: config.count]
    if not len(prior):
        return []
    Rs_view_part = view.R_camera_view.T @ candidates.Rs_camera_part[: config.count]
    prior = prior / max(prior.max(), 1e-12)
    center = (view.outline.shape[0] - 1) / 2
    Ts = placed(
        np.ascontiguousarray(Rs_view_part),
        np.ascontiguousarray(candidates.distances[: config.count]),
        surface.corners,
        (view.box_xyxy - center) / view.focal,
    )
    seen = (view.focal, view.outline, view.measured)
    Ts = slid(surface.points, Ts, *seen, config.max_shift, surface.middle)
    _, score, _ = _compared(Ts, prior, surface, view, config, sunk)
    best = np.argsort(-score)[: config.refined]
    both = np.concatenate([refined(Ts[best], surface, view, config), Ts[best]])
    likely = np.tile(prior[best], 2)
    agreed, score, found = _compared(both, likely, surface, view, config, sunk)
    T_camera_view = transform_from(view.R_camera_view, np.zeros(3))
    kept: list[Settled] = []
    for place in np.argsort(-score, kind="stable"):
        if found[place, 0] < config.min_overlap:
            if not kept:
                return []  # nothing agrees where even the best does not
            continue
        has_depth = bool(found[place, 2] >= config.min_readings)
        reached = float(agreed[place]) / (1.0 + config.depth_weight * has_depth)
        T_camera_part, reached = T_camera_view @ both[place], float(np.clip(reached, 0, 1))
        kept.append(Settled(T_camera_part, reached, has_depth, float(likely[place])))
    return kept


def _compared(
    Ts: Poses,
    prior: Scores,
    surface: Surface,
    view: PartView,
    config: HypothesisConfig,
    sunk: SunkConfig | None,
) -> tuple[Scores, Scores, Findings]:
    """How well each pose agrees, as one number; the number by which they compare; and the findings."""
    found = _agreement(Ts, surface, view, config)
    counted = found[:, 2] >= config.min_readings
    agreed = found[:, 0] + config.depth_weight * found[:, 1] * counted
    score = agreed + config.prior_weight * prior
    if view.table is not None and sunk is not None:
        deep = depth_in_table(Ts, surface.corners, view.table, depth=view.measured, K=view.K)
        score = score - sunk.weight * sunk.share(deep, surface.corners)
    return agreed, score, found


def _agreement(Ts: Poses, surface: Surface, view: PartView, config: HypothesisConfig) -> Findings:
    return agreement(surface.points, Ts, view.focal, view.outline, view.measured, config.margin)


def refined(
    Ts_view_part: Poses, surface: Surface, view: PartView, config: HypothesisConfig
) -> Poses:
    """Each by depth where there is enough of it, by the outline otherwise."""
    least = config.min_readings
    if np.count_nonzero(view.measured > 0) < least:
        return np.stack([_by_outline(T, surface, view, config) for T in Ts_view_part])
    middle = surface.corners.mean(axis=0)
    radius = float(np.linalg.norm(surface.corners - middle, axis=1).max())
    seen = (view.focal, view.outline, view.measured)
    how = (config.reach, config.steps, config.margin, config.depth_weight, least)
    return fits(surface.points, surface.normals, Ts_view_part, seen, how, middle, radius)


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
