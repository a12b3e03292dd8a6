"""The part of the picture around a group, shrunk to the cells in which states are compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from asdfviz.datatypes import Frame, PoseEstimate
from asdfviz.geometry.camera import nearest_pixels
from asdfviz.geometry.shapes import Depth, Intrinsics, Mask, Pixels
from asdfviz.geometry.transforms import apply
from asdfviz.methods.part_poses import PartShape
from asdfviz.state.colors import Look, Looks, brightness, color_features, color_ratio
from asdfviz.state.ground import Features, Ground, ground_around
from asdfviz.state.group_fit import GroupFitConfig, InverseDepth, Measured

BORDER = 8
"""Cells around the group that show the ground."""
APART = 3
"""The ground is taken so many cells from the group, since depth is smeared at its edges,"""
AROUND = 12
"""and no farther from it than so many."""
LEAST_PX = 20.0
"""A group that is seen smaller than this says nothing."""
SURE = 0.75
"""Score from which a part's own pose teaches its colours."""
ON_SURFACE = 0.006
"""Readings this near to the surface show the part, metres."""
OUTSIDE = 1.6
"""Pixels this much farther from a part's middle show what lies around it."""
FACING = 0.3
"""Cosine between surface and line of sight from which a point teaches colours."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupView:
    """A window of the picture, in cells."""

    depth: Depth
    features: Features
    K: Intrinsics
    cell_px: int
    """Side of a cell, pixels."""


def view_of(pixels: Pixels, frame: Frame, depth: Depth, *, cells: int) -> GroupView | None:
    """The window around the pixels; None where they are outside the picture, or too near together.

    Args:
        pixels: of everything that the group may cover; those behind the camera are NaN.
        frame: its colours and camera.
        depth: of the frame.
        cells: side of the window without its border, at most.
    """
    known = pixels[np.isfinite(pixels).all(axis=1)]
    if len(known) == 0:
        return None
    most = np.array(depth.shape[::-1], np.float64) - 1
    low, high = np.maximum(known.min(axis=0), 0), np.minimum(known.max(axis=0), most)
    size = float((high - low).max())
    if size < LEAST_PX or (high <= low).any():
        return None
    step = max(1, int(np.ceil(size / cells)))
    left, top = np.maximum(np.floor(low - BORDER * step), 0).astype(int)
    right, bottom = np.minimum(np.ceil(high + BORDER * step), most).astype(int) + 1
    window = (slice(top, bottom), slice(left, right))
    rgb = cv2.blur(np.ascontiguousarray(frame.rgb[window]), (3, 3))[::step, ::step]
    K = frame.camera.K
    K_view = np.array(
        [
            [K[0, 0] / step, K[0, 1] / step, (K[0, 2] - left) / step],
            [0.0, K[1, 1] / step, (K[1, 2] - top) / step],
            [0.0, 0.0, 1.0],
        ]
    )
    return GroupView(
        np.ascontiguousarray(depth[window][::step, ::step]), color_features(rgb), K_view, step
    )


def measured_in(
    view: GroupView,
    covered: InverseDepth,
    looks: Sequence[Look | None],
    *,
    black: Sequence[bool],
    base: int,
    config: GroupFitConfig,
) -> Measured:
    """The window's readings, and how its colours go with the parts and the ground.

    Args:
        view: the window.
        covered: above 0 where any state has a part.
        looks: of the parts in the order of their numbers, None where nothing was learnt.
        black: whether each of them is.
        base: number of the base part.
        config: what belongs to the ground, and how far colours count.
    """
    group = (covered > 0).astype(np.uint8)
    around = grown(group, AROUND) & ~grown(group, APART)
    ground = ground_around(view.depth, view.features, around, config=config.ground)
    if ground is None:
        ground = Ground(np.zeros(view.depth.shape, np.float32), None)
    known = [*looks, ground.look]
    ratios = np.zeros((len(known), *view.depth.shape), np.float32)
    for i, look in enumerate(known):
        if look is not None:
            ratios[i] = color_ratio(look, view.features, config=config.colors)
    # A part whose colours nobody saw may have those of any other part: what is seen there is as likely on
    # it as on the likeliest of them, or the parts behind it would be believed for their colours alone.
    unseen = [i for i, look in enumerate(looks) if look is None]
    ratios[unseen] = ratios[: len(looks)].max(axis=0)
    is_dark = view.features[..., 2] <= brightness(config.black_seen)
    swallowed = np.array([*black, False])[:, None, None] & is_dark
    return Measured(view.depth, ratios, ground.inverse_depth, swallowed, base)


def learn_colors(
    looks: Looks,
    poses: Mapping[str, PoseEstimate],
    shapes: Mapping[str, PartShape],
    frame: Frame,
    depth: Depth,
) -> None:
    """Take in the colours of parts whose own poses are sure, where depth shows their surface."""
    height, width = depth.shape
    for name, pose in poses.items():
        R_camera_part = pose.T_camera_part[:3, :3]
        if pose.score < SURE or pose.stage == "group" or not looks.is_wanted(name, R_camera_part):
            continue
        shape = shapes[name]
        points = apply(pose.T_camera_part, shape.surface[::3])
        normals = shape.normals[::3] @ pose.T_camera_part[:3, :3].T
        facing = -(points * normals).sum(axis=1) / np.linalg.norm(points, axis=1)
        points = points[(facing > FACING) & (points[:, 2] > 1e-3)]
        inside, v, u = nearest_pixels(points, frame.camera.K, depth.shape)
        on = np.abs(depth[v, u] - points[inside, 2]) < ON_SURFACE
        if 2 * np.count_nonzero(on) <= len(points):
            continue
        seen = np.stack([u[on], v[on]], axis=1)
        outside = np.rint(seen.mean(axis=0) + OUTSIDE * (seen - seen.mean(axis=0)))
        x, y = np.clip(outside, 0, [width - 1, height - 1]).astype(np.intp).T
        rgb, around = frame.rgb[v[on], u[on]], frame.rgb[y, x]
        looks.learn(name, rgb, around=around, R_camera_part=R_camera_part)


def grown(group: np.ndarray, cells: int) -> Mask:
    """A uint8 mask, grown by so many cells on all sides."""
    return cv2.dilate(group, np.ones((2 * cells + 1, 2 * cells + 1), np.uint8)) > 0
