"""The table in a frame, found once for all that ask."""

from __future__ import annotations

from functools import lru_cache

from asdfviz.datatypes import Frame
from asdfviz.pose.table import Table, TableConfig, largest_plane


@lru_cache(maxsize=2)
def table_of(frame: Frame) -> Table | None:
    """The largest plane of a frame; None without depth, or where no plane is large enough."""
    if frame.depth is None:
        return None
    return largest_plane(frame.depth, frame.camera.K, config=TableConfig())
