"""How good a mask branch is on pictures that it was not trained on, beside what boxes alone know."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Detection
from asdfviz.detector.detector import Detector
from asdfviz.detector.joint import SEPARATOR
from asdfviz.geometry.boxes import iou_matrix
from asdfviz.geometry.shapes import Box, Mask
from asdfviz.train.mask_data import MaskImage

MATCH_IOU = 0.5
"""Of a predicted and a true box that are one object."""
DetectorOf: TypeAlias = Callable[[str], Detector]
"""The detector with masks of an assembly, by its name."""


@dataclass(frozen=True, slots=True)
class ClassMasks:
    """Figures of one class of parts over the found objects, means; None where nothing was found."""

    label: str
    objects: int
    found: int
    """A box of the class with IoU >= 0.5 was there."""
    iou: float | None
    """Mask against the pixels that show the part."""
    own: float | None
    """Share of the mask's pixels that show the part."""
    box_own: float | None
    """Share of the predicted box's pixels that show the part: what a filter by the box lets in."""


@dataclass(frozen=True, slots=True)
class MaskValidation:
    """Figures of a mask branch; means over all found objects of all classes."""

    iou: float | None
    own: float | None
    box_own: float | None
    classes: tuple[ClassMasks, ...]

    def as_json(self) -> dict[str, object]:
        """Plain numbers and lists."""
        return asdict(self)

    def table(self) -> str:
        """One line a class, for people."""
        lines = [f"{'class':<26}{'n':>5}{'found':>6}{'IoU':>7}{'own':>7}{'box own':>9}"]
        for c in self.classes:
            lines.append(_line(c.label, c.objects, c.found, (c.iou, c.own, c.box_own)))
        objects, found = (sum(getattr(c, k) for c in self.classes) for k in ("objects", "found"))
        lines.append(_line("all", objects, found, (self.iou, self.own, self.box_own)))
        return "\n".join(lines)


def validate_masks(
    detector_of: DetectorOf, images: Sequence[MaskImage], names: Sequence[str]
) -> MaskValidation:
    """Run detectors with masks on every picture and compare.

    Args:
        detector_of: for the assembly that a picture shows.
        images: with true masks.
        names: of the detector's outputs.
    """
    rows: dict[str, list[tuple[float, float, float] | None]] = {}
    for image in images:
        found = detector_of(image.picture.assembly).detect(image.picture.rgb)
        for item, label in zip(image.picture.objects, image.labels, strict=True):
            name = names[int(label)]
            plain = name.split(SEPARATOR)[-1]
            size = np.array([image.owners.shape[1], image.owners.shape[0]]) - 1
            low, high = (np.clip(f(item.outline, axis=0), 0, size) for f in (np.min, np.max))
            best = _match([d for d in found if d.label == plain], np.concatenate([low, high]))
            shown = image.owners == item.label + 1
            figures = None if best is None else _figures(best, shown)
            rows.setdefault(name, []).append(figures)
    classes = tuple(_of_class(n, rows[n]) for n in names if n in rows)
    every = [one for several in rows.values() for one in several if one is not None]
    iou, own, box_own = _means(every)
    return MaskValidation(iou, own, box_own, classes)


def _match(found: Sequence[Detection], box_xyxy: Box) -> Detection | None:
    if not found:
        return None
    overlaps = iou_matrix(np.stack([d.box_xyxy for d in found]), box_xyxy[None].astype(float))[:, 0]
    good = [d for d, overlap in zip(found, overlaps, strict=True) if overlap >= MATCH_IOU]
    return max(good, key=lambda d: d.score, default=None)


def _figures(detection: Detection, shown: Mask) -> tuple[float, float, float] | None:
    """IoU of the mask, and the part's share of the mask and of the whole box."""
    mask = detection.mask
    if mask is None:
        return None
    height, width = mask.pixels.shape
    inside = shown[mask.top : mask.top + height, mask.left : mask.left + width]
    both, guessed = int((inside & mask.pixels).sum()), int(mask.pixels.sum())
    union = int(shown.sum()) + guessed - both
    return both / max(union, 1), both / max(guessed, 1), float(inside.mean())


def _of_class(name: str, rows: Sequence[tuple[float, float, float] | None]) -> ClassMasks:
    found = [row for row in rows if row is not None]
    return ClassMasks(name, len(rows), len(found), *_means(found))


def _means(
    rows: Sequence[tuple[float, float, float]],
) -> tuple[float | None, float | None, float | None]:
    if not rows:
        return None, None, None
    iou, own, box_own = np.mean(rows, axis=0).tolist()
    return iou, own, box_own


def _line(label: str, objects: int, found: int, figures: Sequence[float | None]) -> str:
    cells = "".join(f"{'-' if v is None else format(v, '.3f'):>8}" for v in figures)
    return f"{label:<26}{objects:>5}{found:>6}{cells}"
