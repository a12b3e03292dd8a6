"""Encodes pictures, the one way for every file that this program writes."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from asdfviz.errors import InputError


def encoded(image: np.ndarray, *, suffix: str = ".png", options: Sequence[int] = ()) -> bytes:
    """The bytes of an image file.

    Args:
        image: as OpenCV stores it: one channel, or blue, green, red.
        suffix: .png or .jpg.
        options: OpenCV's IMWRITE flags and values.

    Raises:
        InputError: no such file can hold such an image.
    """
    done, data = cv2.imencode(suffix, np.ascontiguousarray(image), list(options))
    if not done:
        what = f"{image.dtype} image of shape {image.shape}"
        raise InputError(f"the {what} cannot be written as {suffix}")
    return data.tobytes()
