"""An edit reads no more of the annotation file where there is more in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hand_edits import JAW, RANGE, Do
from tiny_sequence import COUNT, FIRST, pose_of

from asdfviz.annotate.records import StateLabel
from asdfviz.annotate.store import AnnotationStore
from asdfviz.app import actions as act
from asdfviz.app.editing import Edits
from asdfviz.app.snapshot import take
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace

MORE = 400
"""Frames beyond those of the sequence, in which every part is said to be somewhere."""


def turns_of_loops(store: AnnotationStore, work: Callable[[], object]) -> int:
    """How much SQLite does in some work: turns of its loops over rows."""
    turns: list[None] = []
    with store.transaction() as connection:
        connection.set_progress_handler(lambda: turns.append(None), 1)
    work()
    connection.set_progress_handler(None, 1)
    return len(turns)


def lengthen(workspace: Workspace) -> None:
    store, frames = workspace.store, range(FIRST + COUNT, FIRST + COUNT + MORE)
    poses = {name: pose_of(0) for name in workspace.assembly.parts}
    store.set_frames(dict.fromkeys(frames, poses), provenance="tracked", group="track")
    with store.transaction():
        for frame in frames:
            store.set_state(frame, StateLabel(1))
            store.verify(frame, "jaw", pose_of(0), provenance="tracked", group="verify")


@pytest.mark.parametrize(
    ("action", "view"),
    [
        (act.Nudge(0, 1), JAW),
        (act.CopyPrevious(), replace(JAW, place=3)),
        (act.CopyPrevious(), replace(RANGE, base=None)),
        (act.PlaceJoined(), replace(JAW, place=6)),
        (act.PlacePart(), replace(JAW, place=6)),
        (act.RemovePart(), RANGE),
        (act.VerifyPart(), RANGE),
        (act.RevertPart(), replace(JAW, place=6)),
        (act.Undo(), JAW),
    ],
)
def test_an_edit_reads_no_more_of_a_long_annotation(
    with_run: Workspace, do: Do, action: Edits, view: View
) -> None:
    store = with_run.store

    def edit(now: float) -> int:
        store.set_pose(FIRST + 6, "jaw", pose_of(1), provenance="state")
        store.remove_pose(FIRST + 7, "base")
        store.drop_pose(FIRST + 3, "jaw")
        # What is joined is to be placed anew.
        store.set_pose(FIRST + 6, "base", pose_of(0, shift=now))
        take(with_run, view, frame=None)

        def edit_and_show() -> None:
            do(action, view, now=now)
            take(with_run, view, frame=None)

        return turns_of_loops(store, edit_and_show)

    few = edit(1.0)
    lengthen(with_run)
    assert edit(2.0) < few + MORE  # not even one look at each of the other frames
