"""Rotations spread evenly over all rotations, and how near symmetric rotations come to them.

Quaternions are (x, y, z, w); q and -q are the same rotation. The crop network's
answer is a distribution over such a grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Rotation, Scores, Vector
from asdfviz.geometry.symmetry import Axis, Symmetries

Quaternions: TypeAlias = Float64[np.ndarray, "_ 4"]
"""One unit quaternion (x, y, z, w) a row."""
Quaternion: TypeAlias = Float64[np.ndarray, "4"]
PHI, PSI = np.sqrt(2.0), 1.533751168755204288118041
"""Steps of the super-Fibonacci spiral."""
MEANS = 2
"""A peak's surroundings are taken so often about their own mean, so the grid's rotation does not pull it."""
FURTHER_AXIS_STEP = np.deg2rad(15.0)
"""Turns about a second free axis are cut into steps of this, radians; the first one is exact."""


def even_rotations(count: int) -> Quaternions:
    """Super-Fibonacci spiral over all rotations (Alexa, CVPR 2022).

    Neighbours are about (63 / count)^(1/3) radians apart: 21 degrees for 1,200.
    """
    place = np.arange(count) + 0.5
    inner, outer = np.sqrt(place / count), np.sqrt(1 - place / count)
    a, b = 2 * np.pi * place / PHI, 2 * np.pi * place / PSI
    return np.stack(
        [inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)], axis=1
    )


def quaternion_of(R: Rotation) -> Quaternion:
    """The rotation as a unit quaternion: an eigenvector, exact near half turns too (Bar-Itzhack 2000)."""
    trace = float(np.trace(R))
    form = np.empty((4, 4))
    form[:3, :3] = R + R.T - trace * np.eye(3)
    form[3, :3] = form[:3, 3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    form[3, 3] = trace
    return np.linalg.eigh(form)[1][:, 3]


def rotation_of(quaternion: Quaternion) -> Rotation:
    """The quaternion, of any length but zero, as a matrix."""
    return rotations_of(quaternion[None])[0]


def rotations_of(quaternions: Quaternions) -> Float64[np.ndarray, "_ 3 3"]:
    """Each quaternion, of any length but zero, as a matrix."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def multiplied(left: Quaternions, right: Quaternions) -> Quaternions:
    """Products row by row: the rotation that applies `right` first."""
    a, b = left[:, :3], right[:, :3]
    p, q = left[:, 3:], right[:, 3:]
    vector = p * b + q * a + np.cross(a, b)
    scalar = p * q - (a * b).sum(axis=1, keepdims=True)
    return np.concatenate([vector, scalar], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Equivalents:
    """The rotations that leave a part's look as it is, as quaternions on the right."""

    fixed: Quaternions
    """One a discrete symmetry, the identity first."""
    axis: Vector | None
    """About which the part may be turned freely, before each of the fixed ones; part's frame."""

    @classmethod
    def of(cls, symmetries: Symmetries) -> Equivalents:
        """Of a part's symmetries; free axes after the first are cut into steps."""
        axes = symmetries.continuous
        if symmetries.ball_middle is not None:  # turns about x, y and x again make every rotation
            axes = tuple(Axis(np.eye(3)[i], np.zeros(3)) for i in (0, 1, 0))
        turns = Symmetries(symmetries.discrete, axes[1:]).transforms(step=float(FURTHER_AXIS_STEP))
        axis = axes[0].direction if axes else None
        return cls(np.stack([quaternion_of(T[:3, :3]) for T in turns]), axis)

    def closeness(self, quaternion: Quaternion, others: Quaternions) -> Scores:
        """|<q, p>| of each other rotation with the equivalent of `quaternion` nearest to it.

        The angle between two rotations is 2 arccos of it. Turning freely about the axis gives
        max over t of cos(t/2) a + sin(t/2) b = sqrt(a^2 + b^2), so no turn has to be tried.
        """
        first, second = self.spanning(quaternion)
        squared = (others @ first.T) ** 2 + (others @ second.T) ** 2
        return np.sqrt(np.minimum(squared.max(axis=1), 1.0))

    def spanning(self, quaternion: Quaternion) -> tuple[Quaternions, Quaternions]:
        """For each fixed symmetry two quaternions that span its equivalents; without an axis the second is 0."""
        start = np.tile(quaternion, (len(self.fixed), 1))
        first = multiplied(start, self.fixed)
        if self.axis is None:
            return first, np.zeros_like(first)
        half_turn = np.tile(np.append(self.axis, 0.0), (len(self.fixed), 1))
        return first, multiplied(multiplied(start, half_turn), self.fixed)


def angles_of(closeness: Scores) -> Scores:
    """Angles in radians from |<q, p>|."""
    return 2 * np.arccos(np.clip(closeness, 0.0, 1.0))


def rotation_to_ray(ray: Vector) -> Rotation:
    """R_camera_crop: the smallest rotation that takes the optical axis onto a ray.

    Seen along the ray through its middle, a part looks the same wherever it is in the image; its
    rotation in that frame is called allocentric.

    Args:
        ray: of any length, not straight backwards.
    """
    x, y, z = map(float, ray / np.linalg.norm(ray))
    bend = 1 / (1 + z)
    return np.array(
        [
            [1 - bend * x * x, -bend * x * y, x],
            [-bend * x * y, 1 - bend * y * y, y],
            [-x, -y, z],
        ]
    )


def highest_mode(probabilities: Scores, grid: Quaternions, *, reach: float) -> Quaternions:
    """The highest peak of a distribution over a grid, (1, 4), as `rotation_modes.modes` finds several.

    Without compiled loops, for machines that only train.

    Args:
        probabilities: of the grid's rotations.
        grid: `even_rotations`.
        reach: radius of the peak's surroundings, radians.
    """
    mean = grid[int(probabilities.argmax())]
    for _ in range(MEANS):
        product = grid @ mean
        near = np.abs(product) >= np.cos(reach / 2)
        mean = (probabilities[near] * np.sign(product[near])) @ grid[near]
        mean = mean / np.linalg.norm(mean)
    return mean[None]
