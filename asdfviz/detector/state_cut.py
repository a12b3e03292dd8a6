"""How the state network's crops are cut: by the base part's pose, about all places that joined parts take.

Training and use take the same camera: it looks at the middle of the box in which the group's points are seen,
the group's longest axis points to the right, and the box just fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from torch import Tensor, atan2

from asdfviz.detector.view_rotations import about_z, towards
from asdfviz.geometry.shapes import Vector

STATE_SIZE = (224, 128)
"""Width and height of the network's input, pixels: most groups are long, and small parts tell their states."""
MARGIN = 1.15
"""A crop over the box, in the direction in which it fits."""
NEAREST = 0.03
"""Metres; points nearer than this are not before the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class BasePoses:
    """How base parts lie in crops, or in frames."""

    R: Float32[Tensor, "b 3 3"]
    """R_camera_base."""
    t: Float32[Tensor, "b 3"]
    """Base part's origin in the camera, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class StateCameras:
    """Cameras of crops of `STATE_SIZE`, which share the centre of those that the poses are given in."""

    R_camera_crop: Float32[Tensor, "b 3 3"]
    focal: Float32[Tensor, "b"]
    """Pixels; the principal point is the crop's middle."""


def state_cameras(
    points: Float32[Tensor, "b p 3"],
    axes: Float32[Tensor, "b 3"],
    poses: BasePoses,
    *,
    roll: Float32[Tensor, "b"] | None = None,
) -> StateCameras:
    """The cameras of crops of groups.

    Args:
        points: of every group, base part's frame, metres.
        axes: `long_axis` of every group.
        poses: of the base parts in a camera; every point farther ahead than `NEAREST`.
        roll: by which crops are turned besides, radians.
    """
    seen = points @ poses.R.transpose(1, 2) + poses.t[:, None]
    middle = seen.mean(dim=1)
    R_ahead = towards(middle[:, :2] / middle[:, 2:])
    across = (R_ahead.transpose(1, 2) @ poses.R @ axes[:, :, None])[:, :, 0]
    angle = atan2(across[:, 1], across[:, 0])
    R_level = R_ahead @ about_z(angle if roll is None else angle + roll)
    level = seen @ R_level
    flat = level[:, :, :2] / level[:, :, 2:].clamp(min=NEAREST)
    low, high = flat.amin(1), flat.amax(1)
    sides = high - low
    focal = sides.new_tensor(STATE_SIZE) / (MARGIN * sides)
    return StateCameras(R_level @ towards((low + high) / 2), focal.amin(1))


def seen_by(cameras: StateCameras, poses: BasePoses) -> BasePoses:
    """The poses in the crops' cameras."""
    R = cameras.R_camera_crop.transpose(1, 2)
    return BasePoses(R @ poses.R, (R @ poses.t[:, :, None])[:, :, 0])


def are_ahead(points: Float32[Tensor, "b p 3"], poses: BasePoses) -> bool:
    """Whether every point of every group lies before the camera."""
    depth = (points @ poses.R.transpose(1, 2) + poses.t[:, None])[:, :, 2]
    return bool((depth > NEAREST).all())


def long_axis(points: Float32[np.ndarray, "p 3"]) -> Vector:
    """Unit vector along the greatest extent of a group's points, base part's frame."""
    axis = np.linalg.eigh(np.cov(points.T))[1][:, 2]
    return axis * np.sign(axis[np.abs(axis).argmax()])
