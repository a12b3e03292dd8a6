"""The place and the turn on a table in which a part looks most like what is seen, from one nearby; and
pictures that are fine enough to tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from asdfviz.datatypes import Camera, Frame
from asdfviz.geometry.boxes import longer_side
from asdfviz.geometry.shapes import Box, Points, Scores, Transform, Vector
from asdfviz.geometry.symmetry import across
from asdfviz.geometry.transforms import apply_to_point, transform_from, turn_about
from asdfviz.pose.table import Table

STEPS = ((10.0, 0.002), (5.0, 0.001), (2.5, 0.0005))
"""Degrees about the upright, metres along the table and across,"""
CLIMBS = 4
"""each so often, as long as it helps: the middle of a pose that was tilted may be millimetres off."""
COARSE_PX = 64.0
"""What looks larger is compared in a picture of half the size, or a quarter."""


def climbed(
    T_camera_part: Transform,
    looks_of: Callable[[Sequence[Transform]], Scores | None],
    *,
    middle: Vector,
    table: Table,
) -> Transform:
    """The pose uphill by how it would look, in place and turn, with shrinking steps.

    Args:
        T_camera_part: where it begins.
        looks_of: how much like what is seen poses would look; None where that is unknown.
        middle: of the part, in its frame, metres.
        table: on which it lies, in the camera's frame.
    """
    level = np.cross(table.normal, across(table.normal))
    axes = np.stack([level, np.cross(table.normal, level), table.normal])
    best = T_camera_part
    for turn_deg, shift in STEPS:
        for _ in range(CLIMBS):
            tried = [best, *_beside(best, shift * axes)]
            tried += [
                spun(best, middle, table, sign * np.deg2rad(turn_deg)) for sign in (1.0, -1.0)
            ]
            looks = looks_of(tried)
            k = 0 if looks is None else int(looks.argmax())
            if k == 0:
                break
            best = tried[k]
    return best


def spun(T_camera_part: Transform, middle: Vector, table: Table, angle: float) -> Transform:
    """The pose turned about the upright through the part's middle (in its frame) by radians."""
    return turn_about(table.normal, apply_to_point(T_camera_part, middle), angle) @ T_camera_part


def _beside(T: Transform, shifts: Points) -> list[Transform]:
    """The pose moved by each shift, and the other way."""
    R, t = T[:3, :3], T[:3, 3]
    return [transform_from(R, t + sign * shift) for sign, shift in product((1.0, -1.0), shifts)]


def coarse(frame: Frame, box_xyxy: Box, *, side_px: float) -> Frame:
    """The frame with every second pixel, or fourth, where what is in a box looks larger than that."""
    side = longer_side(box_xyxy)
    step = 1 if side <= side_px else 2 if side <= 2 * side_px else 4
    if step == 1 or frame.depth is None:
        return frame
    rgb, depth = frame.rgb[::step, ::step], frame.depth[::step, ::step]
    K = np.diag([1 / step, 1 / step, 1.0]) @ frame.camera.K
    camera = Camera(K, width=rgb.shape[1], height=rgb.shape[0])
    return replace(frame, rgb=rgb, depth=depth, camera=camera)
