"""The SQLite file behind an annotation: made, recognised, opened and written here, for the store.

An existing file is looked over read-only before anything may write to it, so a file that is damaged,
newer or belongs to something else stays as it is.
"""

from __future__ import annotations

import json
import os
import secrets
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias

from asdfviz.annotate.records import EditKind
from asdfviz.errors import AnnotationError

APPLICATION_ID = 0x41534446
"""Marks the file as ours in its header: "ASDF"."""
SCHEMA_VERSION = 1
BUSY_SECONDS = 10.0
"""How long a write waits for another process's write."""

Row: TypeAlias = tuple[EditKind, int | None, int | None, str | None, Mapping[str, Any]]
"""Kind, first frame, last frame, part and payload of an edit to come."""

COLUMNS = "id, time, author, kind, step, frame, last_frame, part, payload, undone"
POSE_KINDS = "kind IN ('pose', 'remove_pose', 'verify', 'drop_pose') AND undone = 0"
ABOUT = "SELECT key, value FROM about"
SAID = f"""SELECT frame, part, kind, json_extract(payload, '$.provenance') FROM edits WHERE id IN
(SELECT max(id) FROM edits WHERE {POSE_KINDS} GROUP BY frame, part)
AND kind <> 'drop_pose' ORDER BY frame, part"""
# From the newest on, since nearly every one is of a step that says something of poses or states.
LAST_CORRECTION = """SELECT coalesce((SELECT id FROM edits AS e WHERE EXISTS (SELECT 1 FROM edits
WHERE author = e.author AND step = e.step AND kind NOT IN ('seed', 'undo', 'redo'))
ORDER BY id DESC LIMIT 1), 0)"""
STATE_KIND = "kind = 'state' AND undone = 0"

_SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA_VERSION};
CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE edits (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    time TEXT NOT NULL,
    author TEXT NOT NULL,
    kind TEXT NOT NULL,
    step INTEGER NOT NULL,
    frame INTEGER,
    last_frame INTEGER,
    part TEXT,
    payload TEXT NOT NULL,
    drag TEXT,
    undone INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX edits_by_place ON edits (frame, part);
CREATE INDEX edits_by_kind ON edits (kind);
CREATE INDEX edits_by_step ON edits (author, step);
"""


@dataclass(frozen=True, slots=True)
class About:
    """What a file is an annotation of."""

    sequence: str
    assembly: str
    identity: str | None = None
    """What tells the sequence from another of its name; None leaves it to the name."""


def open_edit_file(path: Path, about: About) -> sqlite3.Connection:
    """Open the file, making it if it is not there, ready for use by several threads under a lock.

    Raises:
        AnnotationError: the file is damaged, no annotation, newer, or of another sequence, or holds
            edits of another assembly; it is left untouched.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.stat().st_size == 0:
            _create(path, about)
        _look_over(path, about)
        connection = sqlite3.connect(
            path, timeout=BUSY_SECONDS, isolation_level=None, check_same_thread=False
        )
        connection.execute("PRAGMA synchronous = FULL")
        if about.identity is not None:
            # One from before identities were written becomes that of the first sequence to open it.
            row = ("identity", about.identity)
            connection.execute("INSERT OR IGNORE INTO about VALUES (?, ?)", row)
    except (sqlite3.Error, OSError) as error:
        raise AnnotationError(f"annotation {path} cannot be opened: {error}") from error
    return connection


def read_about(path: Path) -> dict[str, str]:
    """What a whole and known file says of itself and its sequence; it is read without being changed.

    Raises:
        AnnotationError: it is no annotation file, damaged or newer, or cannot be read.
    """
    with path.open("rb") as file:
        if file.read(16) != b"SQLite format 3\0":
            raise AnnotationError(f"{path} is not an annotation file; move it away to begin anew")
    # The path is escaped: '?' and '#' would end it in a URI.
    uri = f"{path.resolve().as_uri()}?mode=ro"
    try:
        with closing(sqlite3.connect(uri, uri=True, timeout=BUSY_SECONDS)) as connection:
            _check_format(connection, path)
            damage = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if damage != "ok":
                raise sqlite3.DatabaseError(damage)
            return dict(connection.execute(ABOUT))
    except sqlite3.OperationalError as error:
        raise AnnotationError(f"annotation {path} cannot be read: {error}") from error
    except sqlite3.DatabaseError as error:
        raise AnnotationError(
            f"annotation {path} is damaged ({error}) and was left as it is; "
            "move it away or bring back a copy"
        ) from error


def file_id(path: Path) -> tuple[int, int] | None:
    """What tells the file from another one in its place; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def open_step(connection: sqlite3.Connection, author: str, group: str | None) -> int | None:
    """The step that a drag goes on with: the author's last one, if it is of the same group."""
    if group is None:
        return None
    # The plus keeps SQLite from the index by author, through which it would sort all that they did.
    found = connection.execute(
        "SELECT kind, drag, step FROM edits WHERE +author = ? ORDER BY id DESC LIMIT 1", (author,)
    ).fetchone()
    if found is None or found[0] in ("undo", "redo") or found[1] != group:
        return None
    return int(found[2])


def insert_edit(
    connection: sqlite3.Connection,
    row: Row,
    *,
    author: str,
    step: int | None,
    group: str | None = None,
) -> int:
    """Write an edit as part of a step, or as a step of its own; returns its id."""
    kind, frame, last_frame, part, payload = row
    now = datetime.now(UTC).isoformat(timespec="microseconds")
    text = json.dumps(payload, allow_nan=False)
    cursor = connection.execute(
        "INSERT INTO edits (time, author, kind, step, frame, last_frame, part, payload, drag) "
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (now, author, kind, step or 0, frame, last_frame, part, text, group),
    )
    number = int(cursor.lastrowid or 0)
    if step is None:
        connection.execute("UPDATE edits SET step = id WHERE id = ?", (number,))
    return number


def _create(path: Path, about: About) -> None:
    """Make the whole file under another name first: a killed process leaves none or a good one."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}")
    try:
        with closing(sqlite3.connect(temporary, isolation_level=None)) as connection:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(_SCHEMA)
            rows = [("sequence", about.sequence), ("assembly", about.assembly)]
            rows += [] if about.identity is None else [("identity", about.identity)]
            connection.executemany("INSERT INTO about VALUES (?, ?)", rows)
        if path.exists() and path.stat().st_size == 0:
            path.unlink()
        try:
            # Unlike a rename, a link never replaces what another process made meanwhile.
            os.link(temporary, path)
        except FileExistsError:
            return
        except OSError:
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _look_over(path: Path, about: About) -> None:
    found = read_about(path)
    if found.get("sequence") != about.sequence:
        raise _of_another(path, "sequence", found.get("sequence"), about.sequence)
    if about.identity not in (None, found.get("identity", about.identity)):
        raise AnnotationError(
            f"annotation {path} is of another sequence called '{about.sequence}': its pictures "
            "differ; use another file for this one"
        )
    if found.get("assembly") != about.assembly and not _is_taken_over(path, about.assembly):
        raise _of_another(path, "assembly", found.get("assembly"), about.assembly)


def _of_another(path: Path, what: str, found: str | None, expected: str) -> AnnotationError:
    return AnnotationError(
        f"annotation {path} is of {what} '{found}', not '{expected}'; "
        "use another annotations folder for this one"
    )


def _is_taken_over(path: Path, assembly: str) -> bool:
    """Give a file that nobody has edited yet to another assembly; False where there are edits."""
    with closing(sqlite3.connect(path, timeout=BUSY_SECONDS, isolation_level=None)) as connection:
        free = "key = 'assembly' AND NOT EXISTS (SELECT 1 FROM edits)"
        done = connection.execute(f"UPDATE about SET value = ? WHERE {free}", (assembly,))
        return done.rowcount == 1


def _check_format(connection: sqlite3.Connection, path: Path) -> None:
    if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
        raise AnnotationError(f"{path} is a database of something else, not an annotation file")
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    if version > SCHEMA_VERSION:
        raise AnnotationError(
            f"annotation {path} has version {version}, this program reads up to {SCHEMA_VERSION}; "
            "update asdfviz"
        )
