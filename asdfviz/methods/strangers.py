"""What lies still and has lost to a part often enough is not that part, also while the part is hidden.

Not in the paper. A thing that looks like a part is harmless as long as the part itself can be seen; once
a hand covers that, the thing would be taken for it. But it was there all the time. So would one part be taken
for another that it looks more like than like itself, as a base that stands on end; and what then is in the
hand, for the base.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from asdfviz.datatypes import Assembly, Detection
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import iou_matrix, overlap
from asdfviz.geometry.shapes import Box
from asdfviz.methods.assignment import scores_in_classes


@dataclass(frozen=True)
class StrangersConfig:
    """When a thing is a stranger to a part, and what that means."""

    enabled: bool = True
    """On or off."""
    still: float = 0.7
    """A box that overlaps an earlier one more than this (intersection over union) shows the same
    thing."""
    part: float = 0.3
    """Score from which a box that was taken for a part counts as the part;"""
    like: float = 0.08
    """a thing elsewhere that scores this in its class has then lost to it,"""
    ahead: float = 0.1
    """if it scored less by this: what is as likely to be the part has not lost."""
    exchanged: float = 2.0
    """If it was taken for another part, and that is so much likelier, together with what was taken for this one,
    than both exchanged, it has lost twice, whatever it scored here."""
    same: float = 0.3
    """Elsewhere is where boxes overlap less than this."""
    often: int = 8
    """A thing is a stranger that has lost more often than it has won by this,"""
    most: int = 20
    """which is counted no farther than to this, either way."""
    left: float = 0.02
    """Share that its score in the class keeps then,"""
    liker: float = 1.15
    """unless that is more than this times the most it lost with: something else has come there,
    perhaps the part to its place."""
    fades: float = 0.98
    """Share that is left of that with each further defeat: of 785 boxes of strangers in two sequences
    18 then score so much, and 36 of 118 of parts that had come to the place of one; 8 and 1 with 1."""
    forgotten: int = 200
    """Frames after which a thing that was not seen again is forgotten."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 1 <= self.often <= self.most or not 0 <= self.left <= 1:
            raise MethodError(
                f"names.strangers.often is {self.often}, most {self.most} and left "
                f"{self.left:g}: often must be 1 or more and no more than most, left from 0 to 1"
            )
        if not 0 < self.fades <= 1:
            raise MethodError(
                f"names.strangers.fades is {self.fades:g}, use a share above 0, up to 1"
            )
        if not self.exchanged >= 1:
            raise MethodError(
                f"names.strangers.exchanged is {self.exchanged:g}, use a factor from 1 on"
            )
        if not self.liker >= 1:
            raise MethodError(f"names.strangers.liker is {self.liker:g}, use a factor from 1 on")


@dataclass(slots=True, eq=False)
class _Thing:
    box_xyxy: Box
    seen: int
    """The last frame."""
    lost: dict[str, int] = field(default_factory=dict[str, int])
    """By class, how much more often it lost than it won."""
    scored: dict[str, float] = field(default_factory=dict[str, float])
    """By class, the most that it lost with, less what has faded."""


class _Winner(NamedTuple):
    """A box that was taken for a part."""

    box_xyxy: Box
    score: float
    scores: Mapping[str, float]
    """In all classes, by the best box of the thing that it shows."""


class Strangers:
    """Knows the things of one sequence."""

    def __init__(self, assembly: Assembly, *, config: StrangersConfig) -> None:
        """Begin a sequence."""
        self._config = config
        self._counts: dict[str, int] = {}
        for part in assembly.parts.values():
            self._counts[part.detector_class] = self._counts.get(part.detector_class, 0) + 1
        self._things: list[_Thing] = []
        self._frame = 0

    def told(self, detections: Sequence[Detection]) -> tuple[Detection, ...]:
        """The detections; those of strangers score less in the class to which they lost."""
        if not self._config.enabled or not self._things or not detections:
            return tuple(detections)
        return tuple(
            d if place is None else self._weighed(d, self._things[place])
            for d, place in zip(detections, self._places(detections), strict=True)
        )

    def see(self, detections: Sequence[Detection], found: Mapping[str, Detection]) -> None:
        """Note who won and who lost in a frame.

        Args:
            detections: of the frame, as the detector and names have them.
            found: by part, the detection that was taken for it.
        """
        if not self._config.enabled:
            return
        self._frame += 1
        seen = self._seen(detections)
        won: dict[str, list[_Winner]] = {}
        for detection, at in zip(found.values(), self._places([*found.values()]), strict=True):
            scores = {} if at is None else seen.get(at, {})
            winner = _Winner(detection.box_xyxy, detection.score, scores)
            won.setdefault(detection.label, []).append(winner)
        for place, scores in seen.items():
            for label, score in scores.items():
                if label in self._counts and score >= self._config.like:
                    self._judge(self._things[place], label, scores, won)
        oldest = self._frame - self._config.forgotten
        self._things = [thing for thing in self._things if thing.seen >= oldest]

    def disown(self, detections: Sequence[Detection]) -> None:
        """What these show is nothing of their class, though it won: something else told so."""
        for detection, place in zip(detections, self._places(detections), strict=True):
            if self._config.enabled and place is not None:
                thing, label = self._things[place], detection.label
                thing.lost[label] = max(thing.lost.get(label, 0), self._config.often)
                thing.scored[label] = max(thing.scored.get(label, 0.0), detection.score)

    def _seen(self, detections: Sequence[Detection]) -> dict[int, dict[str, float]]:
        """The things in the frame, by place in the list, with their best score in every class."""
        things: dict[int, dict[str, float]] = {}
        for detection, known in zip(detections, self._places(detections), strict=True):
            place = known
            if place is None:
                place = len(self._things)
                self._things.append(_Thing(detection.box_xyxy, self._frame))
            self._things[place].seen = self._frame
            scores = things.setdefault(place, {})
            for label, score in scores_in_classes(detection).items():
                scores[label] = max(score, scores.get(label, 0.0))
        return things

    def _judge(
        self,
        thing: _Thing,
        label: str,
        scores: Mapping[str, float],
        won: Mapping[str, Sequence[_Winner]],
    ) -> None:
        """Count a thing's victory or defeat in a class; neither where parts of it are missing."""
        config, before, score = self._config, thing.lost.get(label, 0), scores[label]
        winners, least = won.get(label, ()), max(config.part, score + config.ahead)
        if any(overlap(thing.box_xyxy, w.box_xyxy) > config.same for w in winners):
            thing.lost[label] = max(before - 1, -config.most)
        elif len(winners) == self._counts[label]:
            is_another = self._is_another(thing, label, scores, won)
            if is_another or min(w.score for w in winners) >= least:
                thing.lost[label] = min(before + (2 if is_another else 1), config.most)
                faded = config.fades * thing.scored.get(label, 0.0)
                thing.scored[label] = max(score, faded)

    def _is_another(
        self,
        thing: _Thing,
        label: str,
        scores: Mapping[str, float],
        won: Mapping[str, Sequence[_Winner]],
    ) -> bool:
        """Whether it was taken for something of another class, and that is far likelier, together with what was
        taken for this class, than if it changed with any of those."""
        config = self._config
        taken = (
            own
            for own, winners in won.items()
            if own != label
            and any(overlap(w.box_xyxy, thing.box_xyxy) > config.still for w in winners)
        )
        return any(
            all(
                scores.get(own, 0.0) * w.scores.get(label, 0.0)
                > config.exchanged * scores[label] * max(w.scores.get(own, 0.0), config.like)
                for w in won[label]
            )
            for own in taken
        )

    def _places(self, detections: Sequence[Detection]) -> list[int | None]:
        """Which known thing each box shows."""
        if not self._things or not detections:
            return [None] * len(detections)
        overlaps = iou_matrix(
            np.stack([d.box_xyxy for d in detections]),
            np.stack([thing.box_xyxy for thing in self._things]),
        )
        best = overlaps.argmax(axis=1)
        is_still = overlaps.max(axis=1) > self._config.still
        return [int(i) if still else None for i, still in zip(best, is_still, strict=True)]

    def _weighed(self, detection: Detection, thing: _Thing) -> Detection:
        config = self._config
        strange = {
            label
            for label, score in scores_in_classes(detection).items()
            if thing.lost.get(label, 0) >= config.often
            and score <= config.liker * thing.scored[label]
        }
        if not strange:
            return detection
        left = config.left
        scores = {k: v * (left if k in strange else 1.0) for k, v in detection.class_scores.items()}
        own = detection.score * (left if detection.label in strange else 1.0)
        return replace(detection, score=own, class_scores=scores)
