"""What stands out of the table in the depth image: boxes around it, whatever it is.

Not in the paper. Where a detector misses a part that lies about, depth still shows that something is
there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.geometry.shapes import Box, Depth, Intrinsics
from asdfviz.pose.table import Table, TableConfig

Heights: TypeAlias = Float32[np.ndarray, "h w"]
"""Above the table, metres."""


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


def heights_above(depth: Depth, K: Intrinsics, table: Table) -> Heights:
    """How high every reading lies above the table, metres, single ones smoothed away; 0 without one.

    Args:
        depth: planar depth, metres, 0 = none.
        K: its intrinsics.
        table: in the camera's frame.
    """
    height, width = depth.shape
    rows, columns = np.ogrid[:height, :width]
    above = table.heights(depth, rows=rows, columns=columns, K=K)
    above[depth <= 0] = 0.0
    return cv2.medianBlur(above, 3)


def standing_out(above: Heights | None, *, config: BlobConfig) -> list[Box]:
    """Boxes (x0, y0, x1, y1 in pixels) around what stands out of the table.

    Args:
        above: as `heights_above` gives them; None where there is no table.
        config: what counts.

    Returns:
        The largest first; none without a table.
    """
    if above is None:
        return []
    out = cv2.inRange(above, np.array([config.rise]), np.array([config.most]))
    out = cv2.morphologyEx(out, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    # Outlines, the inner ones left out: a hundredth of the time of connected components.
    outlines, nested = cv2.findContours(out, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    height, width = above.shape
    found: list[tuple[float, Box]] = []
    for place, outline in enumerate(outlines):
        if np.reshape(nested, (-1, 4))[place, 3] >= 0:
            continue  # a hole in another one
        x, y, w, h = cv2.boundingRect(outline)
        # Pick's theorem: its pixels, those of holes among them.
        area = cv2.contourArea(outline) + len(outline) / 2 + 1
        if area >= config.min_px and w < width / 2 and h < height / 2:
            found.append((area, np.array([x, y, x + w, y + h], np.float64) - 0.5))
    found.sort(key=lambda one: -one[0])
    return [box for _, box in found]
