"""Steps of undo: which one is taken back or done again next, and what stands in its way.

Several people may work on one file, and one person in several browser tabs. Each takes back what was
done in the own tab, and never what another one, still open, or somebody else did: that may lie in
frames that nobody sees here.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Collection, Sequence
from typing import Literal

from asdfviz.annotate.edit_file import COLUMNS, insert_edit
from asdfviz.annotate.records import Edit, edit_from_row
from asdfviz.errors import AnnotationError

_OF_OTHERS = "drag IS NOT NULL AND substr(drag, 1, instr(drag, '/') - 1) IN (SELECT value FROM json_each(?2))"
_OWN = f"author = ?1 AND NOT ({_OF_OTHERS})"
_LAST_STEP = f"""SELECT max(step) FROM edits
WHERE {_OWN} AND undone = 0 AND kind NOT IN ('undo', 'redo')"""
# A step bears the number of its first edit; a seed that was handed over to it ends nothing.
_LAST_UNDONE_STEP = f"""SELECT step FROM edits AS u WHERE {_OWN} AND kind = 'undo' AND id >
(SELECT coalesce(max(step), 0) FROM edits WHERE {_OWN} AND kind NOT IN ('undo', 'redo'))
AND (SELECT undone FROM edits WHERE id = u.step) = 1 ORDER BY id DESC LIMIT 1"""
# Named with their author, by whom steps are found without going through all edits.
_OF_STEP = "author = ? AND step = ? AND kind NOT IN ('undo', 'redo')"
_ALL_OF = f"SELECT {COLUMNS} FROM edits WHERE {_OF_STEP} ORDER BY id"
_LATER = f"""SELECT {COLUMNS} FROM edits WHERE NOT ({_OWN}) AND id > ?3
AND undone = 0 AND kind NOT IN ('undo', 'redo') ORDER BY id"""


def group_of(tab: str, deed: str) -> str:
    """Name what a tab does as one step."""
    return f"{tab}/{deed}"


def switch_step(
    connection: sqlite3.Connection,
    kind: Literal["undo", "redo"],
    *,
    author: str,
    others: Collection[str],
    group: str | None,
) -> tuple[Edit, ...]:
    """Take back the author's last step, or bring the one back that was undone last.

    Args:
        connection: of the file, in a transaction.
        kind: which of the two.
        author: whose step.
        others: tabs of the author whose steps are left alone.
        group: names the tab that asks, see `group_of`.

    Returns:
        The step's edits, none if there is nothing left.

    Raises:
        AnnotationError: one of the other tabs, or somebody else, changed the same since.
    """
    query = _LAST_STEP if kind == "undo" else _LAST_UNDONE_STEP
    names = json.dumps(list(others))
    found = connection.execute(query, (author, names)).fetchone()
    step = None if found is None else found[0]
    if step is None:
        return ()
    edits = _read(connection, _ALL_OF, (author, step))
    # The first edit's number: one that was added to the step later says nothing of its time.
    later = _read(connection, _LATER, (author, names, edits[0].id))
    _check_untouched(edits, later, author)
    if kind == "undo" and later:
        _hand_over_seed(connection, edits, later[0])
    insert_edit(connection, (kind, None, None, None, {}), author=author, step=step, group=group)
    connection.execute(
        f"UPDATE edits SET undone = ? WHERE {_OF_STEP}", (int(kind == "undo"), author, step)
    )
    return _read(connection, _ALL_OF, (author, step))


def _read(
    connection: sqlite3.Connection, query: str, values: tuple[object, ...]
) -> tuple[Edit, ...]:
    return tuple(edit_from_row(row) for row in connection.execute(query, values))


def _check_untouched(step: Sequence[Edit], later: Sequence[Edit], author: str) -> None:
    """Refuse what would change nothing that is seen, since something later was said of the same."""
    spoken = [edit for edit in step if edit.kind != "seed"] or step
    poses = {(edit.frame, edit.part) for edit in spoken if edit.part is not None}
    for other in later:
        if (other.frame, other.part) in poses:
            what = f"{other.part} in frame {other.frame}"
        elif other.part is None and any(_overlap(edit, other) for edit in spoken):
            what = "what corrections start from"
            what = what if other.frame is None else f"the state of frame {other.frame}"
        else:
            continue
        if other.author == author:
            who, way = "another tab", "undo that there first, or close that tab"
        else:
            who, way = other.author, "it is theirs to undo first, or yours to change by hand"
        raise AnnotationError(f"{who} has changed {what} since: {way}")


def _overlap(edit: Edit, other: Edit) -> bool:
    """Whether two labels are for the same frames, or both say what corrections start from."""
    if edit.kind != other.kind or edit.frame is None or other.frame is None:
        return edit.kind == other.kind
    first, last = max(edit.frame, other.frame), min(edit.last_frame or 0, other.last_frame or 0)
    return first <= last


def _hand_over_seed(connection: sqlite3.Connection, step: Sequence[Edit], later: Edit) -> None:
    """Make what corrections start from, where a step began them, part of one that rests on it, too.

    One that says itself what they start from rests on nothing else.
    """
    seeds = [edit for edit in step if edit.kind == "seed"]
    if not seeds or len(seeds) == len(step):
        return
    said = f"SELECT 1 FROM edits WHERE {_OF_STEP} AND kind = 'seed'"
    if connection.execute(said, (later.author, later.step)).fetchone() is not None:
        return
    (drag,) = connection.execute("SELECT drag FROM edits WHERE id = ?", (later.id,)).fetchone()
    row = ("seed", None, None, None, seeds[-1].payload)
    insert_edit(connection, row, author=later.author, step=later.step, group=drag)
