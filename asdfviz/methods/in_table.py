"""Unsure poses that have a part stand in the table are not the part's.

Not in the paper. Where there is no part, depth shows the table, and nothing refutes a pose under it: it looks
like one that something nearer hides. So a pin that a hand has taken is found in the bare cloth beside, by the
networks or by a tracker that lost it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from asdfviz.datatypes import Frame, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.camera import nearest_pixels
from asdfviz.geometry.shapes import Points, Transform
from asdfviz.geometry.transforms import apply
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import ANY_TABLE, table_near, table_of
from asdfviz.pose.table import Table

LENS = 0.02
"""What is around a part farther from the table of the whole image than this is no table, but an arm, metres."""


@dataclass(frozen=True)
class InTableConfig:
    """When a part stands in the table.

    Of 2,143 right poses of loose parts by `asdf_plus` on eight synthetic sequences (the paper's and our
    assemblies, seeds 86 and 85) one has half of its surface 3 mm under what was taken for the table: an arm.
    """

    enabled: bool = True
    """On or off."""
    deep: float = 0.003
    """What is deeper under the table than this is in it, metres: readings err."""
    share: float = 0.5
    """If more of the surface is in it than this, 0 to 1, so is the part,"""
    sure: float = 0.8
    """unless its pose scores more than this: in real frames small parts are measured as if they stood in it."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not (self.deep >= 0 and 0 <= self.share <= 1 and 0 <= self.sure <= 1):
            raise MethodError(
                f"in_table.deep is {self.deep:g}, share {self.share:g} and sure {self.sure:g}: deep must "
                "be 0 or more, the others 0 to 1"
            )


def in_table(
    poses: Mapping[str, PoseEstimate],
    shapes: Mapping[str, PartShape],
    frame: Frame,
    *,
    base: str,
    config: InTableConfig,
) -> frozenset[str]:
    """The parts whose poses have them stand in the table; what is sure, what the state holds, and the base
    never do.

    Args:
        poses: by part.
        shapes: of the parts.
        frame: without depth nothing is known of a table.
        base: the part on which all others hang; where it is has other witnesses.
        config: what counts.
    """
    if not config.enabled or frame.depth is None:
        return frozenset()
    unsure = {
        name: pose.T_camera_part
        for name, pose in poses.items()
        if name != base and pose.stage != "group" and pose.score <= config.sure
    }
    return frozenset(n for n, T in unsure.items() if _is_in(T, shapes[n], frame, config))


def _is_in(T: Transform, shape: PartShape, frame: Frame, config: InTableConfig) -> bool:
    table = _table(T, shape, frame)
    if table is None:
        return False
    points = apply(T, shape.surface[::3])
    heights = points @ table.normal + table.offset
    low = heights < -config.deep
    # Depth draws the front of such a part to the table; one that is all under it is rather beneath an arm
    # that was taken for the table.
    if low.all():
        return False
    # Past its edge one looks down beside it.
    seen = _heights_seen(points[low], table, frame)
    return bool((seen > -config.deep).sum() > config.share * len(points))


def _table(T: Transform, shape: PartShape, frame: Frame) -> Table | None:
    """The table about a part: lenses bend it by millimetres."""
    table = table_of(frame, ANY_TABLE)
    near = table_near(frame, projected_box(T, shape.corners, frame))
    if table is None or near is None or abs(near.offset - table.offset) > LENS:
        return table
    return near


def _heights_seen(points: Points, table: Table, frame: Frame) -> Float32[np.ndarray, "read"]:
    """How high what depth shows where these points would be seen lies above the table, metres; of those in
    view that have a reading."""
    assert frame.depth is not None  # asked before
    K = frame.camera.K
    _, rows, columns = nearest_pixels(points, K, frame.depth.shape)
    depth = frame.depth[rows, columns]
    return table.heights(depth[None], rows=rows[None], columns=columns[None], K=K)[0, depth > 0]
