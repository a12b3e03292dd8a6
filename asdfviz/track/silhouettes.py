"""The drawing of all tracked parts by which the tracker knows which one hides which."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from asdfviz.geometry.shapes import Intrinsics, Transforms
from asdfviz.track.bodies import Body
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.visibility import NO_SILHOUETTES, Silhouettes, like_regions, render_silhouettes

REDRAWN_PX = 0.7
"""Silhouettes are drawn anew when a part may have moved by this many pixels."""


class DrawnParts:
    """The silhouettes of some bodies, kept until a part has moved."""

    def __init__(self, bodies: Sequence[Body], K: Intrinsics, config: TrackerConfig) -> None:
        """Take the bodies in the order of all arrays."""
        self._meshes = [body.centred for body in bodies]
        self._K = K
        self._config = config
        self._Ts_drawn: Transforms = np.zeros((0, 4, 4))
        self.regions = like_regions([b.color for b in bodies], nearer_than=config.like_colors)
        """A number a body; those of like colour share theirs."""
        self.reaches = np.array([body.reach for body in bodies])
        """How far each body reaches from its centre, metres."""
        self._held: tuple[int, ...] = ()
        self._shown: tuple[int, ...] = ()
        """What was drawn last."""
        self._silhouettes = NO_SILHOUETTES

    def hold(self, held: Collection[int]) -> None:
        """From now on these bodies are held together, and no others."""
        self._held = tuple(sorted(held))

    def of(self, i: int) -> Silhouettes:
        """What was drawn last of a body and of those that may hide it; empty where it was not."""
        return self._silhouettes if i in self._shown else NO_SILHOUETTES

    def refresh(self, Ts_camera_centre: Transforms) -> None:
        """Draw anew if the config wants it, unless no part has moved by a pixel since."""
        if not self._config.silhouettes:
            return
        shown = tuple(range(len(self._meshes))) if self._config.silhouettes_loose else self._held
        is_same = shown == self._shown
        if is_same and (not shown or self._pixels_moved(Ts_camera_centre) < REDRAWN_PX):
            return
        self._Ts_drawn = Ts_camera_centre.copy()
        drawn = render_silhouettes(
            self._meshes,
            Ts_camera_centre,
            self._K,
            shown=shown,
            size=self._config.silhouette_px,
            reaches=self.reaches,
            regions=self.regions,
        )
        self._shown = () if drawn is None else shown
        self._silhouettes = drawn or NO_SILHOUETTES

    def _pixels_moved(self, Ts_camera_centre: Transforms) -> float:
        """Most pixels that any part's rim can have moved since the silhouettes were drawn."""
        change = Ts_camera_centre - self._Ts_drawn
        turned = np.abs(change[:, :3, :3]).sum(axis=(1, 2)) * self.reaches / 2
        metres = turned + np.linalg.norm(change[:, :3, 3], axis=1)
        depths = np.maximum(Ts_camera_centre[:, 2, 3], 0.01)
        return float((metres * self._K[0, 0] / depths).max())
