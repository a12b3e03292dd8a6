"""Which annotation file is a sequence's own: two captures in folders of one name never share one.

A sequence is known by its first pictures, so it stays itself when its folder is moved, when its camera
file is mended, and when frames are added at its end.
"""

from __future__ import annotations

import hashlib
from itertools import count
from pathlib import Path

from asdfviz.annotate.edit_file import read_identity
from asdfviz.annotate.paths import annotation_file
from asdfviz.annotate.store import AnnotationStore
from asdfviz.data.scene_files import COLOUR_FOLDERS, pictures_in
from asdfviz.datatypes import Assembly, Sequence
from asdfviz.errors import AnnotationError

PICTURES = 8
"""So many pictures are looked at; noise makes one enough for a camera, but not for a renderer."""


def sequence_identity(sequence: Sequence) -> str:
    """SHA-256 over names and contents of the first colour images; of the frame numbers without any."""
    return _identities(sequence)[-1]


def _identities(sequence: Sequence) -> list[str]:
    """The identity, last, and before it those that a capture had when it ended after fewer pictures."""
    digest = hashlib.sha256()
    found: list[str] = []
    for image in _first_images(Path(sequence.path)):
        digest.update(f"{image.name}\0".encode())
        digest.update(image.read_bytes())
        found.append(digest.hexdigest())
    if not found:
        digest.update(repr(sequence.frame_indices).encode())
        found.append(digest.hexdigest())
    return found


def _first_images(scene: Path) -> list[Path]:
    for name in COLOUR_FOLDERS:
        images = pictures_in(scene / name)
        if images:
            return images[:PICTURES]
    return []


def own_annotation_file(sequence: Sequence, *, folder: Path | None = None) -> Path:
    """The file of a sequence: <name>.db, or <name>-2.db where that is of another one of the name.

    A file that says nothing of its sequence but the name, as they once were written, is taken, and one
    of the same capture when it was shorter.
    """
    return _own(sequence, folder)[0]


def _own(sequence: Sequence, folder: Path | None) -> tuple[Path, str]:
    """The file, and the identity by which it knows the sequence."""
    identities = _identities(sequence)
    first = annotation_file(sequence.name, folder=folder)
    for number in count(1):
        file = first if number == 1 else first.with_stem(f"{first.stem}-{number}")
        try:
            known = read_identity(file) if file.exists() else None
        except AnnotationError:
            # Opening it says what is wrong; a file beside it would hide the corrections.
            known = None
        if known is None or known in identities:
            return file, known or identities[-1]
    raise AssertionError("unreachable: count() does not end")


def open_annotation(
    sequence: Sequence,
    assembly: Assembly,
    *,
    folder: Path | None = None,
    author: str = "anonymous",
) -> AnnotationStore:
    """Open the sequence's own file, making it if there is none.

    Raises:
        AnnotationError: the file is damaged, newer, or of another assembly.
    """
    file, identity = _own(sequence, folder)
    return AnnotationStore(
        file,
        sequence_name=sequence.name,
        assembly_name=assembly.name,
        author=author,
        identity=identity,
    )
