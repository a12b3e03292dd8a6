"""Which visible shares of a frame still hold once some of its poses were corrected.

The others are left out, to be rendered where they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from asdfviz.datatypes import Assembly, FrameTruth
from asdfviz.geometry.boxes import box_around
from asdfviz.geometry.shapes import Box, Points, Transform
from asdfviz.geometry.transforms import apply

_NEAREST = 0.01
"""Metres before the camera; what reaches nearer has no bounds in the picture."""


class KeptShares:
    """Tells shares that hold from shares that do not; knows how large the parts are."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self._corners: dict[str, Points] = {}

    def of(self, base: FrameTruth, poses: Mapping[str, Transform]) -> Mapping[str, float]:
        """The shares of the parts that stayed where no part that was moved can hide them.

        A part that was moved hid what its bounds in the picture met before, and may hide what they
        meet now. No camera is asked for: whether bounds meet is the same for all of one centre.

        Args:
            base: what was corrected.
            poses: T_camera_part as corrected, by part.
        """
        before = base.T_camera_part
        moved = {name for name in {*before, *poses} if not _same(before.get(name), poses.get(name))}
        if not moved or not base.visible:
            return base.visible
        passed = [
            self._bounds(name, Ts[name]) for Ts in (before, poses) for name in moved if name in Ts
        ]
        return {
            name: share
            for name, share in base.visible.items()
            if name in poses
            and name not in moved
            and not any(_meet(self._bounds(name, poses[name]), other) for other in passed)
        }

    def _bounds(self, name: str, T_camera_part: Transform) -> Box | None:
        """What a part can cover of the plane one metre before the camera; None: any of it."""
        if name not in self._assembly.parts:
            return None
        if name not in self._corners:
            vertices = self._assembly.parts[name].mesh.vertices
            ends = zip(vertices.min(axis=0), vertices.max(axis=0), strict=True)
            self._corners[name] = np.array(list(product(*ends)))
        points = apply(T_camera_part, self._corners[name])
        if points[:, 2].min() < _NEAREST:
            return None
        return box_around(points[:, :2] / points[:, 2:])


def _same(T: Transform | None, other: Transform | None) -> bool:
    return T is not None and other is not None and np.array_equal(T, other)


def _meet(box_xyxy: Box | None, other_xyxy: Box | None) -> bool:
    if box_xyxy is None or other_xyxy is None:
        return True
    return bool(np.all(box_xyxy[:2] <= other_xyxy[2:]) and np.all(other_xyxy[:2] <= box_xyxy[2:]))
