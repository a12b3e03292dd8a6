"""What people said, kept up to date by what changed: an edit costs the same in a long annotation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from asdfviz.annotate.edit_file import POSE_KINDS
from asdfviz.annotate.records import Said, StateLabel
from asdfviz.annotate.store import AnnotationStore

# By step, as undo and redo bear that of what they switch; a step is one author's.
_CHANGED = "(author, step) IN (SELECT author, step FROM edits WHERE id > ?)"
_SAID_SINCE = f"""SELECT its_frame, its_part, kind, json_extract(payload, '$.provenance') FROM
(SELECT DISTINCT frame AS its_frame, part AS its_part FROM edits WHERE part IS NOT NULL
AND {_CHANGED}) LEFT JOIN edits ON id =
(SELECT max(id) FROM edits WHERE frame = its_frame AND part = its_part AND {POSE_KINDS})"""
# The plus keeps SQLite from the index by kind, through which it would look at all labels.
_HAS_LABELLED = f"SELECT EXISTS (SELECT 1 FROM edits WHERE +kind = 'state' AND {_CHANGED})"


@dataclass(frozen=True, slots=True, eq=False)
class Spoken:
    """What an annotation said at a version; nothing in it is changed later."""

    version: int
    said: Said
    verdicts: Mapping[int, Mapping[str, bool]]
    """By frame number and part: whether its pose is right; False where it is not in the frame."""
    ranges: tuple[tuple[int, int, StateLabel | None], ...]
    """State labels, as `AnnotationStore.state_ranges` has them."""


NOTHING = Spoken(0, {}, {}, ())
"""What an annotation says that nobody has begun."""


def up_to_date(known: Spoken, store: AnnotationStore) -> Spoken:
    """Return what the store says now, by what it said before; the same object where nothing changed."""
    version = store.version()
    if version == known.version:
        return known
    said, verdicts = dict(known.said), dict(known.verdicts)
    for frame, part, kind, provenance in store.read(_SAID_SINCE, (known.version,)):
        said.pop((frame, part), None)
        here = {name: right for name, right in verdicts.pop(frame, {}).items() if name != part}
        if kind not in (None, "drop_pose"):
            said[frame, part] = (kind, provenance)
        if kind in ("verify", "remove_pose"):
            here[part] = kind == "verify"
        if here:
            verdicts[frame] = here
    has_labelled = bool(store.read(_HAS_LABELLED, (known.version,))[0][0])
    ranges = store.state_ranges() if has_labelled else known.ranges
    return Spoken(version, said, verdicts, ranges)
