"""The registration stage of `asdf_plus`: a start turned and moved by depth, and what speaks for a pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from asdfviz.datatypes import Frame
from asdfviz.geometry.boxes import overlap
from asdfviz.geometry.outline_box import outline_box
from asdfviz.geometry.shapes import Box, Intrinsics, Points, Transform
from asdfviz.methods.part_poses import PartShape, shape_fit
from asdfviz.pose.icp import IcpConfig, register

FITTED = IcpConfig(
    direction="scan_to_model", reach=0.012, iterations=15, points=400, largest_move=0.03
)
"""Narrow, since the depth shift has come before it, and few points for speed."""


@dataclass(frozen=True)
class RegistrationConfig:
    """How parts are registered with the depth image; the paper has no such step."""

    enabled: bool = True
    """On or off."""
    icp: IcpConfig = FITTED
    """From the scan to the model, six degrees of freedom."""
    margin: float = 0.006
    """Depth readings this near to the surface agree with it, metres."""
    residual: float = 0.006
    """A result with a larger root mean square distance is not taken, metres."""
    outline: float = 0.5
    """Weight of the overlap of boxes against the depth's agreement."""


class Evidence(NamedTuple):
    """What speaks for a pose in one frame, each 0 to 1."""

    depth: float
    """Share of the readings on the surface, hidden ones counted less; 0 where depth says nothing."""
    visible: float
    """Share of the readings that nothing nearer hides."""
    agreeing: float
    """Of the visible ones, the share on the surface."""
    outline: float
    """Overlap of the projected box with the detected one; 0 without."""

    def value(self, config: RegistrationConfig) -> float:
        """By which poses of a part are compared within a frame."""
        return self.depth + config.outline * self.outline


def evidence(
    T_camera_part: Transform,
    shape: PartShape,
    frame: Frame,
    *,
    box_xyxy: Box | None,
    config: RegistrationConfig,
) -> Evidence:
    """Compare a pose with the depth image and with the detected box.

    Args:
        T_camera_part: the pose.
        shape: of the part.
        frame: with or without depth.
        box_xyxy: where the part was detected, pixels, or None.
        config: the margin.
    """
    fit = shape_fit(T_camera_part, shape, frame, margin=config.margin)
    outline = 0.0
    if box_xyxy is not None:
        outline = overlap(projected_box(T_camera_part, shape.corners, frame), box_xyxy)
    depth = (0.0, 0.0, 0.0) if fit is None else (fit.share, fit.visible, fit.agreeing)
    return Evidence(*depth, outline)


def registered(
    start: Transform, shape: PartShape, frame: Frame, *, config: RegistrationConfig
) -> Transform | None:
    """Refine a pose by the depth where it lies; None where that fails or is switched off."""
    if frame.depth is None or not config.enabled:
        return None
    fitted = register(
        start,
        shape.cloud,
        box_xyxy=projected_box(start, shape.corners, frame),
        depth=frame.depth,
        K=frame.camera.K,
        config=config.icp,
    )
    if fitted is None or fitted.residual > config.residual:
        return None
    return fitted.T_camera_part


def projected_box(T_camera_part: Transform, corners: Points, frame: Frame) -> Box:
    """The box around a part's outline, pixels, which corners in its frame span, metres."""
    return outline_box(T_camera_part, corners, frame.camera.K)


def window(
    box: Box, frame: Frame, *, margin: int = 0
) -> tuple[tuple[int, int, int, int], Intrinsics]:
    """The whole pixels x0 y0 x1 y1 of a box and some about it that lie in the picture, and K there.

    Beside the picture it ends before it begins.
    """
    height, width = frame.rgb.shape[:2]
    x0, y0 = np.maximum(np.floor(box[:2]).astype(int) - margin, 0).tolist()
    x1, y1 = np.minimum(np.ceil(box[2:]).astype(int) + margin + 1, (width, height)).tolist()
    return (x0, y0, x1, y1), frame.camera.K - np.array([[0, 0, x0], [0, 0, y0], [0, 0, 0]])
