"""Edits of poses, as pure functions: what a key or a gizmo makes of a part's pose.

Directions are those of the picture, which are the camera's axes: right x, down y, into it z. The
store keeps what comes out of here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import (
    apply_to_point,
    inverse,
    orthonormalized,
    rotation_about,
    transform_from,
)


def nudged(T_camera_part: Transform, step_camera: Vector) -> Transform:
    """Shift a part by a vector of the camera frame: right, down, forward, in metres."""
    return transform_from(T_camera_part[:3, :3], T_camera_part[:3, 3] + step_camera)


def rotated(
    T_camera_part: Transform, axis_camera: Vector, angle: float, *, centre_part: Vector
) -> Transform:
    """Turn a part about an axis of the camera frame, right-handed, its centre staying in place.

    Args:
        T_camera_part: where the part is.
        axis_camera: direction of the axis, any length.
        angle: radians.
        centre_part: what stays in place, part frame, metres; see `Part.middle`.
    """
    R = rotation_about(axis_camera, angle) @ T_camera_part[:3, :3]
    centre_camera = apply_to_point(T_camera_part, centre_part)
    # Hundreds of turns in a row would otherwise add up their rounding.
    return orthonormalized(transform_from(R, centre_camera - R @ centre_part))


def gizmo_pose(T_camera_part: Transform, centre_part: Vector) -> Transform:
    """Return where a gizmo belongs that holds a part at its centre (T_camera_gizmo)."""
    return T_camera_part @ transform_from(np.eye(3), centre_part)


def pose_from_gizmo(T_camera_gizmo: Transform, centre_part: Vector) -> Transform:
    """Return the pose of a part that is held by a gizmo at its centre."""
    T_gizmo_part = transform_from(np.eye(3), -centre_part)
    # A browser hands quaternions over in single precision.
    return orthonormalized(T_camera_gizmo) @ T_gizmo_part


def moved_group(
    Ts_camera_part: Mapping[str, Transform],
    part: str,
    T_camera_part: Transform,
    *,
    attached: Iterable[str],
) -> dict[str, Transform]:
    """Move a joined part and carry along, as one rigid body, all that is joined with it.

    Args:
        Ts_camera_part: the poses of the frame before the move.
        part: the part that was moved.
        T_camera_part: where it was moved to.
        attached: parts that are joined in the frame's state, base part among them. If the moved
            part is not joined, it moves alone.

    Returns:
        The new pose of every part that moves; joined parts without a pose are left out.

    Raises:
        AnnotationError: the moved part has no pose before the move while others would follow it.
    """
    joined = set(attached)
    moved = {part: T_camera_part}
    followers = [name for name in Ts_camera_part if name in joined and name != part]
    if part not in joined or not followers:
        return moved
    if part not in Ts_camera_part:
        raise AnnotationError(
            f"part '{part}' has no pose to move {', '.join(followers)} from; move it alone first"
        )
    motion = T_camera_part @ inverse(Ts_camera_part[part])
    for name in followers:
        moved[name] = orthonormalized(motion @ Ts_camera_part[name])
    return moved
