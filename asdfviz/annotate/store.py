"""The annotation of one sequence: every edit a row, so undo, provenance and a crash are one design.

The app and the exporters read poses and states from here; nothing in here knows a browser. Several
stores (tabs, people, processes) may be open on one file: each sees the others' edits, and `version`
tells when there are new ones.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import Any

from asdfviz.annotate import edit_file
from asdfviz.annotate.edit_file import About, Row, file_id, insert_edit, open_edit_file, open_step
from asdfviz.annotate.records import (
    Edit,
    EditKind,
    PoseAnnotation,
    Seed,
    StateLabel,
    annotation_from,
    edit_from_row,
    label_from,
    label_payload,
    pose_payload,
)
from asdfviz.annotate.steps import switch_step
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Transform


class AnnotationStore:
    """Poses and states that people set, with their whole history; safe to share between threads."""

    def __init__(
        self,
        path: Path,
        *,
        sequence_name: str,
        assembly_name: str,
        author: str = "anonymous",
        identity: str | None = None,
    ) -> None:
        """Open or make the file.

        Args:
            path: the SQLite file, see `asdfviz.annotate.identity`.
            sequence_name: what it annotates; a file of another sequence is refused.
            assembly_name: likewise.
            author: who makes the edits of this store, and whose edits its undo takes back.
            identity: tells the sequence from others of its name, whatever its folder is called now.

        Raises:
            AnnotationError: the file is damaged, newer, or belongs to something else.
        """
        self.path = path
        self.author = author
        self._lock = RLock()
        self._connection = open_edit_file(path, About(sequence_name, assembly_name, identity))
        self._file_id = file_id(path)

    def __enter__(self) -> AnnotationStore:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file; every edit is in it already."""
        with self._lock:
            self._connection.close()

    def set_pose(
        self,
        frame: int,
        part: str,
        T_camera_part: Transform,
        *,
        provenance: str = "manual",
        group: str | None = None,
    ) -> int:
        """Say where a part is in a frame; returns the edit's id.

        Args:
            frame: frame number.
            part: its name.
            T_camera_part: kept to the last bit.
            provenance: how the pose came about: "gizmo", "keys", "copied", "method:asdf" ...
            group: the edits of one drag share a name and are undone as one; see `steps.group_of`.
        """
        return self.set_poses(frame, {part: T_camera_part}, provenance=provenance, group=group)

    def set_poses(
        self,
        frame: int,
        Ts_camera_part: Mapping[str, Transform],
        *,
        provenance: str = "manual",
        group: str | None = None,
    ) -> int:
        """Move several parts of a frame as one step; returns the last edit's id."""
        return self.set_frames({frame: Ts_camera_part}, provenance=provenance, group=group)

    def set_frames(
        self,
        Ts_by_frame: Mapping[int, Mapping[str, Transform]],
        *,
        provenance: str,
        group: str | None = None,
    ) -> int:
        """Move parts of several frames as one step, all of it or nothing; returns the last id."""
        rows: list[Row] = [
            ("pose", frame, frame, part, pose_payload(T_camera_part, provenance))
            for frame, Ts_camera_part in Ts_by_frame.items()
            for part, T_camera_part in Ts_camera_part.items()
        ]
        return self._add(rows, group)

    def remove_pose(
        self, frame: int, part: str, *, provenance: str = "manual", group: str | None = None
    ) -> int:
        """Say that a part is not in a frame; returns the edit's id."""
        return self._add([("remove_pose", frame, frame, part, {"provenance": provenance})], group)

    def drop_pose(self, frame: int, part: str, *, group: str | None = None) -> int:
        """Take back what was said of a part in a frame; what corrections started from counts again."""
        return self._add([("drop_pose", frame, frame, part, {})], group)

    def verify(
        self,
        frame: int,
        part: str,
        T_camera_part: Transform,
        *,
        provenance: str,
        group: str | None = None,
    ) -> int:
        """Say that a pose was looked at and is right; it is kept, whatever it came from."""
        payload = pose_payload(T_camera_part, provenance)
        return self._add([("verify", frame, frame, part, payload)], group)

    def unverify(
        self, frame: int, part: str, said: PoseAnnotation | None, *, group: str | None = None
    ) -> int:
        """Take back that a pose is right: what was `said` counts again, or what corrections started from."""
        note = {"unverified": True}
        if said is None or said.T_camera_part is None:
            return self._add([("drop_pose", frame, frame, part, note)], group)
        payload = {**pose_payload(said.T_camera_part, said.provenance), **note}
        return self._add([("pose", frame, frame, part, payload)], group)

    def set_state(
        self,
        frame: int,
        label: StateLabel | None,
        *,
        last_frame: int | None = None,
        group: str | None = None,
    ) -> int:
        """Set the state of a frame, or of all frames up to `last_frame`, as one edit.

        A label of None takes a label away, so that what the corrections started from counts again.
        """
        last = frame if last_frame is None else last_frame
        if last < frame:
            raise AnnotationError(f"a range of frames ends at {last}, before its start {frame}")
        return self._add([("state", frame, last, None, label_payload(label))], group)

    def set_seed(self, seed: Seed, *, group: str | None = None) -> int:
        """Say what the corrections start from; it holds for every frame that nobody corrected."""
        payload = {"kind": seed.kind, "run": seed.run, "method": seed.method}
        return self._add([("seed", None, None, None, payload)], group)

    def pose(self, frame: int, part: str) -> PoseAnnotation | None:
        """What was last said of a part in a frame; None where nobody said anything."""
        return self.poses(frame).get((frame, part))

    def poses(self, frame: int | None = None) -> dict[tuple[int, str], PoseAnnotation]:
        """What was last said of every part, by frame and part; of one frame or of all."""
        where = edit_file.POSE_KINDS if frame is None else f"{edit_file.POSE_KINDS} AND frame = ?"
        latest = f"id IN (SELECT max(id) FROM edits WHERE {where} GROUP BY frame, part) ORDER BY id"
        return {
            (edit.frame, edit.part): annotation_from(edit)
            for edit in self._edits(latest, () if frame is None else (frame,))
            if edit.frame is not None and edit.part is not None and edit.kind != "drop_pose"
        }

    def said(self) -> dict[tuple[int, str], tuple[EditKind, str]]:
        """By frame and part, the kind of what was last said and its provenance, without the poses."""
        rows = self.read(edit_file.SAID)
        return {(frame, part): (kind, provenance) for frame, part, kind, provenance in rows}

    def state(self, frame: int) -> StateLabel | None:
        """The state that was last set for a frame; None where nobody set one."""
        where = (
            f"{edit_file.STATE_KIND} AND frame <= ? AND last_frame >= ? ORDER BY id DESC LIMIT 1"
        )
        found = self._edits(where, (frame, frame))
        return label_from(found[0].payload) if found else None

    def state_ranges(self) -> tuple[tuple[int, int, StateLabel | None], ...]:
        """Every state edit that counts, oldest first: first frame, last frame, label."""
        return tuple(
            (edit.frame, edit.last_frame, label_from(edit.payload))
            for edit in self._edits(f"{edit_file.STATE_KIND} ORDER BY id", ())
            if edit.frame is not None and edit.last_frame is not None
        )

    def seed(self) -> Seed:
        """What the corrections start from: what the last step that says it says."""
        # By steps, since one that undo handed over to a step is older than what was chosen after it.
        found = self._edits("kind = 'seed' AND undone = 0 ORDER BY step DESC, id DESC LIMIT 1", ())
        return Seed(**found[0].payload) if found else Seed()

    def note(self, key: str, value: str) -> None:
        """Keep something that the file says of its sequence; see `edit_file.read_about`."""
        with self.transaction() as connection:
            connection.execute("INSERT OR REPLACE INTO about VALUES (?, ?)", (key, value))

    def version(self) -> int:
        """A number that rises with every change by anybody, undo and redo included."""
        return self.read("SELECT coalesce(max(id), 0) FROM edits")[0][0]

    def corrections(self) -> int:
        """A number that rises with every change of poses or states; a seed alone changes neither."""
        return self.read(edit_file.LAST_CORRECTION)[0][0]

    def history(self, *, after: int = 0) -> tuple[Edit, ...]:
        """Every row since version `after`, oldest first, what was undone and the undoing included."""
        return self._edits("id > ? ORDER BY id", (after,))

    def undo(self, *, others: Collection[str] = (), group: str | None = None) -> tuple[Edit, ...]:
        """Take back this author's last step; returns its edits, none if there is nothing left.

        Args:
            others: the author's other tabs, whose steps are left alone.
            group: names the tab that asks, as `steps.group_of` does.

        Raises:
            AnnotationError: one of the other tabs, or somebody else, changed the same since.
        """
        with self.transaction() as connection:
            return switch_step(connection, "undo", author=self.author, others=others, group=group)

    def redo(self, *, others: Collection[str] = (), group: str | None = None) -> tuple[Edit, ...]:
        """Bring back the step that this author undid last, unless they have edited since; see `undo`."""
        with self.transaction() as connection:
            return switch_step(connection, "redo", author=self.author, others=others, group=group)

    def _add(self, rows: Sequence[Row], group: str | None) -> int:
        if not rows:
            raise AnnotationError("an edit without any part changes nothing")
        last = 0
        with self.transaction() as connection:
            step = open_step(connection, self.author, group)
            for row in rows:
                last = insert_edit(connection, row, author=self.author, step=step, group=group)
                step = last if step is None else step
        return last

    def _edits(self, where: str, values: tuple[Any, ...]) -> tuple[Edit, ...]:
        rows = self.read(f"SELECT {edit_file.COLUMNS} FROM edits WHERE {where}", values)
        return tuple(edit_from_row(row) for row in rows)

    def read(self, query: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Ask the file's tables, see `edit_file`."""
        with self._lock:
            try:
                return self._connection.execute(query, values).fetchall()
            except sqlite3.Error as error:
                raise AnnotationError(f"annotation {self.path} cannot be read: {error}") from error

    @contextmanager
    def transaction(self) -> Generator[sqlite3.Connection]:
        """All edits of the block or none, on disk when the outermost block ends."""
        with self._lock:
            # What has no name any more could still be written to, but nobody would find it again.
            if file_id(self.path) != self._file_id:
                raise AnnotationError(
                    f"annotation {self.path} has gone or was replaced while it was open; the edit "
                    "was not kept: move the file back, or close the app and open it again"
                )
            try:
                if self._connection.in_transaction:
                    yield self._connection
                    return
                self._connection.execute("BEGIN IMMEDIATE")
                with self._connection:
                    yield self._connection
            except sqlite3.Error as error:
                raise AnnotationError(
                    f"annotation {self.path} cannot be written: {error}; the edit was not kept"
                ) from error
