"""What a crop network says of one part, without torch, so that methods can read it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float64

from asdfviz.detector.crop_cut import CROP_PIXELS, CropCamera
from asdfviz.geometry.rotation_grid import Quaternions, multiplied, quaternion_of
from asdfviz.geometry.shapes import Rotation, Scores, Vector
from asdfviz.geometry.symmetry import Symmetries

REACH = 0.5
"""Radius of a peak of the distribution, radians: its surroundings count to it."""
NOTHING = 1e-5
"""Rotations less probable than this add nothing that counts."""


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

    def likelihood(self, R_camera_part: Rotation, symmetries: Symmetries) -> float:
        """Probability of a rotation with its surroundings, over that of the highest peak.

        About 1 for what the network prefers, 0 for what it rules out. Of rotations that look alike the
        likeliest counts: the network need not spread over all of them.

        Args:
            R_camera_part: the rotation.
            symmetries: of the part.
        """
        quaternion = quaternion_of(self.camera.R_camera_crop.T @ R_camera_part)
        alike = quaternion @ _turned_by(symmetries)
        counted = np.flatnonzero(self.distribution > NOTHING)
        near = np.abs(self.grid[counted] @ alike.T) >= np.cos(REACH / 2)
        most = float((self.distribution[counted] @ near).max())
        return most / max(float(self.probabilities[0]), 1e-12)


@lru_cache(maxsize=256)
def _turned_by(symmetries: Symmetries) -> Float64[np.ndarray, "n 4 4"]:
    """What a row of a quaternion is multiplied by to be turned by each symmetry, identity first; axes are
    cut into steps of a peak's radius."""
    turns = [quaternion_of(S[:3, :3]) for S in symmetries.transforms(step=REACH)]
    return np.stack([multiplied(np.eye(4), np.tile(turn, (4, 1))) for turn in turns])
