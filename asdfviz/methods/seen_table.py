"""The table in a frame, found once for all that ask."""

from __future__ import annotations

from functools import lru_cache

from asdfviz.datatypes import Frame
from asdfviz.geometry.shapes import Box
from asdfviz.pose.blobs import Heights, heights_above
from asdfviz.pose.table import Table, TableConfig, largest_plane, table_around

ANY_TABLE = TableConfig()
"""What counts where nobody chose."""


@lru_cache(maxsize=2)
def table_of(frame: Frame, config: TableConfig) -> Table | None:
    """The largest plane of a frame; None without depth, or where no plane is large enough."""
    if frame.depth is None:
        return None
    return largest_plane(frame.depth, frame.camera.K, config=config)


@lru_cache(maxsize=2)
def heights_in(frame: Frame, config: TableConfig) -> Heights | None:
    """How high all that a frame shows lies above its table, metres; None where that is not known."""
    table = table_of(frame, config)
    if table is None or frame.depth is None:
        return None
    return heights_above(frame.depth, frame.camera.K, table)


def table_near(frame: Frame, box_xyxy: Box) -> Table | None:
    """The table at the height that it has around a box; None where it is not known."""
    table = table_of(frame, ANY_TABLE)
    if table is None or frame.depth is None:
        return None
    return table_around(box_xyxy, table, depth=frame.depth, K=frame.camera.K)
