"""Distances between an estimated and a true pose; everything that scores poses starts here.

The definitions are those of Hodan et al., "On Evaluation of 6D Object Pose Estimation" (ECCVW 2016),
and of the BOP toolkit. Metres and radians; the estimate's and the truth's part frame are called
`estimate` and `truth`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np
from scipy.spatial import KDTree  # pyright: ignore[reportMissingTypeStubs]  scipy has none

from asdfviz.datatypes import Part
from asdfviz.geometry.boxes import box_around, overlap
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Box, Points, Transform
from asdfviz.geometry.symmetry import nearest_symmetric
from asdfviz.geometry.transforms import apply, inverse, rotation_angle

SURFACE_POINTS = 2000
"""Points a part is compared by: spread evenly over its surface, so that fine detail weighs no more."""


@runtime_checkable
class NearestPoints(Protocol):
    """The part of scipy's KDTree that is used here; scipy comes without types."""

    def query(self, x: Points) -> tuple[np.ndarray, np.ndarray]:
        """Return the distance and the index of the nearest point for every x."""
        ...


@dataclass(frozen=True, slots=True)
class PoseError:
    """How far one estimated pose is from the truth."""

    add_s: float
    """ADI for a symmetric part, ADD for any other; metres."""
    e_t: float
    """Distance of the part frames' origins, metres, symmetry left aside."""
    e_t_sym: float
    """The same to the symmetric pose of `e_r_sym`, metres: a turn about an axis beside the origin moves it."""
    e_r: float
    """Angle between the rotations, radians, symmetry left aside."""
    e_r_sym: float
    """The same to the nearest symmetric pose, radians; continuous axes are solved for, not cut into steps."""
    overlap: float
    """Intersection over union of the boxes about the part in the picture under both poses, 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """A part made ready to be compared many times."""

    part: Part
    points: Points
    tree: NearestPoints
    """Nearest-neighbour tree over `points`."""


def error_model(part: Part, *, count: int = SURFACE_POINTS) -> ErrorModel:
    """Sample the part's surface (always the same points) and index the sample."""
    points = surface_points(part.mesh.vertices, part.mesh.faces, count)
    return ErrorModel(part, points, nearest_points(points))


def nearest_points(points: Points) -> NearestPoints:
    """Index points so that the nearest one is found quickly."""
    return cast(NearestPoints, KDTree(points))


def pose_error(
    T_camera_estimate: Transform,
    T_camera_truth: Transform,
    model: ErrorModel,
    *,
    known_add_s: float | None = None,
) -> PoseError:
    """Return all errors of one pose; ADD(S) as in Hinterstoisser et al. (ACCV 2012), or as known."""
    T_camera_alike = nearest_symmetric(T_camera_truth, T_camera_estimate, model.part.symmetries)
    known = known_add_s
    if known is None:
        known = add_s(T_camera_estimate, T_camera_truth, model)
    return PoseError(
        add_s=known,
        e_t=e_t(T_camera_estimate, T_camera_truth),
        e_t_sym=e_t(T_camera_estimate, T_camera_alike),
        e_r=e_r(T_camera_estimate, T_camera_truth),
        e_r_sym=e_r(T_camera_estimate, T_camera_alike),
        overlap=box_overlap(T_camera_estimate, T_camera_truth, model.points),
    )


def add_s(T_camera_estimate: Transform, T_camera_truth: Transform, model: ErrorModel) -> float:
    """ADI for a symmetric part, ADD for any other; metres."""
    if model.part.symmetries.is_symmetric:
        return adi(T_camera_estimate, T_camera_truth, model.points, tree=model.tree)
    return add(T_camera_estimate, T_camera_truth, model.points)


def add_s_at_least(
    T_camera_estimate: Transform, T_camera_truth: Transform, model: ErrorModel
) -> float:
    """What ADD(S) cannot be less than, found in no time; metres.

    A mean of vectors is no longer than their mean length. The nearest point of a symmetric part may
    lie on its other side.
    """
    middle = model.points.mean(axis=0)
    gap = apply(T_camera_estimate, middle[None]) - apply(T_camera_truth, middle[None])
    bound = float(np.linalg.norm(gap))
    if model.part.symmetries.is_symmetric:
        bound -= 2.0 * float(np.linalg.norm(model.points - middle, axis=1).max())
    return max(bound, 0.0)


def box_overlap(T_camera_estimate: Transform, T_camera_truth: Transform, points: Points) -> float:
    """Intersection over union of the boxes about all points in the picture under both poses.

    The boxes lie in the plane at depth 1, so no intrinsics are asked for; 0 where a point lies behind
    the camera.
    """
    boxes: list[Box] = []
    for T in (T_camera_estimate, T_camera_truth):
        seen = apply(T, points)
        if seen[:, 2].min() <= 0:
            return 0.0
        boxes.append(box_around(seen[:, :2] / seen[:, 2:]))
    return overlap(*boxes)


def add(T_camera_estimate: Transform, T_camera_truth: Transform, points: Points) -> float:
    """Average distance between each model point under both poses, metres (ADD)."""
    gaps = apply(T_camera_estimate, points) - apply(T_camera_truth, points)
    return float(np.linalg.norm(gaps, axis=1).mean())


def adi(
    T_camera_estimate: Transform,
    T_camera_truth: Transform,
    points: Points,
    *,
    tree: NearestPoints | None = None,
) -> float:
    """Average distance from each true model point to the nearest estimated one, metres (ADI, ADD-S).

    Not symmetric in its poses: the tree stands on the estimate and is asked for the truth's points.
    Rigid motion keeps distances, so one tree in the part's frame serves every pose.

    Args:
        T_camera_estimate: the pose that was found.
        T_camera_truth: the pose that is right.
        points: the model, part frame.
        tree: an index over `points`, if the caller has one.
    """
    tree = nearest_points(points) if tree is None else tree
    T_estimate_truth = inverse(T_camera_estimate) @ T_camera_truth
    distances, _ = tree.query(apply(T_estimate_truth, points))
    return float(distances.mean())


def e_t(T_camera_estimate: Transform, T_camera_truth: Transform) -> float:
    """Distance between the part frames' origins, metres."""
    return float(np.linalg.norm(T_camera_estimate[:3, 3] - T_camera_truth[:3, 3]))


def e_r(T_camera_estimate: Transform, T_camera_truth: Transform) -> float:
    """Angle of the rotation between the poses, radians: acos((tr(R_e R_t^T) - 1) / 2)."""
    return rotation_angle(T_camera_estimate[:3, :3].T @ T_camera_truth[:3, :3])
