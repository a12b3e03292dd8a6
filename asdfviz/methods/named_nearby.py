"""Looks for parts that no box is about near where they were: the crop network names what is there.

Not in the paper. The detector seldom sees a small part between fingers, where the crop network, shown the
right place, names it: of 59 visible parts in hands that had no box, in two sequences that no network
learnt with, it put the right name first for 58, and the detector, at twice the size, saw 27. So where a part
was a moment ago, and a way around it, crops are cut, and the best of them is a box if it is named surely.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import beside, box_middle, is_in_view, longer_side, overlap
from asdfviz.geometry.shapes import Box
from asdfviz.methods.seen_table import ANY_TABLE, heights_in
from asdfviz.pose.blobs import Heights
from asdfviz.pose.box_size import CORE, box_distance, window_about

FINEST = 0.05
"""Looks nearer to each other than this share of a box show the same."""
CLOSER = np.array([0.5, 0.5, 0.25])
"""Steps of looking more closely, as shares of the first ones."""


@dataclass(frozen=True)
class NearbyConfig:
    """How far and how long missing parts are looked for."""

    enabled: bool = True
    """On or off; only a crop network that was taught names can look."""
    remembered: int = 10
    """Frames for which a part is looked for where it was last."""
    reach: float = 0.03
    """How far a hand may take it in a frame, metres."""
    step: float = 0.5
    """From one look to the next, as a share of the longer side of its box."""
    most: int = 40
    """Looks a frame, for all missing parts together, the nearest first; and twelve for each that
    is promising."""
    promising: float = 0.1
    """Probability of its name from which the place is looked at more closely,"""
    least: float = 0.5
    """and from which the part is there."""
    sure: float = 0.5
    """A box farther away than a hand may have taken the part is the part's from this score on,"""
    weak: float = 0.25
    """and one nearby from this one; with less it is looked for all the same,"""
    same: float = 0.7
    """unless the box overlaps the one of before more than this (intersection over union)."""
    rise: float = 0.003
    """Where less than a quarter of what depth measures stands out of the table by this, metres, is no part."""
    taken: float = 0.6
    """Places that overlap a found part's box more than this (intersection over union) are not looked at."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not self.step >= FINEST or not 0 <= self.reach < np.inf:
            raise MethodError(
                f"names.nearby.step is {self.step:g} and reach {self.reach:g}: step must be "
                f"{FINEST:g} or more, reach 0 or more"
            )
        if not 0 <= self.promising <= self.least <= 1:
            raise MethodError(
                f"names.nearby.promising is {self.promising:g} and least {self.least:g}: use "
                "probabilities, least the larger one"
            )


@runtime_checkable
class Names(Protocol):
    """What names things, as `ThingNames` does."""

    @property
    def can_look(self) -> bool:
        """Whether there is a network that was taught names."""
        ...

    def look(self, frame: Frame, boxes: Sequence[Box]) -> Mapping[str, Float64[np.ndarray, "n"]]:
        """By class, its probability in every box."""
        ...

    def named(self, box_xyxy: Box, label: str, probability: float) -> Detection:
        """A box that only this gives."""
        ...


@dataclass(slots=True, eq=False)
class _Last:
    """Where a part was."""

    box_xyxy: Box
    seen: int
    """In which frame, and how far it had come since the frame before, pixels."""
    shift: Float64[np.ndarray, "2"]


class NamedNearby:
    """Looks in one sequence."""

    def __init__(self, assembly: Assembly, names: Names, *, config: NearbyConfig) -> None:
        """Begin a sequence.

        Of identical parts none is looked for: the next one would be found for it.
        """
        labels = {part.name: part.detector_class for part in assembly.parts.values()}
        counts = Counter(labels.values())
        self._labels = {name: label for name, label in labels.items() if counts[label] == 1}
        self._names, self._config = names, config
        self._last: dict[str, _Last] = {}
        self._frame = 0

    def begin(self) -> None:
        """A frame comes."""
        self._frame += 1

    def keep(self, found: Mapping[str, Detection], frame: Frame) -> None:
        """Remember where parts are in this frame."""
        for name, detection in found.items():
            if name not in self._labels:
                continue
            last, shift = self._last.get(name), np.zeros(2)
            if last is not None and self._is_fresh(last):
                if self._is_doubtful(last, detection, frame):
                    continue
                if last.seen == self._frame - 1:
                    shift = box_middle(detection.box_xyxy) - box_middle(last.box_xyxy)
            self._last[name] = _Last(detection.box_xyxy, self._frame, shift)

    def boxes(self, frame: Frame, found: Mapping[str, Detection]) -> list[Detection]:
        """Where parts are that have no box.

        Args:
            frame: with depth, or it is not known how large things are, and nothing is looked for.
            found: by part, its box.
        """
        config = self._config
        if not config.enabled or not self._names.can_look or frame.depth is None:
            return []
        lost = [
            name
            for name, last in self._last.items()
            if self._is_fresh(last)
            and (name not in found or self._is_doubtful(last, found[name], frame))
        ]
        if not lost:
            return []
        taken = [d.box_xyxy for name, d in found.items() if name not in lost]
        starts = {name: self._starts(name) for name in lost}
        best = self._best(frame, starts, taken)
        unsure = [name for name in lost if name not in best or best[name][0] < config.least]
        if unsure:
            each = max(config.most // len(unsure), 1)
            around = {name: self._around(name, frame)[:each] for name in unsure}
            best |= _better(self._best(frame, around, taken), best)
        best = {name: one for name, one in best.items() if one[0] >= config.promising}
        for step in config.step * CLOSER:
            closer = {name: beside(box, step) for name, (_, box) in best.items()}
            best |= _better(self._best(frame, closer, taken), best)
        return [
            self._names.named(box, self._labels[name], probability)
            for name, (probability, box) in best.items()
            if probability >= config.least
        ]

    def _is_fresh(self, last: _Last) -> bool:
        return self._frame - last.seen <= self._config.remembered

    def _is_doubtful(self, last: _Last, found: Detection, frame: Frame) -> bool:
        """Whether a box is hardly the part's, or not surely, and farther away than the part can have come."""
        config = self._config
        if found.score >= config.sure or overlap(found.box_xyxy, last.box_xyxy) > config.same:
            return False
        if found.score < config.weak:
            return True
        way = np.linalg.norm(box_middle(found.box_xyxy) - box_middle(last.box_xyxy))
        far = self._far(last, frame)
        return far is not None and float(way) > far + longer_side(last.box_xyxy)

    def _far(self, last: _Last, frame: Frame) -> float | None:
        """How far a part can have come, pixels; None where depth does not say how far away it was."""
        z = None if frame.depth is None else box_distance(last.box_xyxy, frame.depth)
        if z is None:
            return None
        since = self._frame - last.seen
        return self._config.reach * since * float(frame.camera.K[0, 0]) / z

    def _starts(self, name: str) -> list[Box]:
        """Where a part was, and where it would be if it went on."""
        last = self._last[name]
        ahead = last.shift if self._frame - last.seen == 1 else np.zeros(2)
        boxes = [last.box_xyxy]
        return [*boxes, last.box_xyxy + np.tile(ahead, 2)] if np.any(ahead) else boxes

    def _around(self, name: str, frame: Frame) -> list[Box]:
        """Places about where a part would be, the nearest first."""
        last, config = self._last[name], self._config
        box = self._starts(name)[-1]
        far, pace = self._far(last, frame), config.step * longer_side(box)
        if far is None:
            return []
        count = int(far / pace) + 1
        grid = np.arange(-count, count + 1) * pace
        offsets = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
        lengths = np.linalg.norm(offsets, axis=1)
        near = np.argsort(lengths, kind="stable")
        near = near[(lengths[near] > 0) & (lengths[near] <= far + pace)]
        return [box + np.tile(offsets[k], 2) for k in near]

    def _best(
        self, frame: Frame, places: Mapping[str, Sequence[Box]], taken: Sequence[Box]
    ) -> dict[str, tuple[float, Box]]:
        """Of each part the place that is named so most surely, and how surely."""
        above = heights_in(frame, ANY_TABLE)
        asked = [
            (name, box)
            for name, boxes in places.items()
            for box in boxes
            if _is_free(box, taken, frame, most=self._config.taken)
            and (above is None or _stands_out(box, above, frame, rise=self._config.rise))
        ]
        if not asked:
            return {}
        told = self._names.look(frame, [box for _, box in asked])
        best: dict[str, tuple[float, Box]] = {}
        for k, (name, box) in enumerate(asked):
            label = self._labels[name]
            probability = float(told[label][k]) if label in told else 0.0
            if name not in best or probability > best[name][0]:
                best[name] = (probability, box)
        return best


def _better(
    ones: Mapping[str, tuple[float, Box]], others: Mapping[str, tuple[float, Box]]
) -> dict[str, tuple[float, Box]]:
    """Those that are surer than what is known."""
    return {n: one for n, one in ones.items() if n not in others or one[0] > others[n][0]}


def _is_free(box: Box, taken: Iterable[Box], frame: Frame, *, most: float) -> bool:
    """Whether a place's middle is in the picture and no found part's."""
    size_wh = frame.camera.width, frame.camera.height
    return is_in_view(box, size_wh) and all(overlap(box, other) <= most for other in taken)


def _stands_out(box: Box, above: Heights, frame: Frame, *, rise: float) -> bool:
    """Whether something may stand on the table about a place's middle."""
    assert frame.depth is not None
    heights, depth = window_about(box, above, CORE), window_about(box, frame.depth, CORE)
    measured = heights[depth > 0]
    return bool(np.count_nonzero(measured > rise) >= len(measured) / 4)
