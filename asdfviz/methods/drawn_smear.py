"""Depth as a camera would smear it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Depth, Mask

Plane: TypeAlias = Float64[np.ndarray, "h w"]


@dataclass(frozen=True, slots=True)
class Smear:
    """What a depth camera does at edges; shares of the focal length, so that all sizes look alike."""

    deviation: float = 0.0043
    """Of the smear to all sides: the real frames' edges are about 10 pixels wide at a focal length of 607."""
    trail: float = 0.0
    """By how much what is near is drawn out to the right, away from the camera's light; below 0 to the
    left."""

    def applied(self, depth: Plane, *, focal: float) -> Depth:
        """Planar depth, metres, smeared; `focal` in pixels."""
        depth = depth.astype(np.float32)  # twice as fast
        reach = self._reach(focal)
        if reach > 1:
            depth = np.minimum(depth, cv2.blur(depth, (reach, 1), anchor=self._anchor(reach)))
        return np.asarray(cv2.GaussianBlur(depth, (0, 0), self.deviation * focal))

    def trailing(self, mask: Mask, *, focal: float) -> Mask:
        """A mask, and where the trails of what it shows are."""
        reach = self._reach(focal)
        if reach <= 1:
            return mask
        kernel = np.ones((1, reach), np.uint8)
        grown = cv2.dilate(mask.astype(np.uint8), kernel, anchor=self._anchor(reach))
        return np.asarray(grown > 0)

    def _reach(self, focal: float) -> int:
        return round(abs(self.trail) * focal)

    def _anchor(self, reach: int) -> tuple[int, int]:
        """Of a row of pixels of which the last, or for trails to the left the first, is meant."""
        return (reach - 1 if self.trail > 0 else 0, 0)
