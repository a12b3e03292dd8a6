"""Refinement of the paper's "+Seg" row (Table 2): a mask says which depth readings are the part's.

The paper names the row and gives its figures, no recipe. Read here as section 3.1.1 with one thing
changed: of the readings in the predicted box only those inside the part's mask count, so that what
stands before the part or behind its outline has no say. The rest, W(d) among it, is as there, and
the rotation stays.

- Edges: pixels beside a depth edge are left out before the mask is applied; at the rim of a mask
  the edge's other side is no longer there to tell them by.
- Coarse step: with the box alone it reads the box's middle, where the part most likely is. The mask
  knows, so the whole box is read.
- A detection without a mask, or with too few readings inside it, moves nothing.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from asdfviz.geometry.boxes import BoxMask
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Mask, Points, Transform
from asdfviz.pose.translation import TranslationConfig, refine_translation

RIM = np.ones((3, 3), np.uint8)
"""A pixel and its neighbours."""


def refine_in_mask(
    T_camera_part: Transform,
    points_part: Points,
    *,
    mask: BoxMask | None,
    box_xyxy: Box,
    depth: Depth | None,
    K: Intrinsics,
    config: TranslationConfig,
) -> Transform | None:
    """Move the part along the viewing ray so that its surface meets the depth inside its mask.

    Args:
        T_camera_part: the pose to refine; its rotation stays.
        points_part: points on the part's surface, metres.
        mask: of the part; None where there is none.
        box_xyxy: the predicted box, pixels.
        depth: planar depth in metres, 0 = none, or None where there is no depth image.
        K: intrinsics of image and depth.
        config: scales, counts and gates, as for `refine_translation`.

    Returns:
        None where mask or depth is missing, too sparse or does not agree with the part.
    """
    if mask is None or depth is None:
        return None
    height, width = mask.pixels.shape
    rows, columns = slice(mask.top, mask.top + height), slice(mask.left, mask.left + width)
    seen = depth[rows, columns]
    shift = np.array([mask.left, mask.top], np.float64)
    K_seen = K.copy()
    K_seen[:2, 2] -= shift
    return refine_translation(
        T_camera_part,
        points_part,
        box_xyxy=box_xyxy - np.tile(shift, 2),
        depth=np.where(mask.pixels & ~_beside_edge(seen, config.edge), seen, np.float32(0)),
        K=K_seen,
        config=replace(config, coarse_area=1.0),
    )


def _beside_edge(depth: Depth, edge: float) -> Mask:
    """Pixels whose neighbourhood spans more than `edge` metres; holes (0) count as no depth."""
    highest = cv2.dilate(depth, RIM)
    lowest = cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), RIM)
    return np.asarray(highest - lowest > edge)
