"""What a crop network says of one part, without torch, so that methods can read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.detector.crop_cut import CROP_PIXELS, CropCamera
from asdfviz.geometry.rotation_grid import Quaternions, quaternion_of
from asdfviz.geometry.shapes import Rotation, Scores, Vector

REACH = 0.5
"""Radius of a peak of the distribution, radians: its surroundings count to it."""


@dataclass(frozen=True, slots=True, eq=False)
class CropAnswer:
    """Possible rotations, place and outline of one part, or of a group's base part."""

    camera: CropCamera
    """Of the crop."""
    rotations: Quaternions
    """R_crop_part of the separate peaks, most probable first."""
    probabilities: Scores
    """Of each peak with its surroundings."""
    grid: Quaternions
    """All rotations R_crop_part that the network weighs,"""
    distribution: Float64[np.ndarray, "_"]
    """and the probability of each."""
    place: Vector
    """As `CropOutput.place`."""
    outline: Float64[np.ndarray, "s s"]
    """Probability that a cell shows the part."""
    states: Float64[np.ndarray, "_"]
    """Of a group the probability of every state, in the order of the network; of a part none."""

    def distance(self, diameter: float) -> float:
        """Depth of the part's middle along the crop's axis that `place` says, metres.

        Args:
            diameter: of the part, metres.
        """
        return float(self.camera.K[0, 0]) * diameter / (CROP_PIXELS * float(np.exp(self.place[2])))

    def likelihood(self, R_camera_part: Rotation) -> float:
        """Probability of a rotation with its surroundings, over that of the highest peak.

        About 1 for what the network prefers, 0 for what it rules out; one of several rotations
        that look alike is compared with its like.
        """
        quaternion = quaternion_of(self.camera.R_camera_crop.T @ R_camera_part)
        near = np.abs(self.grid @ quaternion) >= np.cos(REACH / 2)
        return float(self.distribution[near].sum()) / max(float(self.probabilities[0]), 1e-12)
