"""Tells by a file's bytes what kind of image it is, whatever it is called, and whether its end is there."""

from __future__ import annotations

import os
import struct
from pathlib import Path

_STARTS = (
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"\xff\xd8", "JPEG"),
    (b"II*\0", "TIFF"),
    (b"MM\0*", "TIFF"),
    (b"II+\0", "TIFF"),
    (b"\x93NUMPY", "NPY"),
    (b"v/1\x01", "EXR"),
    (b"BM", "BMP"),
    (b"GIF8", "GIF"),
    (b"RIFF", "WebP"),
)
_ENDS = {"PNG": b"IEND\xaeB`\x82", "JPEG": b"\xff\xd9"}
# Some cameras append a thumbnail or padding behind the end marker.
_TAIL = 4096
_ORIENTATION, _MOST_TAGS = 274, 65535
_HEAD = max(len(start) for start, _ in _STARTS)


def image_kind(head: bytes) -> str | None:
    """The kind of image that begins so; None where it is none that is known, nor where nothing is there."""
    return next((kind for start, kind in _STARTS if head.startswith(start)), None)


def has_end(data: bytes, kind: str) -> bool:
    """Whether an image of a kind ends as it should; true of kinds that have no mark at their end."""
    return _ENDS.get(kind, b"") in data[-_TAIL:]


def tiff_orientation(data: bytes) -> int:
    """The orientation that a TIFF's first image asks to be shown in, 2 to 8; 1, as it is stored, where it asks none.

    Source: TIFF 6.0, sections 2 and 8, and the BigTIFF design of libtiff. Of a file that is cut off
    before its tags, 1: whoever decodes it says so.
    """
    order = "<" if data.startswith(b"II") else ">"
    is_big = data[2:4] in (b"+\0", b"\0+")
    begin, count, size, value = (8, "Q", 20, 12) if is_big else (4, "H", 12, 8)
    try:
        (at,) = struct.unpack_from(order + ("Q" if is_big else "I"), data, begin)
        (tags,) = struct.unpack_from(order + count, data, at)
        first = at + struct.calcsize(count)
        for entry in range(first, first + size * min(tags, _MOST_TAGS), size):
            if struct.unpack_from(order + "H", data, entry) == (_ORIENTATION,):
                return int(struct.unpack_from(order + "H", data, entry + value)[0])
    except struct.error:
        return 1
    return 1


def kind_and_end(image: Path) -> tuple[str | None, bool]:
    """The kind of image that a file holds and whether its end is there, by its first and last bytes.

    A file that is missing, cannot be read or holds no known kind has neither.
    """
    try:
        with image.open("rb") as file:
            kind = image_kind(file.read(_HEAD))
            file.seek(-min(image.stat().st_size, _TAIL), os.SEEK_END)
            return kind, kind is not None and has_end(file.read(), kind)
    except OSError:
        return None, False
