"""A second look at what the detector missed: once more, nearer, where depth says that something is.

Not in the paper. A small part that lies about is a few pixels to the network; in a window of half the
picture it has twice the size. One window a frame at most, and only while parts are missing: first
where a missing part was a moment ago, then where something stands out of the table that no box
explains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import box_middle, diagonal, share_inside
from asdfviz.geometry.shapes import Box
from asdfviz.methods.network import Detects
from asdfviz.methods.seen_table import heights_in
from asdfviz.pose.blobs import BlobConfig, standing_out

BORDER_PX = 2.0
"""A box this near to the window's edge is cut off by it."""


@dataclass(frozen=True)
class SecondLookConfig:
    """Where and how often the detector looks again."""

    enabled: bool = False
    """Whether it does,"""
    keypoints: bool = True
    """also where first poses come from keypoints."""
    share: float = 0.5
    """Of the picture's width and height that a window has, 0 to 1."""
    remembered: int = 5
    """Frames for which the place of a part that is missing now is looked at first."""
    every: int = 5
    """Frames after which the same unexplained thing is looked at again."""
    explained: float = 0.5
    """Share of a blob's box within a detected part's box from which the part explains it, 0 to 1."""
    blobs: BlobConfig = field(default_factory=BlobConfig)
    """What stands out of the table."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 < self.share <= 1 or self.every < 1:
            raise MethodError(
                f"second_look.share is {self.share:g} and second_look.every {self.every}: share "
                "must be above 0 and at most 1, every 1 or more"
            )

    def chosen(self, *, crops: bool) -> SecondLookConfig:
        """The same, off where it is not meant for what first poses come from: crops, or keypoints."""
        return replace(self, enabled=self.enabled and (crops or self.keypoints))


class SecondLook:
    """Looks again in one sequence."""

    def __init__(self, assembly: Assembly, detector: Detects, *, config: SecondLookConfig) -> None:
        """Begin a sequence."""
        self._assembly, self._detector, self._config = assembly, detector, config
        self._frame = 0
        self._seen: dict[str, tuple[int, Box]] = {}
        """When and where a part's box was seen last."""
        self._looked: list[tuple[int, Float64[np.ndarray, "2"]]] = []
        """When and where a window looked at a blob last."""

    def step(
        self, frame: Frame, detections: Sequence[Detection], found: Mapping[str, Detection]
    ) -> tuple[Detection, ...]:
        """Return all boxes of the frame: those given, and what a window adds for missing parts.

        Args:
            frame: with depth, or only remembered places are looked at.
            detections: of the whole picture.
            found: which of them stand for parts.
        """
        config = self._config
        self._frame += 1
        self._seen |= {name: (self._frame, d.box_xyxy) for name, d in found.items()}
        missing = [name for name in self._assembly.parts if name not in found]
        if not config.enabled or not missing:
            return tuple(detections)
        middle = self._target(frame, missing, found)
        if middle is None:
            return tuple(detections)
        wanted = {self._assembly.parts[name].detector_class for name in missing}
        seen = self._through_window(frame, middle)
        return (*detections, *(d for d in seen if d.label in wanted))

    def _target(
        self, frame: Frame, missing: Sequence[str], found: Mapping[str, Detection]
    ) -> Float64[np.ndarray, "2"] | None:
        """What to look at: the middle of a box, pixels."""
        config, now = self._config, self._frame
        recent = [
            (when, box)
            for when, box in (self._seen[name] for name in missing if name in self._seen)
            if now - when <= config.remembered
        ]
        self._looked = [(when, at) for when, at in self._looked if now - when < config.every]
        boxes = [d.box_xyxy for d in found.values()]
        # In turn: a part that was covered a moment ago must not keep all others waiting.
        if recent and now % 2:
            return box_middle(recent[now // 2 % len(recent)][1])
        above = heights_in(frame, config.blobs.table)
        for blob in standing_out(above, config=config.blobs):
            if any(share_inside(blob, box) > config.explained for box in boxes):
                continue
            at = box_middle(blob)
            near = diagonal(blob) / 2
            if all(float(np.linalg.norm(at - old)) > near for _, old in self._looked):
                self._looked.append((now, at))
                return at
        return box_middle(recent[now // 2 % len(recent)][1]) if recent else None

    def _through_window(self, frame: Frame, middle: Float64[np.ndarray, "2"]) -> list[Detection]:
        """What the detector sees in a window, in pixels of the frame."""
        height, width = frame.rgb.shape[:2]
        extent = np.array([width, height])
        size = np.maximum((self._config.share * extent).astype(int), 1)
        corner = np.clip(np.rint(middle - size / 2).astype(int), 0, extent - size)
        (x, y), (w, h) = corner, size
        seen = self._detector.detect(np.ascontiguousarray(frame.rgb[y : y + h, x : x + w]))
        return [
            replace(
                d,
                box_xyxy=d.box_xyxy + np.tile(corner, 2),
                keypoints_px=d.keypoints_px + corner,
                mask=None,
            )
            for d in seen
            if not _is_cut_off(d.box_xyxy, corner, size, extent)
        ]


def _is_cut_off(
    box_xyxy: Box,
    corner: np.ndarray,
    size: np.ndarray,
    extent: np.ndarray,
) -> bool:
    """Whether the window's edge, where it is not the picture's own, cuts a box off."""
    low = (box_xyxy[:2] < BORDER_PX) & (corner > 0)
    high = (box_xyxy[2:] > size - 1 - BORDER_PX) & (corner + size < extent)
    return bool(low.any() or high.any())
