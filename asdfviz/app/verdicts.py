"""What a person says of a part without moving it: not here, looked at and right.

A verdict holds for the frame shown, or for the marked range around it, as one step of undo.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from asdfviz.annotate.records import gone_of
from asdfviz.app import actions as act
from asdfviz.app.desk import Desk, Done
from asdfviz.app.items import Shown
from asdfviz.errors import AnnotationError


def give(action: act.RemovePart | act.VerifyPart, desk: Desk) -> Done:
    """Keep a verdict.

    Raises:
        AnnotationError: it would change nothing; the message says why.
    """
    match action:
        case act.RemovePart():
            return _remove(desk)
        case act.VerifyPart():
            return _verify(desk)


def _remove(desk: Desk) -> Done:
    """Say that the selected part is not in the frames, with what is joined if all go as one."""
    store = desk.workspace.store
    known = gone_of(desk.workspace.said())
    gone = [(frame, name) for frame, name, _ in _meant(desk) if (frame, name) not in known]
    if not gone:
        raise AnnotationError(f"{desk.part} is said not to be in {desk.where} already")
    with store.transaction():
        desk.begin()
        for frame, name in gone:
            store.remove_pose(frame, name, group=desk.group)
    return _done(desk, gone, "is not in")


def _verify(desk: Desk) -> Done:
    """Say that the selected part's poses are right, with those of what is joined if all go as one.

    Where all of them are said to be right already, that is taken back.
    """
    store, said = desk.workspace.store, desk.workspace.said()
    seen = [(frame, name, shown) for frame, name, shown in _meant(desk) if shown is not None]
    if not any(name == desk.part for _, name, _ in seen):
        raise AnnotationError(
            f"{desk.part} has no pose in {desk.where} that could be right: place it first"
        )
    fresh = [pose for pose in seen if said.get(pose[:2], ("", ""))[0] != "verify"]
    if not fresh:
        return _unverify(desk, seen)
    with store.transaction():
        desk.begin()
        for frame, name, shown in fresh:
            seed = desk.workspace.seed_of(shown.source)
            _, provenance = said.get((frame, name), ("", seed.provenance))
            store.verify(frame, name, shown.T_camera_part, provenance=provenance, group=desk.group)
    return _done(desk, [pose[:2] for pose in fresh], "verified in")


def _unverify(desk: Desk, seen: Collection[tuple[int, str, Shown]]) -> Done:
    """Let the poses count as they did before somebody looked at them; they stay where they are."""
    with desk.workspace.store.transaction():
        for frame, name, shown in seen:
            said = desk.workspace.store.pose(frame, name)
            base = desk.workspace.base_poses(desk.workspace.place_of[frame], desk.base).get(name)
            # Nobody had said anything where the run, or the truth, was verified as it is.
            is_bare = (
                said is not None
                and base is not None
                and said.provenance == desk.workspace.seed_of(base.source).provenance
                and np.array_equal(shown.T_camera_part, base.T_camera_part)
            )
            desk.workspace.store.unverify(frame, name, None if is_bare else said, group=desk.group)
    return _done(desk, [pose[:2] for pose in seen], "no longer verified in")


def _meant(desk: Desk) -> Iterator[tuple[int, str, Shown | None]]:
    """Frame number, part and its pose, if it has one, of all that a verdict is for."""
    first, last = desk.view.frames
    for place in range(first, last + 1):
        shown = desk.workspace.poses(place, desk.view.base)
        names = [desk.part]
        attached = desk.workspace.attached(place, desk.view.base)
        if desk.view.together and desk.part in attached:
            names += [name for name in attached if name in shown and name != desk.part]
        for name in names:
            yield desk.workspace.indices[place], name, shown.get(name)


def _done(desk: Desk, changed: Collection[tuple[int, str]], verdict: str) -> Done:
    others = len({name for _, name in changed} - {desk.part})
    along = f" and {others} joined with it" if others else ""
    return Done(f"{desk.part}{along} {verdict} {desk.where}", desk.view.place)
