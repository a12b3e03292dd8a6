"""Which methods a person stopped on a sequence: none of these begins by itself when it is opened again.

The annotation file keeps them, as it is the sequence's own; undo leaves them alone.
"""

from __future__ import annotations

import json

from asdfviz.annotate import edit_file
from asdfviz.annotate.store import AnnotationStore

_NOTE = "stopped"


def is_stopped(store: AnnotationStore, method: str) -> bool:
    """Whether a person stopped the method and nobody began it since."""
    return method in _stopped(store)


def note_stopped(store: AnnotationStore, method: str, *, stopped: bool) -> None:
    """Keep that a method was stopped, or that it was begun.

    Raises:
        AnnotationError: the file cannot be written.
    """
    known = _stopped(store)
    if (method in known) != stopped:
        store.note(_NOTE, json.dumps(sorted(known ^ {method})))


def _stopped(store: AnnotationStore) -> set[str]:
    return set(json.loads(dict(store.read(edit_file.ABOUT)).get(_NOTE, "[]")))
