"""Which part a box shows, asked of the crop network, which saw far more parts than the detector did.

Not in the paper. The crop network's opinion and the detector's are averaged, over a few frames where a
thing lies still; and what stands out of the table though no box is about it is named too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.detector.crop_classes import class_name
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import iou_matrix, share_inside
from asdfviz.geometry.shapes import Box, Intrinsics, Rgb
from asdfviz.methods.assignment import scores_in_classes
from asdfviz.methods.named_nearby import NearbyConfig
from asdfviz.methods.seen_table import heights_in
from asdfviz.methods.strangers import StrangersConfig
from asdfviz.pose.blobs import BlobConfig, standing_out
from asdfviz.pose.box_size import box_distance


@runtime_checkable
class NamesThings(Protocol):
    """Anything that tells which part is in a box."""

    @property
    def classes(self) -> tuple[str, ...]:
        """The classes that it knows."""
        ...

    @property
    def tells_names(self) -> bool:
        """Whether it was taught to."""
        ...

    def names(
        self,
        rgb: Rgb,
        K: Intrinsics,
        boxes: Sequence[Box],
        classes: Sequence[str],
        *,
        distances: Sequence[float | None],
    ) -> Float64[np.ndarray, "n c"]:
        """The probability of every class in every box."""
        ...


def namer(looker: object) -> NamesThings | None:
    """What is given, if it can be asked for names: most lookers cannot, or were not taught to."""
    return looker if isinstance(looker, NamesThings) and looker.tells_names else None


@dataclass(frozen=True)
class NamesConfig:
    """How much the crop network has to say."""

    enabled: bool = True
    """Whether it is asked; only one that was taught names can be."""
    weight: float = 0.5
    """Of its probability against the detector's score, 0 to 1."""
    still: float = 0.8
    """A box that overlaps one of the frame before more than this (intersection over union) shows the
    same thing,"""
    memory: float = 0.2
    """of which a frame weighs this much, once there were enough, 0 to 1,"""
    every: int = 4
    """and which is looked at again after so many frames."""
    least: float = 0.5
    """Probability from which what stands out of the table is taken for a part."""
    explained: float = 0.5
    """Share of its box within a part's from which the part explains it, 0 to 1."""
    most: int = 8
    """Of these things so many are named a frame, the largest."""
    nearby: NearbyConfig = field(default_factory=NearbyConfig)
    """Where missing parts are looked for by it."""
    strangers: StrangersConfig = field(default_factory=StrangersConfig)
    """What is known not to be a part, since it was there beside it."""
    blobs: BlobConfig = field(default_factory=lambda: BlobConfig(rise=0.003, min_px=30))
    """What stands out of the table: flatter and smaller things than a second look is worth."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 <= self.weight <= 1 or self.every < 1:
            raise MethodError(
                f"names.weight is {self.weight:g} and names.every {self.every}: weight must be "
                "from 0 to 1, every 1 or more"
            )


@dataclass(slots=True, eq=False)
class _Known:
    """A thing and what it was taken for."""

    box_xyxy: Box
    probabilities: Float64[np.ndarray, "c"]
    looks: int = 0
    seen: int = 0
    """Frame in which it was there last,"""
    looked: int = 0
    """and in which it was looked at last."""

    def is_due(self, now: int, *, every: int) -> bool:
        """Whether to look at it in this frame: twice at first, then now and then."""
        return self.looked < now and (self.looks < 2 or now - self.looked >= every)

    def hear(self, answer: Float64[np.ndarray, "c"], now: int, *, memory: float) -> None:
        """Take in what the network says of it."""
        self.looks += 1
        weight = max(memory, 1 / self.looks)
        self.probabilities = self.probabilities + weight * (answer - self.probabilities)
        self.looked = now


class ThingNames:
    """Names things in one sequence."""

    def __init__(self, assembly: Assembly, looker: object, *, config: NamesConfig) -> None:
        """Begin a sequence; `looker` may be anything, and is asked only if it names things.

        It is asked of the parts that it knows: of others it has nothing to say.
        """
        self._looker = namer(looker) if config.enabled else None
        self._config = config
        parts = {part.detector_class: part for part in assembly.parts.values()}
        classes = {label: class_name(assembly, part) for label, part in parts.items()}
        known = () if self._looker is None else self._looker.classes
        self._classes = {label: name for label, name in classes.items() if name in known}
        if not self._classes:
            self._looker = None
        self._keypoints = {label: len(part.keypoints) for label, part in parts.items()}
        self._known: list[_Known] = []
        self._frame = 0

    @property
    def can_look(self) -> bool:
        """Whether there is a network that was taught names, of parts that it knows."""
        return self._looker is not None

    def begin(self) -> None:
        """A frame comes."""
        self._frame += 1

    def told(self, frame: Frame, detections: Sequence[Detection]) -> tuple[Detection, ...]:
        """The detections, those of parts with what the crop network makes of them."""
        mine = [i for i, d in enumerate(detections) if d.label in self._keypoints]
        if self._looker is None or not mine:
            return tuple(detections)
        told = list(detections)
        boxes = [detections[i].box_xyxy for i in mine]
        for i, probabilities in zip(mine, self._named(frame, boxes), strict=True):
            told[i] = self._merged(detections[i], probabilities)
        return tuple(told)

    def beyond(
        self, frame: Frame, detections: Sequence[Detection], found: Mapping[str, Detection]
    ) -> tuple[Detection, ...]:
        """The detections, and boxes about what stands out of the table and is taken for a part.

        Args:
            frame: with depth, or nothing is added.
            detections: of the frame.
            found: which of them stand for parts.
        """
        if self._looker is None or frame.depth is None:
            return tuple(detections)
        boxes = [d.box_xyxy for d in found.values()]
        config = self._config.blobs
        blobs = [
            blob
            for blob in standing_out(heights_in(frame, config.table), config=config)
            if not any(share_inside(blob, box) > self._config.explained for box in boxes)
        ][: self._config.most]
        more: list[Detection] = []
        for blob, probabilities in zip(blobs, self._named(frame, blobs), strict=True):
            best = int(probabilities.argmax())
            if probabilities[best] >= self._config.least:
                bare = self._undetected(blob, [*self._classes][best])
                more.append(self._merged(bare, probabilities))
        return (*detections, *more)

    def look(self, frame: Frame, boxes: Sequence[Box]) -> dict[str, Float64[np.ndarray, "n"]]:
        """By label, its probability in every box, nothing remembered; empty without such a network."""
        if self._looker is None or not boxes:
            return {}
        answers = self._asked(frame, boxes)
        return dict(zip(self._classes, answers.T, strict=True))

    def named(self, box_xyxy: Box, label: str, probability: float) -> Detection:
        """A box that only the crop network gives, as sure as it is of the name."""
        bare = self._undetected(box_xyxy, label)
        return replace(bare, score=self._config.weight * probability)

    def _merged(self, detection: Detection, probabilities: Float64[np.ndarray, "c"]) -> Detection:
        weight = self._config.weight
        seen = scores_in_classes(detection)
        scores = {label: seen.get(label, 0.0) for label in self._keypoints}
        for label, p in zip(self._classes, probabilities, strict=True):
            scores[label] = (1 - weight) * scores[label] + weight * float(p)
        return replace(detection, score=scores[detection.label], class_scores=scores)

    def _undetected(self, box_xyxy: Box, label: str) -> Detection:
        """A box that the detector did not give: no keypoints, no score."""
        count = self._keypoints[label]
        return Detection(label, box_xyxy, np.zeros((count, 2)), np.zeros(count), 0.0)

    def _named(self, frame: Frame, boxes: Sequence[Box]) -> list[Float64[np.ndarray, "c"]]:
        """The probability of every label that the network knows in every box; things that lie still are remembered."""
        config, now = self._config, self._frame
        self._known = [one for one in self._known if now - one.seen <= config.every]
        things = [self._thing(box) for box in boxes]
        asked = [one for one in dict.fromkeys(things) if one.is_due(now, every=config.every)]
        if asked and self._looker is not None:
            answers = self._asked(frame, [one.box_xyxy for one in asked])
            for thing, answer in zip(asked, answers, strict=True):
                thing.hear(answer, now, memory=config.memory)
        return [thing.probabilities for thing in things]

    def _asked(self, frame: Frame, boxes: Sequence[Box]) -> Float64[np.ndarray, "n c"]:
        """What the network, which is there, says of boxes."""
        assert self._looker is not None
        depth, classes = frame.depth, [*self._classes.values()]
        distances = [None if depth is None else box_distance(box, depth) for box in boxes]
        return self._looker.names(frame.rgb, frame.camera.K, boxes, classes, distances=distances)

    def _thing(self, box_xyxy: Box) -> _Known:
        """What is in a box: known from before or from another box of the frame, or new."""
        best, place = 0.0, 0
        if self._known:
            near = iou_matrix(box_xyxy[None], np.stack([one.box_xyxy for one in self._known]))[0]
            place = len(near) - 1 - int(near[::-1].argmax())  # of equals the last
            best = float(near[place])
        if best <= self._config.still:
            place = len(self._known)
            self._known.append(_Known(box_xyxy, np.zeros(len(self._classes))))
        thing = self._known[place]
        if thing.seen < self._frame:
            thing.seen, thing.box_xyxy = self._frame, box_xyxy
        return thing
