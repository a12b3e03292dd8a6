"""Poses that depth moved into the table, or tilted on it, put right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply
from asdfviz.methods.part_poses import PartShape, shape_fit
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import ANY_TABLE, table_near, table_of
from asdfviz.pose.depth_fit import DepthFit
from asdfviz.pose.standing import StandingConfig, laid_flat, lifted, sides
from asdfviz.pose.table import SunkConfig, Table

BELOW = 0.05
"""All of a pose lies lower than this under the table that is far below it, metres."""
MARGIN = 0.004
"""Readings this near to the surface agree with it, metres."""


@dataclass(frozen=True)
class OnTableConfig:
    """What the table does to poses from crops; the paper has no such step."""

    enabled: bool = True
    """On or off."""
    sunk: SunkConfig = field(default_factory=SunkConfig)
    """What stands in it."""
    standing: StandingConfig = field(default_factory=StandingConfig)
    """What lies on it."""

    @property
    def counted(self) -> SunkConfig | None:
        """What it means to stand in it; None where that does not count."""
        return self.sunk if self.enabled else None


NO_TABLE = OnTableConfig(enabled=False)
"""For first poses of methods whose contours settle them: rotations gain little, states lose. What the
table says of turns (`turn_checks`) is another matter."""


def on_table(
    poses: Mapping[str, PoseEstimate],
    assembly: Assembly,
    shapes: Mapping[str, PartShape],
    frame: Frame,
    *,
    config: OnTableConfig,
) -> dict[str, PoseEstimate]:
    """The poses: what lies on the table flat on it, and nothing in it; what the state holds as it is."""
    result = dict(poses)
    for name, pose in poses.items():
        if pose.stage == "group":
            continue
        box = projected_box(pose.T_camera_part, shapes[name].corners, frame)
        table = table_near(frame, box) if config.enabled else None
        if table is None:
            continue
        downs = sides(assembly.parts[name].mesh)
        moved = _moved(pose.T_camera_part, shapes[name], downs, table, frame, config)
        if moved is not None:
            result[name] = replace(pose, T_camera_part=moved)
    return result


def none_below(
    poses: Mapping[str, PoseEstimate], shapes: Mapping[str, PartShape], frame: Frame
) -> dict[str, PoseEstimate]:
    """The poses without those that lie far below the table where depth says nothing of them.

    A small thing at the image's rim, where the depth camera sees nothing, may look like a part a metre
    below; readings would have told.
    """
    unmeasured = [n for n, p in poses.items() if _fit(p.T_camera_part, shapes[n], frame) is None]
    table = table_of(frame, ANY_TABLE) if unmeasured else None
    if table is None:
        return dict(poses)
    below: set[str] = set()
    for name in unmeasured:
        corners = apply(poses[name].T_camera_part, shapes[name].corners)
        heights = corners @ table.normal + table.offset
        if heights.max() < -BELOW:
            below.add(name)
    return {name: pose for name, pose in poses.items() if name not in below}


def _moved(
    T: Transform,
    shape: PartShape,
    downs: Float64[np.ndarray, "s 3"],
    table: Table,
    frame: Frame,
    config: OnTableConfig,
) -> Transform | None:
    """The pose laid flat, or else lifted; None where depth speaks against both."""
    assert frame.depth is not None  # it shows the table
    corners = shape.corners
    flat = laid_flat(T, downs, corners, table, config=config.standing)
    above = lifted(
        T,
        corners,
        table,
        depth=frame.depth,
        K=frame.camera.K,
        sunk=config.sunk,
        config=config.standing,
    )
    tried = [moved for moved in (flat, above) if moved is not None]
    if not tried:
        return None
    least = _share(T, shape, frame) - config.standing.worse
    return next((moved for moved in tried if _share(moved, shape, frame) >= least), None)


def _share(T: Transform, shape: PartShape, frame: Frame) -> float:
    """Of the readings, those that agree; 0 where depth says nothing."""
    fit = _fit(T, shape, frame)
    return 0.0 if fit is None else fit.share


def _fit(T: Transform, shape: PartShape, frame: Frame) -> DepthFit | None:
    """How a pose agrees with depth; None where that says nothing."""
    return shape_fit(T, shape, frame, margin=MARGIN)
