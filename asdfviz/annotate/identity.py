"""Which annotation file is a sequence's own: two captures in folders of one name never share one.

A sequence is known by its first pictures, so it stays itself when its folder is moved, when its camera
file is mended, and when frames are added at its end. Where some of them were damaged since, or are
whole again, those that are whole then and now tell it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, cast

from asdfviz.annotate.edit_file import read_about
from asdfviz.annotate.paths import annotation_file
from asdfviz.annotate.store import AnnotationStore
from asdfviz.data.images import read_stored
from asdfviz.data.scene_files import COLOUR_FOLDERS, pictures_in
from asdfviz.datatypes import Assembly, Sequence
from asdfviz.errors import AnnotationError, SequenceError

PICTURES = 8
"""So many pictures are looked at; noise makes one enough for a camera, but not for a renderer."""
_NOTE = "pictures"
"""What a file keeps, besides the identity: the SHA-256 of each of the first pictures by its name, of
those that were whole."""


@dataclass(frozen=True, slots=True)
class _Looks:
    """What a sequence is known by."""

    identities: tuple[str, ...]
    """The identity, last, and before it those that a capture had when it ended after fewer pictures."""
    pictures: Mapping[Path, str]
    """SHA-256 of each of the first pictures."""


@dataclass(frozen=True, slots=True)
class _Own:
    """The file of a sequence, and what it says of it."""

    file: Path
    identity: str
    """By which the file knows the sequence."""
    pictures: Mapping[str, str]
    """SHA-256 of the pictures that were whole when it was last opened, by name."""


def sequence_identity(sequence: Sequence) -> str:
    """SHA-256 over names and contents of the first colour images; of the frame numbers without any."""
    return _look_at(sequence).identities[-1]


def own_annotation_file(sequence: Sequence, *, folder: Path | None = None) -> Path:
    """The file of a sequence: <name>.db, or <name>-2.db where that is of another one of the name.

    A file that says nothing of its sequence but the name, as they once were written, is taken, one of
    the same capture when it was shorter, and one of the same capture when other pictures were damaged.
    """
    return _own(sequence, _look_at(sequence), folder).file


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
    looks = _look_at(sequence)
    own = _own(sequence, looks, folder)
    store = AnnotationStore(
        own.file,
        sequence_name=sequence.name,
        assembly_name=assembly.name,
        author=author,
        identity=own.identity,
    )
    whole = {
        path.name: digest
        for path, digest in looks.pictures.items()
        if own.pictures.get(path.name) == digest or _is_whole(path)
    }
    known = {**own.pictures, **whole}
    if known != own.pictures:
        store.note(_NOTE, json.dumps(known))
    return store


def _look_at(sequence: Sequence) -> _Looks:
    digest = hashlib.sha256()
    identities: list[str] = []
    pictures: dict[Path, str] = {}
    for image in _first_images(Path(sequence.path)):
        content = _content(image)
        digest.update(f"{image.name}\0".encode())
        digest.update(content)
        identities.append(digest.hexdigest())
        pictures[image] = hashlib.sha256(content).hexdigest()
    if not identities:
        digest.update(repr(sequence.frame_indices).encode())
        identities.append(digest.hexdigest())
    return _Looks(tuple(identities), pictures)


def _first_images(scene: Path) -> list[Path]:
    for name in COLOUR_FOLDERS:
        images = pictures_in(scene / name)
        if images:
            return images[:PICTURES]
    return []


def _content(image: Path) -> bytes:
    """What is in a picture's file; nothing where it cannot be read."""
    try:
        return image.read_bytes()
    except OSError:
        return b""


def _is_whole(image: Path) -> bool:
    try:
        read_stored(image)
    except SequenceError:
        return False
    return True


def _own(sequence: Sequence, looks: _Looks, folder: Path | None) -> _Own:
    first = annotation_file(sequence.name, folder=folder)
    likely: _Own | None = None
    for number in count(1):
        file = first if number == 1 else first.with_stem(f"{first.stem}-{number}")
        if not file.exists():
            return likely or _Own(file, looks.identities[-1], {})
        try:
            about = read_about(file)
        except AnnotationError:
            # Opening it says what is wrong; a file beside it would hide the corrections.
            about = {}
        identity = about.get("identity")
        own = _Own(file, identity or looks.identities[-1], _noted(about))
        if identity in looks.identities:
            return own
        if likely is None and (identity is None or _agree(looks.pictures, own.pictures)):
            likely = own
    raise AssertionError("unreachable: count() does not end")


def _noted(about: Mapping[str, str]) -> dict[str, str]:
    try:
        found: Any = json.loads(about.get(_NOTE, "{}"))
    except ValueError:
        return {}
    if not isinstance(found, dict):
        return {}
    return {str(name): str(digest) for name, digest in cast(dict[object, object], found).items()}


def _agree(now: Mapping[Path, str], then: Mapping[str, str]) -> bool:
    """Whether some picture is as it was, and each that is not is damaged or was."""
    changed = [path for path, digest in now.items() if then.get(path.name, digest) != digest]
    same = any(then.get(path.name) == digest for path, digest in now.items())
    return same and not any(_is_whole(path) for path in changed)
