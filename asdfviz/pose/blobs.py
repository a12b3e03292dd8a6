"""What stands out of the table in the depth image: boxes around it, whatever it is.

Not in the paper. Where a detector misses a part that lies about, depth still shows that something is
there.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.shapes import Box, Depth, Intrinsics
from asdfviz.pose.table import Table, TableConfig


@dataclass(frozen=True)
class BlobConfig:
    """What counts as standing out."""

    table: TableConfig = field(default_factory=TableConfig)
    """What they stand out of."""
    rise: float = 0.004
    """What is less above the table belongs to it, metres."""
    most: float = 0.2
    """What is more above it is no part that lies about, metres."""
    min_px: int = 40
    """Smaller ones are noise, pixels."""


def standing_out(
    depth: Depth, K: Intrinsics, table: Table | None, *, config: BlobConfig
) -> list[Box]:
    """Boxes (x0, y0, x1, y1 in pixels) around what stands out of the table.

    Args:
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
        table: in the camera's frame, if there is one.
        config: what counts.

    Returns:
        The largest first; none without a table.
    """
    if table is None:
        return []
    height, width = depth.shape
    rows, columns = np.mgrid[:height, :width]
    above = table.heights(depth, rows=rows, columns=columns, K=K)
    above = np.where(depth > 0, above, 0.0).astype(np.float32)
    return _boxes(cv2.medianBlur(above, 3), config)


def _boxes(above: Float32[np.ndarray, "h w"], config: BlobConfig) -> list[Box]:
    out = ((above > config.rise) & (above < config.most)).astype(np.uint8)
    out = cv2.morphologyEx(out, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, _, found, _ = cv2.connectedComponentsWithStats(out, connectivity=8)
    height, width = above.shape
    rows = [
        row
        for row in found[1:]
        if row[cv2.CC_STAT_AREA] >= config.min_px
        and row[cv2.CC_STAT_WIDTH] < width / 2
        and row[cv2.CC_STAT_HEIGHT] < height / 2
    ]
    rows.sort(key=lambda row: -int(row[cv2.CC_STAT_AREA]))
    return [
        np.array([x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5], np.float64) for x, y, w, h, _ in rows
    ]
