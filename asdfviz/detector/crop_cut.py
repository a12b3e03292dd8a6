"""Cuts a square out of a frame as a camera would see it that looks straight at the part.

The crop's camera shares the frame's centre; its axis goes through the middle of the box, turned by
the smallest rotation (`rotation_to_ray`), so a part's look and its rotation in the crop do not
depend on where it is in the frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import UInt8

from asdfviz.geometry.boxes import box_middle, longer_side
from asdfviz.geometry.rotation_grid import rotation_to_ray
from asdfviz.geometry.shapes import Box, Intrinsics, Rgb, Rotation

CROP_PIXELS = 96
"""Side of the network's input."""
CONTEXT = 1.25
"""Side of the crop over the longer side of the box."""
SHARPEST = 0.6
"""Below this many crop pixels a frame pixel, the crop is cut larger and averaged."""


@dataclass(frozen=True, slots=True, eq=False)
class CropCamera:
    """The camera of a crop."""

    K: Intrinsics
    """Of the crop, pixels; an integer is a pixel's centre."""
    R_camera_crop: Rotation
    """From the crop's camera to the frame's; both have the same centre."""


def crop_camera(box_xyxy: Box, K: Intrinsics, *, side: int = CROP_PIXELS) -> CropCamera:
    """The camera that looks at a box of a frame.

    Args:
        box_xyxy: pixels of the frame.
        K: the frame's intrinsics.
        side: of the crop, pixels.
    """
    middle = box_middle(box_xyxy)
    extent = max(longer_side(box_xyxy), 2.0)
    ray = np.linalg.solve(K, np.array([*middle, 1.0]))
    # Pixels grow with the square of 1 / cos off the axis along the radius, and with 1 / cos across.
    stretch = float(np.linalg.norm(ray)) ** 1.5
    focal = float(np.sqrt(K[0, 0] * K[1, 1])) * side * stretch / (CONTEXT * extent)
    center = (side - 1) / 2
    return CropCamera(
        np.array([[focal, 0, center], [0, focal, center], [0, 0, 1.0]]), rotation_to_ray(ray)
    )


def metric_side(camera: CropCamera, distance: float) -> float:
    """Longer side of the box that a crop was made of, at a distance (along the frame's z), metres."""
    ahead = float(camera.R_camera_crop[2, 2])
    return CROP_PIXELS * distance / (ahead * CONTEXT * float(camera.K[0, 0]))


def cut(
    rgb: Rgb,
    camera: CropCamera,
    K: Intrinsics,
    *,
    size: tuple[int, int] = (CROP_PIXELS, CROP_PIXELS),
) -> UInt8[np.ndarray, "height width 3"]:
    """The crop's picture, of this width and height; beyond the frame's border its last pixels go on."""
    scale = camera.K[0, 0] / K[0, 0]
    finer = 1 if scale >= SHARPEST else min(4, int(np.ceil(1 / scale)))
    S = np.array([[finer, 0, (finer - 1) / 2], [0, finer, (finer - 1) / 2], [0, 0, 1.0]])
    H_crop_frame = S @ camera.K @ camera.R_camera_crop.T @ np.linalg.inv(K)
    picture = cv2.warpPerspective(
        rgb,
        H_crop_frame,
        (size[0] * finer, size[1] * finer),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if finer > 1:
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(picture, np.uint8)
