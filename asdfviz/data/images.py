"""Decodes colour and depth images, and undoes the lens; refuses what is broken or of a wrong kind."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import UInt16

from asdfviz.data.image_files import has_end, image_kind, tiff_orientation
from asdfviz.errors import SequenceError, counted
from asdfviz.geometry.shapes import Depth, Distortion, Intrinsics, Rgb

RawDepth: TypeAlias = UInt16[np.ndarray, "h w"]

READ_KINDS = ("PNG", "JPEG")
"""Kinds of images that are decoded, by their first bytes."""
DEPTH_KINDS = (*READ_KINDS, "TIFF", "NPY")
"""Those of depth, whose bits all of them but JPEG keep."""


def read_rgb(path: Path) -> Rgb:
    """Read an 8-bit colour image (PNG or JPEG) as RGB, in the orientation of its pixels.

    Raises:
        SequenceError: the file is missing, truncated or no image.
    """
    # A camera file speaks of the stored pixels, so an EXIF turn would break its intrinsics.
    image = _decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def read_stored(path: Path) -> np.ndarray:
    """Read an image as it is stored: its own bit depth and channels (blue, green, red first).

    Raises:
        SequenceError: the file is missing, truncated or no image.
    """
    return _decode(path, cv2.IMREAD_UNCHANGED)


def kind_of(image: np.ndarray) -> str:
    """Bit depth and channels in words, for messages."""
    if image.ndim not in (2, 3):
        return f"an array of shape {image.shape}"
    channels = 1 if image.ndim == 2 else image.shape[2]
    number = " float" if image.dtype.kind == "f" else ""
    return f"{image.dtype.itemsize * 8} bit{number} with {counted(channels, 'channel')}"


def told_kind(kind: str) -> str:
    """What is told of a file of another kind than is read, as TIFF."""
    return f"a {kind} file, whatever its name says: save it as PNG (another name alone changes nothing)"


def read_raw_depth(path: Path) -> RawDepth:
    """Read a 16-bit depth image (PNG, TIFF or NumPy's NPY) in the file's own unit, as its pixels are stored.

    Raises:
        SequenceError: the file is missing, truncated, not 16 bit or not of one channel, or a TIFF
            that asks to be turned.
    """
    image = _decode(path, cv2.IMREAD_UNCHANGED, DEPTH_KINDS)
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    if image.dtype.kind != "u" or image.dtype.itemsize != 2 or image.ndim != 2:
        raise ImageKindError(
            path,
            f"is {kind_of(image)}; depth must be a PNG, TIFF or NPY of 16 bit with one channel: "
            f"{_depth_advice(image)}",
        )
    return np.ascontiguousarray(image, dtype=np.uint16)


def _depth_advice(image: np.ndarray) -> str:
    """How to come by such depth, by what is there instead."""
    if image.dtype.itemsize == 1:
        return "8 bits have lost it, so record it anew or convert it again from what was recorded"
    if image.dtype.kind == "f":
        return (
            "of metres, save np.nan_to_num(1000 * depth).round().astype(np.uint16), which is in mm"
        )
    if image.ndim == 3:
        return "if its channels are equal, save one of them alone"
    return "save it as np.uint16"


def metric_depth(raw: RawDepth, depth_scale: float) -> Depth:
    """Convert raw depth to metres; `depth_scale` is millimetres per unit."""
    return raw.astype(np.float32) * np.float32(depth_scale * 1e-3)


def check_size(image: np.ndarray, size_wh: tuple[int, int], path: Path) -> None:
    """Check that an image is as large as its camera.

    Raises:
        ImageSizeError: with both sizes.
    """
    height, width = image.shape[:2]
    if (width, height) != size_wh:
        raise ImageSizeError(
            f"{path} is {width} x {height} pixels, but the camera is {size_wh[0]} x {size_wh[1]}; "
            "scale the image or give the intrinsics of this size",
            color_wh=(width, height) if image.ndim == 3 else None,
        )


class ImageKindError(SequenceError):
    """An image is of another file format, bit depth or number of channels than is read."""

    def __init__(self, path: Path, fault: str) -> None:
        """Say which image it is.

        Args:
            path: the file.
            fault: what it is, and what would be right; the same for all that are so.
        """
        super().__init__(f"{path} {fault}")
        self.fault = fault


class ImageSizeError(SequenceError):
    """An image is not as large as its camera."""

    def __init__(self, message: str, *, color_wh: tuple[int, int] | None = None) -> None:
        """Say which image it is.

        Args:
            message: the file and both sizes.
            color_wh: the image's size where it is one of colour.
        """
        super().__init__(message)
        self.color_wh = color_wh


class Undistorter:
    """Maps colour images of one lens to the pinhole camera with the same K."""

    def __init__(self, K: Intrinsics, distortion: Distortion, size_wh: tuple[int, int]) -> None:
        self._maps = cv2.initUndistortRectifyMap(K, distortion, None, K, size_wh, cv2.CV_16SC2)

    def __call__(self, rgb: Rgb) -> Rgb:
        """Return the undistorted image; pixels the lens never saw are black."""
        return cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)


def _decode(path: Path, flags: int, kinds: tuple[str, ...] = READ_KINDS) -> np.ndarray:
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SequenceError(f"{path} does not exist") from error
    except OSError as error:
        raise SequenceError(f"{path} cannot be read: {error}") from error
    kind = image_kind(data)
    if kind is not None and kind not in kinds:
        raise ImageKindError(path, f"is {told_kind(kind)}")
    if kind == "TIFF" and (orientation := tiff_orientation(data)) != 1:
        # OpenCV turns a TIFF whatever it is told, and colour is read as its pixels are stored.
        raise ImageKindError(
            path,
            f"is a TIFF whose orientation tag ({orientation}) asks to turn or mirror it, and colour is read "
            "as its pixels are stored: save it without the tag, its pixels lying as those of colour",
        )
    # OpenCV fills what a cut file lacks with grey or garbage instead of failing.
    if kind is None or not has_end(data, kind):
        raise SequenceError(f"{path} is truncated or no PNG or JPEG image ({len(data)} bytes)")
    image = _array(data) if kind == "NPY" else cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise SequenceError(f"{path} is corrupt: it cannot be decoded as an image")
    return image


def _array(data: bytes) -> np.ndarray | None:
    """The array of an NPY file; None where it is cut off or holds Python objects."""
    try:
        return np.load(BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError):
        return None
