"""From a frame to boxes of parts: detect, name, tell which box is which part, look again, compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.geometry.shapes import Box
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.contests import Contests
from asdfviz.methods.named_nearby import NamedNearby
from asdfviz.methods.network import Detects
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.second_look import SecondLook, SecondLookConfig
from asdfviz.methods.strangers import Strangers
from asdfviz.methods.thing_names import NamesConfig, ThingNames
from asdfviz.pose.box_size import BoxSizes
from asdfviz.state.twins import renamed


class PartFinder:
    """Finds the parts of an assembly in one sequence."""

    def __init__(
        self,
        assembly: Assembly,
        detector: Detects,
        shapes: Mapping[str, PartShape],
        *,
        looker: object | None,
        names: NamesConfig,
        second_look: SecondLookConfig,
        by_size: bool = True,
        by_class: bool = False,
        contests: Contests | None = None,
    ) -> None:
        """Begin a sequence.

        Args:
            assembly: which parts there are.
            detector: gives boxes.
            shapes: of the parts.
            looker: the crop network, which may tell names; None where there is none.
            names: how much it has to say.
            second_look: where the detector looks again.
            by_size: whether depth rules out boxes that are too large for a part.
            by_class: whether every class takes its best boxes, whatever else may be there.
            contests: decides between things that may be the same part; None: the best box does.

        Raises:
            MethodError: an option is out of its range.
        """
        self._assembly, self._detector = assembly, detector
        corners = {name: shapes[name].corners for name in assembly.parts}
        self._by_class = by_class
        self._sizes = BoxSizes.of(corners) if by_size else None
        self._names = ThingNames(assembly, looker, config=names)
        self._strangers = Strangers(assembly, config=names.strangers)
        self._second_look = SecondLook(assembly, detector, config=second_look)
        self._contests = contests
        self._nearby = NamedNearby(assembly, self._names, config=names.nearby)
        self._boxes: dict[str, Box] = {}

    def find(self, frame: Frame) -> tuple[tuple[Detection, ...], dict[str, Detection]]:
        """All boxes of a frame, and which of them are which parts."""
        self._names.begin()
        self._nearby.begin()
        detections = self._names.told(frame, self._detector.detect(frame.rgb))
        found = self._assigned(detections, frame)
        if len(found) < len(self._assembly.parts):
            more = self._names.beyond(frame, detections, found)
            if len(more) > len(detections):
                detections, found = more, self._assigned(more, frame)
        more = self._second_look.step(frame, detections, found)
        if len(more) > len(detections):
            looked = self._names.told(frame, more[len(detections) :])
            detections = (*detections, *looked)
            found = self._assigned(detections, frame)
        named = self._nearby.boxes(frame, found)
        if named:
            detections = (*detections, *named)
            found = self._assigned(detections, frame)
        if self._contests is not None:
            found = self._contests.step(found, self._strangers.told(detections), frame)
        self._strangers.see(detections, found)
        return detections, found

    def keep(self, found: Mapping[str, Detection], frame: Frame) -> None:
        """Remember where parts were: identical ones keep their names by it."""
        self._boxes |= {name: detection.box_xyxy for name, detection in found.items()}
        self._nearby.keep(found, frame)

    def disown(self, boxes: Sequence[Detection]) -> None:
        """What these boxes show is nothing of their class, also while it lies there."""
        self._strangers.disown(boxes)

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._boxes = renamed(self._boxes, names)

    def _assigned(self, detections: Sequence[Detection], frame: Frame) -> dict[str, Detection]:
        fitting = None
        if self._sizes is not None:
            fitting = partial(self._sizes.fitting, depth=frame.depth, K=frame.camera.K)
        return assign_detections(
            self._strangers.told(detections),
            self._assembly,
            previous=self._boxes,
            fitting=fitting,
            by_class=self._by_class,
        )
