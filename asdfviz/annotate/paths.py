"""Where the annotation of a sequence is kept: one SQLite file a sequence, in one folder."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent.parent
_LONGEST = 100


def annotations_folder() -> Path:
    """The default folder: annotations/ of the clone, or of the working folder for a wheel."""
    is_clone = (_ROOT / "pyproject.toml").is_file() and (_ROOT / "models").is_dir()
    return (_ROOT if is_clone else Path.cwd()) / "annotations"


def annotation_file(sequence_name: str, *, folder: Path | None = None) -> Path:
    """The file for a sequence, always directly inside the folder.

    Letters, digits, dot, dash and underscore stay. A name with anything else (a path separator, a
    leading dot, too long) is tidied and gets a short hash of itself, so that two names never meet.
    """
    folder = annotations_folder() if folder is None else folder
    tidy = re.sub(r"[^A-Za-z0-9._-]+", "_", sequence_name).strip("._")[:_LONGEST]
    if tidy != sequence_name or not tidy:
        digest = hashlib.sha256(sequence_name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
        tidy = f"{tidy or 'sequence'}-{digest}"
    return folder / f"{tidy}.db"
