"""Several poses of a part kept side by side over time: what one frame cannot decide, many do.

Not in the paper. Every frame's first poses join those of the frame before, and each one's trust
follows how well it agrees with the depth image and the detected box. A frame counts by what is seen of
the part there: a hand in front says nothing, a part that one sees through speaks against the pose.
No motion is assumed: a hypothesis lives only while depth finds it again where it was, or where the
box has moved to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.geometry.shapes import Box, Depth, Transform
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.methods.kept_poses import (
    Allows,
    Decision,
    HypothesesConfig,
    Hypothesis,
    Likely,
    Proposal,
    agreement,
    may_rest,
    moved_with_box,
    still_agrees,
)
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.registration import (
    Evidence,
    RegistrationConfig,
    evidence,
    registered,
)
from asdfviz.pose.box_size import measured_share

UNKNOWN = 0.5
"""Taken for the network's preference before the first frame."""


class PartHypotheses:
    """The poses of one part that are kept; one for each sequence."""

    def __init__(
        self,
        part: Part,
        shape: PartShape,
        *,
        config: HypothesesConfig,
        registration: RegistrationConfig,
        phase: int = 0,
    ) -> None:
        self._part, self._shape = part, shape
        self._config, self._registration = config, registration
        self._middle = np.append(shape.surface.mean(axis=0), 1.0)
        self._kept: list[Hypothesis] = []
        self._box: Box | None = None
        self._frames = phase
        """Counted from another number for each part, so that not all are looked at together."""
        self._rest: tuple[int, Evidence] | None = None
        """The frame in which `rests` judged the most trusted pose, and how."""

    def rests(self, box_xyxy: Box, frame: Frame) -> Transform | None:
        """The most trusted pose if the part still lies there by its box (pixels) and by depth, and is
        not to be looked at; `step` then takes no proposals."""
        config, best, box = self._config, next(iter(self._kept), None), self._box
        if frame.depth is None or best is None or box is None:
            return None
        is_due = self._frames % config.looked_every == 0
        if is_due or not may_rest(best, box, box_xyxy, config=config):
            return None
        seen = self._judged(best.T_camera_part, frame, box_xyxy)
        if not still_agrees(best.evidence, seen, config=config):
            return None
        self._rest = (frame.index, seen)
        return best.T_camera_part

    def step(
        self,
        proposals: Sequence[Proposal],
        frame: Frame,
        *,
        box_xyxy: Box | None,
        likely: Likely | None = None,
        allows: Allows | None = None,
    ) -> Decision | None:
        """Take in a frame; None where nothing is known of the part, or nothing seen of it.

        Args:
            proposals: this frame's first poses, the preferred one first; registered or not.
            frame: with depth; without, and where its box shows none, the first proposal is the answer.
            box_xyxy: where the part was detected, pixels, or None.
            likely: of any pose; left out, the proposals' own preferences stand for it.
            allows: whether the most trusted pose may rather be another one; left out, any.
        """
        self._frames += 1
        if self._rest is not None and self._rest[0] == frame.index:
            return self._stayed(self._rest[1], box_xyxy)
        if likely is None and proposals:
            likely = partial(self._likely, proposals)
        if frame.depth is None or self._is_blind(frame.depth, box_xyxy):
            return self._without_depth(proposals, frame, box_xyxy, likely)
        if allows is not None and self._kept:
            proposals = self._allowed(proposals, partial(allows, self._kept[0].T_camera_part))
        found: list[Hypothesis] = []
        for place, old in enumerate(self._kept):
            found += self._carried(old, likely, frame, box_xyxy)
            if place == 0 and self._is_settled(found[0], proposals):
                found += [rest.older() for rest in self._kept[1:]]
                proposals = proposals[:1]  # it may have moved a little
                break
        for place, proposal in enumerate(proposals):
            if place > 0 and any(
                self._is_same(proposal.T_camera_part, other.T_camera_part) for other in found
            ):
                continue
            found.append(self._begun(proposal, frame, box_xyxy, likely))
        self._box = box_xyxy if box_xyxy is not None else self._box
        self._kept = self._apart(self._overtaken(found))[: self._config.kept]
        return self._decided(box_xyxy)

    def _stayed(self, seen: Evidence, box_xyxy: Box | None) -> Decision | None:
        """The part rests: the network says nothing of it in this frame."""
        best, *rest = (one.older() for one in self._kept)
        trust = self._trusted(best, seen, best.liked, box_xyxy)
        self._kept = [replace(best, trust=trust, evidence=seen), *rest]
        self._box = box_xyxy
        return self._decided(box_xyxy)

    def _allowed(
        self, proposals: Sequence[Proposal], allowed: Callable[[Transform], bool]
    ) -> list[Proposal]:
        """Those of the proposals that are; others are kept no longer either."""
        best, *rest = self._kept
        self._kept = [best, *(h for h in rest if allowed(h.T_camera_part))]
        return [p for p in proposals if allowed(p.T_camera_part)]

    @property
    def best(self) -> Transform | None:
        """The most trusted pose so far, T_camera_part."""
        return self._kept[0].T_camera_part if self._kept else None

    def move(self, T_camera_part: Transform) -> None:
        """The most trusted pose is known better than it was."""
        self._kept[0] = replace(self._kept[0], T_camera_part=T_camera_part)

    def disown(self) -> None:
        """The most trusted pose is that of another thing: it is kept no longer."""
        self._kept = self._kept[1:]

    def _overtaken(self, found: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Older poses lose trust where a new one explains the depth better.

        A part that moves may cover the very place where it was, which then counts as hidden.
        """
        new = max((one.evidence.depth for one in found if one.frames == 1), default=0.0)

        def left(one: Hypothesis) -> float:
            behind = max(0.0, new - one.evidence.depth)
            return one.trust * max(0.0, 1 - self._config.overtaken * behind)

        return [one if one.frames == 1 else replace(one, trust=left(one)) for one in found]

    def _is_blind(self, depth: Depth, box_xyxy: Box | None) -> bool:
        return box_xyxy is not None and measured_share(box_xyxy, depth) < self._config.blind

    def _without_depth(
        self,
        proposals: Sequence[Proposal],
        frame: Frame,
        box_xyxy: Box | None,
        likely: Likely | None,
    ) -> Decision | None:
        if not proposals:
            return None
        first = self._begun(proposals[0], frame, box_xyxy, likely)
        return Decision(first, first.trust, is_measured=False)

    def _carried(
        self, old: Hypothesis, likely: Likely | None, frame: Frame, box_xyxy: Box | None
    ) -> list[Hypothesis]:
        """A kept pose in the new frame: where the box went, if that is better, and where it was."""
        # Not registered anew: that draws what rests to the table, and what moves is found again.
        T_camera_part, seen = old.T_camera_part, self._judged(old.T_camera_part, frame, box_xyxy)
        stayed = self._aged(old, T_camera_part, seen, likely, box_xyxy)
        moved = moved_with_box(
            T_camera_part, self._box, box_xyxy, frame.camera.K, self._middle, config=self._config
        )
        if moved is None or seen.agreeing >= self._config.left:
            return [stayed]
        seen_there = self._judged(moved, frame, box_xyxy)
        if self._value(seen_there) <= self._value(seen):
            return [stayed]
        gone = self._aged(old, moved, seen_there, likely, box_xyxy)
        # What lay there may be there again when the hand is gone.
        is_covered = old.rested >= self._config.lain and seen.visible < self._config.covered
        return [replace(gone, rested=1), *([stayed] if is_covered else [])]

    def _aged(
        self,
        old: Hypothesis,
        T_camera_part: Transform,
        seen: Evidence,
        likely: Likely | None,
        box_xyxy: Box | None,
    ) -> Hypothesis:
        liked = self._liked(T_camera_part, old.liked, old.frames, likely)
        trust = self._trusted(old, seen, liked, box_xyxy)
        return Hypothesis(T_camera_part, trust, liked, seen, old.frames + 1, old.rested + 1)

    def _trusted(self, old: Hypothesis, seen: Evidence, liked: float, box: Box | None) -> float:
        """Trust in a kept pose after a frame in which this is seen of it."""
        weight = self._config.memory * max(seen.visible, 0.05)
        return old.trust + weight * (agreement(seen, liked, box, config=self._config) - old.trust)

    def _begun(
        self, proposal: Proposal, frame: Frame, box_xyxy: Box | None, likely: Likely | None
    ) -> Hypothesis:
        """A new pose, registered unless depth has turned it already."""
        T_camera_part = proposal.T_camera_part
        seen = self._judged(T_camera_part, frame, box_xyxy)
        fitted = None
        if not proposal.is_fitted:
            fitted = registered(T_camera_part, self._shape, frame, config=self._registration)
        if fitted is not None:
            seen_fitted = self._judged(fitted, frame, box_xyxy)
            if self._value(seen_fitted) > self._value(seen):
                T_camera_part, seen = fitted, seen_fitted
        liked = self._liked(T_camera_part, UNKNOWN, 0, likely)
        # What is hidden cannot be trusted yet.
        trust = seen.visible * agreement(seen, liked, box_xyxy, config=self._config)
        return Hypothesis(T_camera_part, trust, liked, seen, 1)

    def _liked(
        self, T_camera_part: Transform, before: float, frames: int, likely: Likely | None
    ) -> float:
        """The network's preference over time: a mean at first, then one that forgets."""
        if likely is None:
            return before
        weight = max(self._config.network_memory, 1 / (frames + 2))
        return before + weight * (likely(T_camera_part) - before)

    def _likely(self, proposals: Sequence[Proposal], T_camera_part: Transform) -> float:
        """What the network thought of the proposal that is this pose; 0 where none is."""
        return max(
            (p.likely for p in proposals if self._is_same(p.T_camera_part, T_camera_part)),
            default=0.0,
        )

    def _judged(self, T_camera_part: Transform, frame: Frame, box_xyxy: Box | None) -> Evidence:
        return evidence(
            T_camera_part, self._shape, frame, box_xyxy=box_xyxy, config=self._registration
        )

    def _is_settled(self, first: Hypothesis, proposals: Sequence[Proposal]) -> bool:
        """Whether the trusted pose fits and the frame's own first pose confirms it."""
        return (
            bool(proposals)
            and first.evidence.agreeing >= self._config.enough
            and first.evidence.visible >= 0.5
            and self._is_same(proposals[0].T_camera_part, first.T_camera_part)
        )

    def _apart(self, found: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The different ones, the most trusted first."""
        kept: list[Hypothesis] = []
        for one in sorted(found, key=lambda h: -h.trust):
            T = one.T_camera_part
            same = (i for i, other in enumerate(kept) if self._is_same(T, other.T_camera_part))
            place = next(same, None)
            if place is None:
                kept.append(one)
            elif self._value(one.evidence) > self._value(kept[place].evidence):
                kept[place] = replace(kept[place], T_camera_part=T, evidence=one.evidence)
        return kept

    def _value(self, seen: Evidence) -> float:
        return seen.value(self._registration)

    def _decided(self, box_xyxy: Box | None) -> Decision | None:
        if not self._kept:
            return None
        best, rival = self._kept[0], self._kept[1] if len(self._kept) > 1 else None
        if box_xyxy is None and best.evidence.depth < self._config.unseen:
            return None
        return Decision(best, best.trust - max(0.0, rival.trust if rival else 0.0), rival)

    def _is_same(self, T_a: Transform, T_b: Transform) -> bool:
        apart = (T_a - T_b)[:3] @ self._middle
        if math.sqrt(apart @ apart) > self._config.same_distance * self._part.diameter:
            return False
        angle = symmetric_angle(T_a, T_b, self._part.symmetries)
        return angle < math.radians(self._config.same_angle_deg)
