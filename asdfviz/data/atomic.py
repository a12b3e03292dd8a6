"""Writes files so that a reader sees the old content or the new one, never half of it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from asdfviz.data.path_names import check_name
from asdfviz.errors import InputError


def make_folder(folder: Path) -> None:
    """Make a folder for results and try that it takes files, before hours go into what belongs there.

    Raises:
        InputError: a file stands in the way, nothing can be written there, or its name is no text.
    """
    check_name(folder)
    for place in (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise InputError(f"{place} is a file; results need a folder, so name another one")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        trial = folder / f".trial.{secrets.token_hex(6)}"
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise InputError(
            f"cannot write into {folder}: {error.strerror}; name a folder that takes files"
        ) from error


@contextmanager
def results_in(folder: Path) -> Generator[None]:
    """Make a folder for results as `make_folder` does; one that the body leaves empty by an error goes."""
    is_new = not folder.exists()
    make_folder(folder)
    try:
        yield
    except BaseException:
        if is_new:
            with suppress(OSError):
                folder.rmdir()  # only if nothing is in it
        raise


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path` in one step, making its folder if needed.

    The bytes go to a temporary file in the same folder first, because a rename is atomic only
    within one file system.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 to `path` in one step, making its folder if needed."""
    write_bytes(path, text.encode("utf-8"))
