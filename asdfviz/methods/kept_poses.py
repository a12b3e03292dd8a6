"""What is kept of a part's poses over time, and by which figures: the nouns of `part_hypotheses`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Box, Intrinsics, Transform
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.registration import Evidence
from asdfviz.pose.confidence import ConfidenceConfig, confidence

Allows: TypeAlias = Callable[[Transform, Transform], bool]
"""Whether a part at the first pose T_camera_part may rather be at the second one."""
Likely: TypeAlias = Callable[[Transform], float]
"""The network's preference for a pose T_camera_part in this frame, 0 to 1."""


@dataclass(frozen=True)
class HypothesesConfig:
    """How poses are kept and compared; the paper has no such step."""

    kept: int = 4
    """Poses of a part that are kept side by side."""
    memory: float = 0.5
    """Weight of a frame in a pose's trust, where all of the part is seen, 0 to 1."""
    outline: float = 0.6
    """Weight of the box's overlap against the depth's agreement."""
    network: float = 0.6
    """Weight of the network's preference, averaged over time:"""
    network_memory: float = 0.2
    """weight of a frame in it, once there were enough, 0 to 1."""
    overtaken: float = 0.5
    """Share of its trust that a pose loses for each share of the depth that a new one explains
    better."""
    beside: float = 0.3
    """Share of its agreement that a pose beside the detected box keeps, 0 to 1."""
    left: float = 0.6
    """Where less of the visible depth agrees, the part may have gone where its box is, 0 to 1."""
    same_angle_deg: float = 20.0
    """Poses turned less than this against each other, and"""
    same_distance: float = 0.1
    """with centres nearer than this share of the diameter, are one."""
    enough: float = 0.75
    """A trusted pose whose depth agrees this well, 0 to 1, and that the frame's own first pose
    confirms, is not tried against others."""
    moved_px: float = 2.0
    """A box that moved farther starts its poses at the new place as well, pixels."""
    looked_every: int = 6
    """A part that rests is looked at by the crop network in one of so many frames; 1: in all,"""
    rests_liked: float = 0.6
    """if the network, averaged over time, likes its pose by this at least, 0 to 1,"""
    rests_worse: float = 0.1
    """and depth agrees with it well enough, or less than in the frame before by no more than this,"""
    rests_visible: float = 0.2
    """and so much of it is seen, 0 to 1, likewise."""
    lain: int = 8
    """What rested for so many frames may still be there when another place is taken for it,"""
    covered: float = 0.5
    """if less than this of it would be seen where it was, 0 to 1."""
    unseen: float = 0.35
    """A part without a box keeps its pose where at least this share of the depth agrees, 0 to 1."""
    blind: float = 0.05
    """Where less of a part's box and of what is around it is measured, 0 to 1, depth says nothing, and the
    first pose is the answer: a colour image is wider than what a depth camera sees of it."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 <= self.blind <= 1:
            raise MethodError(f"hypotheses.blind is {self.blind:g}, use 0 to 1")
        if min(self.kept, self.looked_every, self.lain) < 1:
            raise MethodError(
                f"hypotheses.kept is {self.kept}, looked_every {self.looked_every} and lain {self.lain}: "
                "use 1 or more"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A first pose of this frame."""

    T_camera_part: Transform
    likely: float
    """The network's preference, 0 to 1, 1 for the one that it prefers."""
    is_fitted: bool = False
    """Whether depth has turned it already; others are registered."""


def proposals_of(own: PoseEstimate, look: LookedAt) -> list[Proposal]:
    """ASDF's pose, then the runners-up of its first pose."""
    first, *others = look.settled
    return [
        Proposal(own.T_camera_part, first.likely, is_fitted=first.refined),
        *(Proposal(r.T_camera_part, r.likely, is_fitted=r.refined) for r in others),
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A pose with what spoke for it."""

    T_camera_part: Transform
    trust: float
    """Agreement over time, about 0 to 1."""
    liked: float
    """The network's preference over time, about 0 to 1."""
    evidence: Evidence
    """In this frame."""
    frames: int
    """In which it was there, this one counted;"""
    rested: int = 1
    """since so many of them it has not moved with a box."""

    def older(self) -> Hypothesis:
        """The same after a frame in which nobody asked for it."""
        return replace(self, frames=self.frames + 1, rested=self.rested + 1)


def agreement(
    seen: Evidence, liked: float, box_xyxy: Box | None, *, config: HypothesesConfig
) -> float:
    """What speaks for a pose, about 0 to 1; half of the visible seen through is 0.

    Args:
        seen: of it in a frame.
        liked: the network's preference, 0 to 1.
        box_xyxy: where the part was detected, pixels, or None.
        config: weights.
    """
    spoken = 2 * seen.agreeing - 1 + config.network * liked
    weights = 1 + config.network
    if box_xyxy is None:
        return spoken / weights
    # A flat part agrees with the depth of any table: away from its box little is believed.
    near = min(1.0, 2 * seen.outline)
    believed = config.beside + (1 - config.beside) * near
    return believed * (spoken + config.outline * seen.outline) / (weights + config.outline)


def may_rest(best: Hypothesis, box_before: Box, box_now: Box, *, config: HypothesesConfig) -> bool:
    """Whether a most trusted pose is so well known, and its box (pixels) so still, that depth alone may
    confirm it."""
    return (
        best.frames > config.looked_every
        and best.liked >= config.rests_liked
        and float(np.abs(box_now - box_before).max()) <= config.moved_px
    )


def still_agrees(before: Evidence, now: Evidence, *, config: HypothesesConfig) -> bool:
    """Whether depth has nothing new against a pose since the frame before."""
    worse = config.rests_worse
    return now.agreeing >= min(before.agreeing - worse, config.enough) and now.visible >= max(
        before.visible - worse, config.rests_visible
    )


def moved_with_box(
    T_camera_part: Transform,
    box_before: Box | None,
    box_now: Box | None,
    K: Intrinsics,
    middle: Float64[np.ndarray, "4"],
    *,
    config: HypothesesConfig,
) -> Transform | None:
    """A pose, shifted across the view as its part's detected box (pixels) was; None where that stayed.

    Args:
        T_camera_part: in the frame before.
        box_before: around the part when it was detected last; None: it never was.
        box_now: around it in this frame; None: it is not detected.
        K: intrinsics.
        middle: of the part, homogeneous, part frame, metres.
        config: from how many pixels a box has moved.
    """
    if box_now is None or box_before is None:
        return None
    shift_px = (box_now[:2] + box_now[2:] - box_before[:2] - box_before[2:]) / 2
    if float(np.linalg.norm(shift_px)) < config.moved_px:
        return None
    moved = T_camera_part.copy()
    moved[:2, 3] += float(T_camera_part[2] @ middle) * shift_px / np.array([K[0, 0], K[1, 1]])
    return moved


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """The most trusted pose, and how far the next one is behind."""

    best: Hypothesis
    lead: float
    """Over the most trusted pose that is another one; the trust itself where there is none."""
    rival: Hypothesis | None = None
    """That other pose."""
    is_measured: bool = True
    """Whether depth said something of it."""


def pose_confidence(
    decision: Decision,
    score: float | None,
    contours: float | None,
    *,
    loose: bool,
    config: ConfidenceConfig,
) -> float:
    """Probability that a decided pose is right.

    Args:
        decision: the pose and what speaks for it.
        score: of the detected box, None without.
        contours: confidence by them, None where they were not asked.
        loose: whether nothing holds the part.
        config: weights.
    """
    best = decision.best
    return confidence(
        trust=best.trust,
        lead=decision.lead,
        agreeing=best.evidence.agreeing,
        liked=best.liked,
        outline=best.evidence.outline,
        detection=score,
        contours=contours,
        missed=loose and score is None and best.evidence.visible > config.plain,
        config=config,
    )
