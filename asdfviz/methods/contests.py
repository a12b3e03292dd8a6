"""Where two things may be the same part, that is it on which the part's pose agrees better with what is seen.

Not in the paper. A detector tells parts by their looks, and a thing of like colour and size may look more
like a part than the part itself; its outline and its depth hardly ever fit as well.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import box_middle, longer_side, overlap
from asdfviz.geometry.shapes import Box
from asdfviz.methods.assignment import scores_in_classes
from asdfviz.methods.looked_at import LookedAt

Look: TypeAlias = Callable[[Mapping[str, Detection], Frame], Mapping[str, LookedAt]]
"""What crops of detections tell of the parts that they may be; a part without a pose is absent."""
LOOKS = 5
"""So many of a thing are remembered."""
_LEAST = 0.02
"""Of scores and probabilities, so that one alone cannot decide for ever."""
_POSELESS = 0.35
"""Agreement that stands for no pose at all, or a worse one. Of boxes of other things seven in a hundred
had none, of the parts' own one in two hundred, where they were hidden or dark."""


@dataclass(frozen=True)
class ContestsConfig:
    """When things contest for a part, and what decides.

    Measured on 653 pairs of a part and another thing in twelve sequences: by score alone 50 were
    decided wrongly, with these figures 20.
    """

    enabled: bool = True
    """On or off."""
    close: float = 0.4
    """Share of the best box's score from which another thing of the class contests;"""
    most: int = 2
    """so many at most."""
    agreement: float = 4.0
    """Power to which a pose's agreement with outline and depth counts beside the score,"""
    network: float = 0.5
    """and the probability of the rotation that the crop network likes best."""
    reach: float = 1.0
    """A box whose middle is nearer to an earlier one than this times the longer side of the smaller of
    them shows the same thing: those that contest lie apart,"""
    memory: float = 0.2
    """of which a frame weighs this much, once there were enough, 0 to 1,"""
    every: int = 4
    """and which is looked at again after so many frames."""
    behind: float = 0.1
    """What lost by more than this (logarithm of a score)"""
    often: int = 3
    """after so many frames is not the part either while the winner is not to be seen, unless it comes to
    be worth more by itself,"""
    forgotten: int = 200
    """for so many frames at most."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 < self.close <= 1 or self.every < 1:
            raise MethodError(
                f"contests.close is {self.close:g} and contests.every {self.every}: close must be "
                "above 0 and at most 1, every 1 or more"
            )


@dataclass(slots=True, eq=False)
class _Thing:
    """What was seen of a thing when it was taken for a part."""

    part: str
    box_xyxy: Box
    score: float = 0.0
    """Logarithm of its score in the part's class, the mean over time,"""
    worths: deque[float] = field(default_factory=lambda: deque(maxlen=LOOKS))
    """and of what that is multiplied by, by each of the last looks."""
    frames: int = 0
    """In which it contested,"""
    looks: int = 0
    """in which it was looked at,"""
    looked: int = 0
    """the last one of these,"""
    contested: int = 0
    """the last one of those,"""
    seen: int = 0
    """and the last frame in which it was seen."""
    beaten_by: _Thing | None = None
    """What it lost to clearly, if it did not win since."""

    @property
    def value(self) -> float:
        """How well it is the part, logarithm.

        By the middle one of the last looks: in one of them a hand may have been in front of it.
        """
        return self.score + (float(np.median(self.worths)) if self.worths else 0.0)


@dataclass(slots=True, eq=False)
class Contests:
    """Decides them in one sequence."""

    assembly: Assembly
    look: Look
    config: ContestsConfig
    _things: list[_Thing] = field(default_factory=list[_Thing], init=False)
    _frame: int = field(default=0, init=False)

    def step(
        self, found: Mapping[str, Detection], detections: Sequence[Detection], frame: Frame
    ) -> dict[str, Detection]:
        """Which detection is which part, after things that may be the same part were compared.

        Parts that share a class keep their boxes: there, the next box belongs to another part.

        Args:
            found: by part, the detection that was taken for it.
            detections: of the frame.
            frame: with depth, or nothing is compared.
        """
        decided = dict(found)
        self._frame += 1
        if not self.config.enabled or frame.depth is None:
            return decided
        things = {name: self._contestants(name, found, detections) for name in found}
        things = {name: boxes for name, boxes in things.items() if len(boxes) > 1}
        known = {
            name: [self._known(name, detection) for detection in boxes]
            for name, boxes in things.items()
        }
        for place in range(1 + self.config.most):
            here = {name: seen[place] for name, seen in known.items() if place < len(seen)}
            self._look_again(here, {name: things[name][place] for name in here}, frame)
        for name, boxes in things.items():
            best = self._winner(known[name])
            if best is None:
                del decided[name]
            else:
                decided[name] = boxes[best]
        alone = [name for name in found if name not in things]
        for name in self._still_beaten(alone, found, frame):
            del decided[name]
        oldest = self._frame - self.config.forgotten
        self._things = [thing for thing in self._things if thing.seen >= oldest]
        return decided

    def _contestants(
        self, name: str, found: Mapping[str, Detection], detections: Sequence[Detection]
    ) -> list[Detection]:
        """The part's box, and those of other things that look about as much like it."""
        label, config = self.assembly.parts[name].detector_class, self.config
        if Counter(part.detector_class for part in self.assembly.parts.values())[label] > 1:
            return []
        taken = [d.box_xyxy for d in found.values()]
        kept = [found[name]]
        scored = [(scores_in_classes(d).get(label, 0.0), d) for d in detections]
        for score, detection in sorted(scored, key=lambda one: -one[0]):
            if score < config.close * found[name].score or len(kept) > config.most:
                break
            if not any(overlap(detection.box_xyxy, box) > 0 for box in taken):  # other things
                kept.append(replace(detection, label=label, score=score))
                taken.append(detection.box_xyxy)
        return kept

    def _still_beaten(
        self, alone: Sequence[str], found: Mapping[str, Detection], frame: Frame
    ) -> list[str]:
        """Parts whose only box shows what lost to another thing, which is not to be seen now.

        It is looked at as if it still contested: what was half hidden when it lost, and now fits better
        than what it lost to ever did, is the part after all.
        """
        lost: dict[str, _Thing] = {}
        for name in alone:
            thing = self._near(name, found[name].box_xyxy)
            if thing is not None:
                thing.box_xyxy, thing.seen = found[name].box_xyxy, self._frame
                if thing.beaten_by in self._things:
                    self._score(thing, found[name])
                    lost[name] = thing
        self._look_again(lost, found, frame)
        for thing in lost.values():
            winner = thing.beaten_by
            if winner is not None and thing.value > winner.value:
                thing.beaten_by = None
        return [name for name, thing in lost.items() if thing.beaten_by is not None]

    def _winner(self, things: Sequence[_Thing]) -> int | None:
        """The place of the thing that is worth most; None if all lost to what is not there now.

        What lost to a thing that is hidden or carried now is not the part either.
        """
        alive = [t.beaten_by in things or t.beaten_by not in self._things for t in things]
        values = [t.value if a else -np.inf for t, a in zip(things, alive, strict=True)]
        if not any(alive):
            return None
        best = int(np.argmax(values))
        winner = things[best]
        winner.beaten_by = None
        for thing in things:
            often = min(thing.frames, winner.frames) >= self.config.often
            if thing is not winner and often and winner.value - thing.value > self.config.behind:
                thing.beaten_by = winner
        return best

    def _known(self, name: str, detection: Detection) -> _Thing:
        """What is remembered of a thing, with its score in this frame; one that is new begins."""
        thing = self._near(name, detection.box_xyxy)
        if thing is None:
            thing = _Thing(name, detection.box_xyxy)
            self._things.append(thing)
        if self._frame - thing.contested > 2 * self.config.every:  # it may look otherwise by now
            thing.frames = thing.looks = 0
            thing.worths.clear()
        thing.box_xyxy, thing.seen, thing.contested = detection.box_xyxy, self._frame, self._frame
        self._score(thing, detection)
        return thing

    def _score(self, thing: _Thing, detection: Detection) -> None:
        """Take in the score that the detector gives a thing."""
        thing.frames += 1
        score = float(np.log(max(detection.score, _LEAST)))
        thing.score += max(self.config.memory, 1 / thing.frames) * (score - thing.score)

    def _near(self, name: str, box_xyxy: Box) -> _Thing | None:
        """The thing in the place of a box, if it was not met in this frame yet."""
        middle = box_middle(box_xyxy)

        def distance(thing: _Thing) -> float:
            return float(np.linalg.norm(box_middle(thing.box_xyxy) - middle))

        mine = [t for t in self._things if t.part == name and t.seen < self._frame]
        near = min(mine, key=distance, default=None)
        if near is None:
            return None
        smaller = min(longer_side(box) for box in (near.box_xyxy, box_xyxy))
        return near if distance(near) <= self.config.reach * smaller else None

    def _look_again(
        self, things: Mapping[str, _Thing], boxes: Mapping[str, Detection], frame: Frame
    ) -> None:
        """Look at those of the parts' things that are due."""
        due = {name: boxes[name] for name, thing in things.items() if self._is_due(thing)}
        if due:
            looks = self.look(due, frame)
            for name in due:
                self._hear(things[name], looks.get(name))

    def _is_due(self, thing: _Thing) -> bool:
        """Whether to look at it in this frame: twice at first, then now and then."""
        return thing.looks < 2 or self._frame - thing.looked >= self.config.every

    def _hear(self, thing: _Thing, look: LookedAt | None) -> None:
        """Take in how well the part's best pose agrees with a thing."""
        worth = self.config.agreement * float(np.log(_POSELESS))
        if look is not None:
            agreement = max(look.settled[0].agreement, _POSELESS)
            liked = max(float(look.answer.probabilities[0]), _LEAST)
            worth = self.config.agreement * float(np.log(agreement))
            worth += self.config.network * float(np.log(liked))
        thing.looks += 1
        thing.worths.append(worth)
        thing.looked = self._frame
