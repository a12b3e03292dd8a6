"""The registration stage of `asdf_plus`: from several starts to the pose that fits best, or the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asdfviz.datatypes import Frame
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Box, Transform
from asdfviz.geometry.transforms import apply
from asdfviz.methods.part_poses import PartShape
from asdfviz.pose.confidence import ConfidenceConfig, confidence
from asdfviz.pose.depth_fit import depth_fit
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
    starts: int = 3
    """Poses that it starts from, at most."""
    margin: float = 0.006
    """Depth readings this near to the surface agree with it, metres."""
    residual: float = 0.006
    """A result with a larger root mean square distance is not taken, metres."""
    outline: float = 0.5
    """Weight of the overlap of boxes against the depth's agreement."""
    enough: float = 0.9
    """A first result whose depth agrees this well needs no further start."""
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)
    """How sure a pose is."""


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """A pose with what speaks for it."""

    T_camera_part: Transform
    value: float
    """By which poses of a part are compared."""
    confidence: float
    moved: bool
    """Whether registration moved it."""


def best_registration(
    starts: Sequence[Transform],
    shape: PartShape,
    frame: Frame,
    *,
    box_xyxy: Box | None,
    score: float,
    config: RegistrationConfig,
) -> Registered:
    """Register from every start and return the best, which may be a start itself.

    Args:
        starts: poses, the likeliest first; one at least.
        shape: of the part.
        frame: with depth, or the first start is returned.
        box_xyxy: where the part was detected, pixels, or None.
        score: of the first pose, 0 to 1.
        config: options.
    """
    best: Registered | None = None
    for start in starts[: config.starts]:
        for found in _tried(start, shape, frame, box_xyxy, score, config):
            if best is None or found.value > best.value:
                best = found
        if frame.depth is None or (best is not None and best.value >= _most(box_xyxy, config)):
            break
    assert best is not None
    return best


def _most(box_xyxy: Box | None, config: RegistrationConfig) -> float:
    return config.enough * (1 + config.outline * (box_xyxy is not None))


def _tried(
    start: Transform,
    shape: PartShape,
    frame: Frame,
    box_xyxy: Box | None,
    score: float,
    config: RegistrationConfig,
) -> list[Registered]:
    """The start, and what registration makes of it."""
    found = [_judged(start, shape, frame, box_xyxy, score, (0.0, 0.0), config)]
    if frame.depth is None or not config.enabled:
        return found
    fitted = register(
        start,
        shape.cloud,
        box_xyxy=_projected_box(start, shape, frame),
        depth=frame.depth,
        K=frame.camera.K,
        config=config.icp,
    )
    if fitted is not None and fitted.residual <= config.residual:
        quality = (fitted.share, fitted.residual)
        moved = _judged(fitted.T_camera_part, shape, frame, box_xyxy, score, quality, config)
        found.append(replace(moved, moved=True))
    return found


def _judged(
    T_camera_part: Transform,
    shape: PartShape,
    frame: Frame,
    box_xyxy: Box | None,
    score: float,
    quality: tuple[float, float],
    config: RegistrationConfig,
) -> Registered:
    fit = depth_fit(
        T_camera_part,
        shape.surface[::3],
        shape.normals[::3],
        depth=frame.depth,
        K=frame.camera.K,
        margin=config.margin,
    )
    depth = 0.0 if fit is None else fit.share
    outline = 0.0
    if box_xyxy is not None:
        outline = _overlap(_projected_box(T_camera_part, shape, frame), box_xyxy)
    sure = confidence(
        depth=depth,
        outline=outline,
        registered=quality[0],
        residual=quality[1],
        detection=score,
        config=config.confidence,
    )
    return Registered(T_camera_part, depth + config.outline * outline, sure, moved=False)


def _projected_box(T_camera_part: Transform, shape: PartShape, frame: Frame) -> Box:
    points = apply(T_camera_part, shape.corners)
    points[:, 2] = np.maximum(points[:, 2], 0.01)
    pixels = project(points, frame.camera.K)
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def _overlap(a: Box, b: Box) -> float:
    """Intersection over union."""
    extent = np.clip(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0, None)
    both = float(extent.prod())
    return both / max(float((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod()) - both, 1e-9)
