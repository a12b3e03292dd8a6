"""Tells by a file's bytes what kind of image it is, whatever it is called, and whether its end is there."""

from __future__ import annotations

import os
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
_HEAD = max(len(start) for start, _ in _STARTS)


def image_kind(head: bytes) -> str | None:
    """The kind of image that begins so; None where it is none that is known, nor where nothing is there."""
    return next((kind for start, kind in _STARTS if head.startswith(start)), None)


def has_end(data: bytes, kind: str) -> bool:
    """Whether an image of a kind ends as it should; true of kinds that have no mark at their end."""
    return _ENDS.get(kind, b"") in data[-_TAIL:]


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
