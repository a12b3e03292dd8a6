"""What is kept of a part's poses over time, and by which figures: the nouns of `part_hypotheses`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.shapes import Transform
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
    unseen: float = 0.35
    """A part without a box keeps its pose where at least this share of the depth agrees, 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A first pose of this frame."""

    T_camera_part: Transform
    likely: float
    """The network's preference, 0 to 1, 1 for the one that it prefers."""
    is_fitted: bool = False
    """Whether depth has turned it already; others are registered."""


def proposals_of(own: PoseEstimate | None, look: LookedAt | None) -> list[Proposal]:
    """ASDF's pose, then the runners-up of its first pose; nothing where ASDF ruled all out."""
    if own is None:
        return []
    if look is None:
        return [Proposal(own.T_camera_part, 1.0)]
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
    """In which it was there, this one counted."""


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """The most trusted pose, and how far the next one is behind."""

    best: Hypothesis
    lead: float
    """Over the most trusted pose that is another one; the trust itself where there is none."""


def pose_confidence(
    decision: Decision, score: float | None, contours: float | None, *, config: ConfidenceConfig
) -> float:
    """Probability that a decided pose is right.

    Args:
        decision: the pose and what speaks for it.
        score: of the detected box, None without.
        contours: confidence by them, None where they were not asked.
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
        config=config,
    )
