"""The images of a frame as the tracker's kernels want them, once they are known to fit its camera."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Camera, Frame
from asdfviz.errors import InputError
from asdfviz.geometry.camera import is_same_lens
from asdfviz.geometry.shapes import Rgb
from asdfviz.track.visibility import NO_DEPTH, MaybeDepth


def fitting_images(frame: Frame, camera: Camera, *, with_depth: bool) -> tuple[Rgb, MaybeDepth]:
    """Colour, and depth where it is asked for.

    Raises:
        InputError: the frame has another size or other intrinsics than the camera, or lacks depth.
    """
    shape = (camera.height, camera.width)
    if frame.rgb.shape[:2] != shape:
        raise InputError(
            f"frame {frame.index} is {frame.rgb.shape[1]}x{frame.rgb.shape[0]}, "
            f"the tracker's camera {shape[1]}x{shape[0]}"
        )
    if not is_same_lens(frame.camera.K, camera.K):
        raise InputError(
            f"frame {frame.index} has other intrinsics ({_told(frame.camera)}) than the tracker's "
            f"camera ({_told(camera)}): what is tracked needs one camera for all frames; methods that "
            "take every frame by itself, as asdf does, need none"
        )
    if not with_depth:
        return np.ascontiguousarray(frame.rgb), NO_DEPTH
    if frame.depth is None:
        raise InputError(f"frame {frame.index} has no depth, which this tracker needs")
    return np.ascontiguousarray(frame.rgb), np.ascontiguousarray(frame.depth)


def _told(camera: Camera) -> str:
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    return f"fx {fx:.1f}, fy {fy:.1f}, cx {cx:.1f}, cy {cy:.1f}"
