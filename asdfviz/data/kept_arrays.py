"""Keeps arrays that take long to make in the user's cache folder, so that a machine makes them once.

A file's name has to say all that its content depends on: whatever has that name is taken as it is.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from asdfviz.data.atomic import write_bytes


def user_cache_folder(kind: str) -> Path:
    """The folder of one kind of files, on the machine that this runs on.

    Raises:
        RuntimeError: the user has no home.
    """
    caches = os.environ.get("XDG_CACHE_HOME")
    return (Path(caches) if caches else Path.home() / ".cache") / "asdfviz" / kind


def kept_arrays(
    kind: str, name: str, make: Callable[[], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Read arrays back to the last bit; make them, and keep them, where no file has them.

    Args:
        kind: of the files, which have a folder of their own.
        name: of the file.
        make: gives the arrays. A cache that cannot be kept is no error.
    """
    try:
        place = user_cache_folder(kind) / f"{name}.npz"
    except RuntimeError:
        return make()
    with suppress(OSError, EOFError, ValueError, zipfile.BadZipFile):
        return unpacked(place.read_bytes())
    made = make()
    buffer = io.BytesIO()
    np.savez(buffer, **made)  # pyright: ignore[reportArgumentType] - none is named as an option is
    with suppress(OSError):
        write_bytes(place, buffer.getvalue())
    return made


def unpacked(packed: bytes) -> dict[str, np.ndarray]:
    """The arrays of an .npz file.

    Raises:
        EOFError, ValueError, zipfile.BadZipFile: it is something else.
    """
    # In memory, because NumPy leaves a file open that turns out to be none of its own.
    with np.load(io.BytesIO(packed), allow_pickle=False) as file:
        return {key: file[key] for key in file.files}
