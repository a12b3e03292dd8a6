"""How the state network's crops are cut: about the base part as its pose says, rolled so that it lies level.

Training and use take the same camera: its axis goes through the base part's middle, the crop is as wide as
the assembly gets there, and the base part's longest axis points to the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.detector.crop_classes import group_radius
from asdfviz.detector.crop_cut import CONTEXT, CropCamera
from asdfviz.geometry.rotation_grid import rotation_to_ray
from asdfviz.geometry.sampling import surface_middle, surface_points
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, rotation_about

STATE_PIXELS = 128
"""Side of the network's input."""
_SAMPLES = 2000


@dataclass(frozen=True, slots=True, eq=False)
class GroupFrame:
    """What a crop of an assembly's group is cut by, base part's frame."""

    middle: Vector
    """`surface_middle` of the base part, metres."""
    axis: Vector
    """Unit vector along the base part's greatest extent."""
    radius: float
    """`group_radius`, metres."""

    @classmethod
    def of(cls, assembly: Assembly) -> GroupFrame:
        """Of an assembly's base part."""
        mesh = assembly.parts[assembly.base].mesh
        spread = np.cov(surface_points(mesh.vertices, mesh.faces, _SAMPLES).T)
        axis = np.linalg.eigh(spread)[1][:, 2]
        axis = axis * np.sign(axis[np.abs(axis).argmax()])
        return cls(surface_middle(mesh.vertices, mesh.faces), axis, group_radius(assembly))


def state_camera(group: GroupFrame, T_camera_base: Transform) -> CropCamera | None:
    """The camera of a crop of `STATE_PIXELS` a side; None where the base part is not before the frame's.

    Args:
        group: of the assembly.
        T_camera_base: where the base part is, metres.
    """
    middle = apply(T_camera_base, group.middle[None])[0]
    if middle[2] <= 0:
        return None
    R = rotation_to_ray(middle)
    across = R.T @ T_camera_base[:3, :3] @ group.axis
    roll = float(np.arctan2(across[1], across[0]))
    distance = float(np.linalg.norm(middle))
    focal = STATE_PIXELS * distance / (CONTEXT * 2 * group.radius)
    center = (STATE_PIXELS - 1) / 2
    K = np.array([[focal, 0, center], [0, focal, center], [0, 0, 1.0]])
    return CropCamera(K, R @ rotation_about(np.array([0.0, 0.0, 1.0]), roll))
