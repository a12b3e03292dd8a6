"""Poses that depth moved into the table, or tilted on it, put right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import table_of
from asdfviz.pose.depth_fit import depth_fit
from asdfviz.pose.standing import StandingConfig, laid_flat, lifted, sides
from asdfviz.pose.table import SunkConfig, Table, table_around

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
"""For methods whose contours settle poses: their rotations gain little, their states lose."""


def on_table(
    poses: Mapping[str, PoseEstimate],
    assembly: Assembly,
    shapes: Mapping[str, PartShape],
    frame: Frame,
    *,
    config: OnTableConfig,
) -> dict[str, PoseEstimate]:
    """The poses: what lies on the table flat on it, and nothing in it."""
    everywhere = table_of(frame) if config.enabled else None
    if everywhere is None or frame.depth is None:
        return dict(poses)
    result = dict(poses)
    for name, pose in poses.items():
        shape, T = shapes[name], pose.T_camera_part
        box, K = projected_box(T, shape, frame), frame.camera.K
        table = table_around(box, everywhere, depth=frame.depth, K=K)
        if table is None:
            continue
        moved = laid_flat(
            T,
            sides(assembly.parts[name].mesh),
            shape.corners,
            table,
            config=config.standing,
            lift=config.sunk.lift,
        )
        least = _share(T, shape, frame) - config.standing.worse
        if moved is None or _share(moved, shape, frame) < least:
            moved = _lifted(T, shape, table, frame, config.sunk)
        if moved is not None and _share(moved, shape, frame) >= least:
            result[name] = replace(pose, T_camera_part=moved)
    return result


def _lifted(
    T: Transform, shape: PartShape, table: Table, frame: Frame, config: SunkConfig
) -> Transform | None:
    if frame.depth is None:
        return None
    return lifted(T, shape.corners, table, depth=frame.depth, K=frame.camera.K, config=config)


def _share(T: Transform, shape: PartShape, frame: Frame) -> float:
    """Of the readings, those that agree; 0 where depth says nothing."""
    fit = depth_fit(
        T,
        shape.surface[::3],
        shape.normals[::3],
        depth=frame.depth,
        K=frame.camera.K,
        margin=MARGIN,
    )
    return 0.0 if fit is None else fit.share
