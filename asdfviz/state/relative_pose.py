"""The pose term S_P of Pose2State: how well the parts' places fit each state.

Every detected part is seen from the base part and compared with where each state has it:

- g(place) = exp(-(distance / sigma_t)^2 / 2 - (angle / sigma_r)^2 / 2), 1 at the place, 0 far away;
- n(place) = exp(-(difference of the distances between the centres / sigma_t)^2 / 2): whether the
  part is as far from the base as it would be there, whatever either one's rotation.

A part's likelihood under a state is

- joined there:     eps + (1 - eps) * ((1 - u) * g + u * n)
- not joined there: eps + (1 - eps) * (1 - max over its places of ((1 - v) * n + v * g))

with eps the share of poses that are plainly wrong, raised by `doubted` * (1 - P(part in its place)),
where the score tells P (`in_place`); u = `wrong_rotations` * doubt, v = 1 - doubt and
doubt = 1 - score of base * score of part. All parts are compared with one base pose. Where that is
wrong, every part seems to be far from its place whatever the state, so that

- L(state) = P(base in its place) * product of the parts' likelihoods
             + P(base elsewhere) * product of their likelihoods as if nothing were joined.

A step may add several parts, which come one after the other: while some are in and others are not,
the step before is the state (that is how truth is labelled). So under a state whose next step adds
several parts, L is (1 - h) of the product above and h of its mean over the ways in which some, but
not all, of them are joined already (`half_done` = h).

A lightly trained network finds parts long before it tells their rotations apart, and its scores say
so: then a part as far from the base as it should be speaks for the joined states whatever its
rotation, though less than one that fits. With scores of 1 the full pose alone decides. A part far
from its place speaks against the states that join it, one at its place against those that do not,
and one bad pose never vetoes. Symmetric parts are compared by the nearest symmetric pose, free joints
by what is left outside their freedom. Missing parts speak neither for nor against, and of twins (parts
of one mesh) it does not show which one is missing: under every state those that were found are the ones
as which they fit it best. Parts are taken as
independent given the state; the power `1 / temperature` makes up for small errors of the base pose,
which they share. Of a base that looks the same turned, its pose is to be the one that the parts tell
(`asdfviz.state.base_turns`).

The paper compares relative poses with the known ones and gives no formula; this one is ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.odds import probability
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.transforms import inverse
from asdfviz.state.half_done import ways_half_done
from asdfviz.state.joints import off_nominal
from asdfviz.state.twin_places import Place, twin_places


@dataclass(frozen=True)
class PlaceOdds:
    """Log-odds that a part is where its pose says, whatever its rotation: offset + slope * score.

    A logistic fit to ASDF's poses from crops of five development sequences, which no table uses: within
    30 mm were 23 % of those scored below 0.1, 40 % between 0.1 and 0.2, 89 % between 0.2 and 0.3, and
    nearly all above.
    """

    offset: float = -2.9
    """Of a pose with score 0."""
    slope: float = 16.8
    """Up to a pose with score 1. 0: the score is the probability itself."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a number is none."""
        if not (math.isfinite(self.offset) and math.isfinite(self.slope)):
            raise MethodError("relative_pose.in_place: offset and slope must be numbers")

    def probability(self, score: float) -> float:
        """That the part is where a pose with this score says, 0 to 1."""
        if self.slope == 0:
            return min(max(score, 0.0), 1.0)
        odds = min(max(self.offset + self.slope * score, -30.0), 30.0)
        return probability(odds)


SCORED_BY_PROBABILITY = PlaceOdds(slope=0.0)
"""Where scores are probabilities of being right."""


@dataclass(frozen=True)
class RelativePoseConfig:
    """Tolerances of the relative poses; the paper gives none."""

    sigma_translation: float = 0.03
    """Standard deviation of a joined part's distance from its place, metres (GBOT switches states
    at 0.03 to 0.04)."""
    sigma_rotation: float = 0.6
    """Standard deviation of a joined part's angle, radians: twice the paper's mean rotation error,
    since two parts err, and more for a lightly trained network (GBOT switches at 0.35)."""
    outliers: float = 0.05
    """eps: share of part poses that are plainly wrong, 0 to 1."""
    doubted: float = 0.5
    """Share of the doubt in a part's place that counts to eps; 1: a pose that is hardly believed says
    hardly anything."""
    in_place: PlaceOdds = field(default_factory=PlaceOdds)
    """What a score says of the place."""
    wrong_rotations: float = 0.4
    """u of a pose with score 0: share of joined parts of which the rotation says nothing, 0 to 1."""
    half_done: float = 0.3
    """h: share of a state's time in which a part of its next step is in already, 0 to 1, where that
    step adds several."""
    temperature: float = 1.5
    """Above 1 the parts are trusted less than independent witnesses."""
    shaken: float = 0.15
    """Of all this, 0 to 1, counts before a camera that moves, where drawn states speak besides
    (`asdf_plus` and `asdf_track`): what is small in a blurred picture is often found at a wrong place."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a tolerance is out of its range."""
        for name in ("sigma_translation", "sigma_rotation", "temperature"):
            if not 0 < getattr(self, name) < math.inf:
                raise MethodError(
                    f"relative_pose.{name} is {getattr(self, name):g}, use more than 0"
                )
        for name in ("outliers", "doubted", "wrong_rotations", "half_done", "shaken"):
            if not 0 <= getattr(self, name) <= 1:
                raise MethodError(f"relative_pose.{name} is {getattr(self, name):g}, use 0 to 1")


_LEAST = 1e-9
"""No base pose is surer than this, none more doubtful, and so many poses at least are plainly wrong."""


def relative_pose_probabilities(
    poses: Mapping[str, PoseEstimate], assembly: Assembly, *, config: RelativePoseConfig
) -> Scores | None:
    """Return the probability of every state (errors too) by where the parts are.

    Returns:
        None where the base part was not found, or no other part that any state joins; an assembly's
        only state needs no other part.
    """
    if len(assembly.states) == 1 and assembly.base in poses:
        return np.ones(1)
    told = joined_or_not(poses, assembly, config=config)
    if told is None:
        return None
    joined, alone = told
    there = config.in_place.probability(poses[assembly.base].score)
    there = min(max(there, _LEAST), 1.0 - _LEAST)
    log_likelihood = np.logaddexp(math.log(there) + joined, math.log(1.0 - there) + alone)
    odds = np.exp((log_likelihood - log_likelihood.max()) / config.temperature)
    return odds / odds.sum()


def joined_or_not(
    poses: Mapping[str, PoseEstimate], assembly: Assembly, *, config: RelativePoseConfig
) -> tuple[Scores, float] | None:
    """Log-likelihood of every state if the base is in its place, and as if nothing were joined.

    Returns:
        None where the base part was not found, or no other part that any state joins.
    """
    base = poses.get(assembly.base)
    if base is None:
        return None
    T_base_camera = inverse(base.T_camera_part)
    logs, alone = dict[str, Scores](), 0.0
    for places in twin_places(assembly):
        found = {
            name: (T_base_camera @ poses[name].T_camera_part, poses[name].score)
            for name in places
            if name in poses
        }
        if found:
            told, apart = _told(found, places, assembly, score_base=base.score, config=config)
            logs |= told
            alone += apart
    return (_also_half_done(logs, assembly, share=config.half_done), alone) if logs else None


def _told(
    found: Mapping[str, tuple[Transform, float]],
    places: Mapping[str, tuple[Place, ...]],
    assembly: Assembly,
    *,
    score_base: float,
    config: RelativePoseConfig,
) -> tuple[dict[str, Scores], float]:
    """Log-likelihood of every state by each found twin (T_base_part, score), and as if none were joined.

    Which twin is which does not show: under every state they have the names that fit best.
    """
    everything: list[list[Scores]] = []
    alone = 0.0
    for T_base_part, score in found.values():
        doubt = 1.0 - float(np.clip(score_base * score, 0.0, 1.0))
        astray = config.doubted * (1.0 - config.in_place.probability(score))
        outliers = max(config.outliers + (1.0 - config.outliers) * astray, _LEAST)
        fits = [
            _fits(T_base_part, name, of, assembly, doubt=doubt, config=config)
            for name, of in places.items()
        ]
        apart = min(away for _, away in fits)
        alone += math.log(outliers + (1.0 - outliers) * apart)
        shares = [np.where(np.isnan(fit), apart, fit) for fit, _ in fits]
        everything.append([np.log(outliers + (1.0 - outliers) * share) for share in shares])
    told = np.array(everything)
    if len(places) == 1:
        return {name: told[i, 0] for i, name in enumerate(found)}, alone
    best = np.empty((len(found), told.shape[2]))
    for state in range(told.shape[2]):
        for i, name in cheapest_pairs(-told[:, :, state]):
            best[i, state] = told[i, name, state]
    return {name: best[i] for i, name in enumerate(found)}, alone


def _also_half_done(logs: Mapping[str, Scores], assembly: Assembly, *, share: float) -> Scores:
    """Log-likelihood of every state from those of the parts, half-done next steps counted in."""
    nominal = np.sum(list(logs.values()), axis=0)
    ways: dict[int, list[float]] = {}
    for state, following, some in ways_half_done(assembly) if share > 0 else ():
        more = [logs[n][following.index] - logs[n][state.index] for n in some if n in logs]
        ways.setdefault(state.index, []).append(float(sum(more)))
    result = nominal.copy()
    for k, more in ways.items():
        half = math.log(share) + np.logaddexp.reduce(more) - math.log(len(more))
        result[k] += np.logaddexp(math.log1p(-share) if share < 1 else -np.inf, half)
    return result


def _fits(
    T_base_part: Transform,
    name: str,
    places: tuple[Place, ...],
    assembly: Assembly,
    *,
    doubt: float,
    config: RelativePoseConfig,
) -> tuple[Scores, float]:
    """How well one part fits every state that places it (NaN: others), and how well none that joins it.

    Plainly wrong poses aside.
    """
    part = assembly.parts[name]
    center, center_base = part.middle, assembly.parts[assembly.base].middle
    reach = np.linalg.norm(_moved(T_base_part, center) - center_base)
    fit_of_state = np.full(len(assembly.states), np.nan)
    best = 0.0
    for place in places:
        distance, angle = off_nominal(T_base_part, part, place.T_base_part, place.joint)
        there = _moved(place.T_base_part, center) - center_base
        near = _bell((reach - np.linalg.norm(there)) / config.sigma_translation)
        fit = _bell(distance / config.sigma_translation) * _bell(angle / config.sigma_rotation)
        u, v = config.wrong_rotations * doubt, 1.0 - doubt
        fit_of_state[list(place.states)] = (1.0 - u) * fit + u * near
        best = max(best, (1.0 - v) * near + v * fit)
    return fit_of_state, max(1.0 - best, 0.0)


def _bell(x: float | np.floating[Any]) -> float:
    return float(np.exp(-0.5 * x**2))


def _moved(T_base_part: Transform, point_part: Vector) -> Vector:
    return T_base_part[:3, :3] @ point_part + T_base_part[:3, 3]
