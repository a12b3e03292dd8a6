"""Reads camera.json and scene_camera.json: intrinsics, size, lens, and the unit of the depth images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asdfviz.data.json_files import Json, read_json
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Distortion, Intrinsics

LENS_NUMBERS = (4, 5, 8)
"""How many coefficients a lens may have; an Azure Kinect's has eight."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraEntry:
    """What a file says of the camera of one frame, or of all."""

    K: Intrinsics
    depth_scale: float | None
    """Millimetres per unit of the depth images; None where the file does not say."""
    size_wh: tuple[int, int] | None = None
    distortion: Distortion | None = None
    """Of the colour images as they lie on disk."""


def read_camera_file(path: Path) -> CameraEntry:
    """Read camera.json: fx fy cx cy, and if given width, height, depth_scale and distortion.

    Raises:
        SequenceError: a field is missing, not finite or impossible.
    """
    content = read_json(path, error=SequenceError)
    fx, fy, cx, cy = (content.get(key).number() for key in ("fx", "fy", "cx", "cy"))
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return CameraEntry(
        K=_checked(K, content.where),
        depth_scale=_depth_scale(content),
        size_wh=_size(content),
        distortion=_distortion(content),
    )


LARGEST_SCALE = 1e6
"""Millimetres per unit of depth; a kilometre is none that a camera counts in."""
MOST_DIGITS = 30
"""Of a frame number; Python itself reads none of thousands."""


def read_scene_cameras(path: Path) -> dict[int, CameraEntry]:
    """Read BOP's scene_camera.json: `cam_K` (9 numbers, row by row) and `depth_scale` by frame.

    Raises:
        SequenceError: with the frame and the field.
    """
    cameras: dict[int, CameraEntry] = {}
    for key, entry in read_json(path, error=SequenceError).items().items():
        K = entry.get("cam_K").numbers(9).reshape(3, 3)
        cameras[frame_number(key, entry.where)] = CameraEntry(
            K=_checked(K, entry.where), depth_scale=_depth_scale(entry), size_wh=_size(entry)
        )
    if not cameras:
        raise SequenceError(f"{path} is empty; it needs an entry for every frame")
    return cameras


def frame_number(key: str, where: str) -> int:
    """Read a frame number that stands as a key, as in {"0": ..., "1": ...}.

    Raises:
        SequenceError: it is none.
    """
    if not is_frame_number(key):
        raise SequenceError(f"{where[:200]}: a frame number like 0 or 000000 is expected")
    return int(key)


def is_frame_number(text: str) -> bool:
    """Whether digits are a frame number, times in nanoseconds among them."""
    return text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS


def _checked(K: Intrinsics, where: str) -> Intrinsics:
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise SequenceError(
            f"{where}: focal lengths must be positive pixels, got fx {K[0, 0]:g} and fy {K[1, 1]:g}"
        )
    if np.abs(K[2] - [0.0, 0.0, 1.0]).max() > 1e-9 or abs(K[1, 0]) > 1e-9:
        raise SequenceError(
            f"{where}: not a camera matrix, expected fx 0 cx 0 fy cy 0 0 1 row by row"
        )
    K.flags.writeable = False
    return K


def _depth_scale(content: Json) -> float | None:
    field = content.find("depth_scale")
    if field is None:
        return None
    scale = field.number()
    if not 0 < scale <= LARGEST_SCALE:
        raise field.fail(
            f"millimetres per unit of the depth images, above 0 and up to {LARGEST_SCALE:g}"
        )
    return scale


def _size(content: Json) -> tuple[int, int] | None:
    fields = content.find("width"), content.find("height")
    if fields[0] is None or fields[1] is None:
        return None
    width, height = fields[0].integer(), fields[1].integer()
    if width <= 0 or height <= 0:
        raise SequenceError(f"{content.where}: width and height must be positive pixels")
    return width, height


def _distortion(content: Json) -> Distortion | None:
    field = content.find("distortion")
    if field is None:
        return None
    distortion = field.numbers(*LENS_NUMBERS)
    if not distortion.any():
        return None
    distortion.flags.writeable = False
    return distortion
