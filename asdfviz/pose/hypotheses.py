"""From several possible rotations of a part to one pose: scored by outline and depth, the best refined.

What is seen comes as a small square view along the ray through the detected box (the crop of the
network that proposed the rotations, or any other): the part's visible outline and, for methods that
use it, the measured depth in the same cells. A translation follows for every rotation from the box:
its middle gives the ray, its size the distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import transform_from
from asdfviz.pose.part_view import PartView, Surface
from asdfviz.pose.settling import settled
from asdfviz.pose.table import SunkConfig, Table


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

    @property
    def limits(self) -> tuple[float, float, float, float, float, int, int]:
        """As the compiled loop takes them."""
        return (
            self.max_shift,
            self.margin,
            self.depth_weight,
            self.prior_weight,
            self.reach,
            self.steps,
            self.min_readings,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Possible rotations, the most probable first."""

    Rs_camera_part: Float64[np.ndarray, "c 3 3"]
    probabilities: Float64[np.ndarray, "c"]
    distances: Float64[np.ndarray, "c"]
    """From the camera along the view's axis, metres, where the box cannot give it; else NaN."""


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
    Ts, found, agreed, score, which = settled(
        np.ascontiguousarray(Rs_view_part),
        np.ascontiguousarray(candidates.distances[: config.count]),
        prior,
        (surface.points, surface.normals, surface.corners),
        (view.focal, view.outline, view.measured, view.box_xyxy),
        _table(view.table, surface, sunk),
        config.limits,
        config.refined,
    )
    T_camera_view = transform_from(view.R_camera_view, np.zeros(3))
    kept: list[Settled] = []
    for place in np.argsort(-score, kind="stable"):
        if found[place, 0] < config.min_overlap:
            if not kept:
                return []  # nothing agrees where even the best does not
            continue
        has_depth = bool(found[place, 2] >= config.min_readings)
        reached = float(agreed[place]) / (1.0 + config.depth_weight * has_depth)
        T_camera_part = T_camera_view @ Ts[place]
        likely = float(prior[which[place]])
        kept.append(Settled(T_camera_part, float(np.clip(reached, 0, 1)), has_depth, likely))
    return kept


def _table(
    table: Table | None, surface: Surface, sunk: SunkConfig | None
) -> tuple[Vector, float, float, float, float]:
    """As `settled` takes it; without one it counts nothing."""
    if table is None or sunk is None:
        return np.zeros(3), 0.0, 0.0, 0.0, 1.0
    return table.normal, table.offset, sunk.weight, *sunk.depths(surface.corners)
