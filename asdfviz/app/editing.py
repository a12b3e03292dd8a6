"""Turns a person's edits into rows of the annotation file. No viser in here.

Each function returns the frame's place that changed and a short sentence for the status line, or
raises InputError with what to do instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asdfviz.annotate.edits import nudged, rotated
from asdfviz.annotate.records import gone_of
from asdfviz.annotate.steps import group_of
from asdfviz.app import actions as act
from asdfviz.app import labels, placing, verdicts
from asdfviz.app.desk import Burst, Desk, Done, NothingLeft
from asdfviz.app.history import frames_of, in_words, place_to_show
from asdfviz.app.typed_pose import typed_pose
from asdfviz.app.view import STEPS_DEG, STEPS_MM, View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError
from asdfviz.export.gaps import lacking

Edits = (
    act.Nudge
    | act.Turn
    | act.MovePart
    | act.TypePose
    | act.CopyPrevious
    | act.PlacePart
    | act.PlaceJoined
    | act.RevertPart
    | act.RemovePart
    | act.VerifyPart
    | act.SetState
    | act.NextState
    | act.NextError
    | act.RepeatState
    | act.ClearState
    | act.Undo
    | act.Redo
)


def apply_edit(
    action: Edits, view: View, workspace: Workspace, *, burst: Burst, now: float
) -> Done:
    """Keep an edit.

    Raises:
        NothingLeft: of what it would take back, or do again.
        AnnotationError: it cannot be done here; the message says why and what to do.
    """
    if isinstance(action, (act.Nudge, act.Turn)):
        burst = burst.joined(f"keys {view.selected} {view.place}", now)
        group = burst.name
    else:
        burst, group = Burst(), f"edit@{now:.6f}"
    desk = Desk(workspace, view, group_of(view.page, group))
    done = _dispatch(action, desk)
    return replace(done, burst=burst)


def use_base(view: View, workspace: Workspace, *, now: float) -> None:
    """Let corrections that were begun go on from what is drawn now."""
    store = workspace.store
    if store.seed().kind != "none":
        store.set_seed(workspace.seed_of(view.base), group=group_of(view.page, f"base@{now:.6f}"))
        workspace.changed()


def gap_beside(view: View, workspace: Workspace, direction: int) -> int:
    """The place of the next (1) or previous (-1) frame in which a pose is missing.

    Raises:
        NothingLeft: there is none that way.
    """
    place = workspace.lane(view.selected, view.base).gap(view.place, direction)
    if place is None:
        who = "every part has" if view.selected is None else f"{view.selected} has"
        which = "after" if direction > 0 else "before"
        raise NothingLeft(
            f"{who} a pose, or is said not to be there, in all frames {which} this one"
        )
    return place


def told_gap(view: View, workspace: Workspace) -> str:
    """Which parts have no pose in the frame shown."""
    frame, shown = workspace.indices[view.place], workspace.poses(view.place, view.base)
    parts = lacking(frame, shown, workspace.assembly.parts, gone=gone_of(workspace.said()))
    return f"frame {frame}: no pose of {', '.join(parts)}"


def _dispatch(action: Edits, desk: Desk) -> Done:
    match action:
        case act.Undo() | act.Redo():
            return _switch(action, desk)
        case (
            act.SetState()
            | act.NextState()
            | act.NextError()
            | act.RepeatState()
            | act.ClearState()
        ):
            return labels.give(action, desk)
        case act.MovePart():
            return _drag(action, desk)
        case act.TypePose():
            return _type(action, desk)
        case act.Nudge() | act.Turn():
            return _move(action, desk)
        case act.CopyPrevious() | act.PlacePart() | act.PlaceJoined():
            return placing.give(action, desk)
        case act.RevertPart():
            return _revert(desk)
        case act.RemovePart() | act.VerifyPart():
            return verdicts.give(action, desk)


def _drag(action: act.MovePart, desk: Desk) -> Done:
    """A drag belongs to the frame in which it was begun, whichever is shown when it ends."""
    begun = replace(desk, view=replace(desk.view, place=action.place))
    done = begun.move(action.part, action.T_camera_part, "gizmo")
    return replace(done, place=desk.view.place)


def _type(action: act.TypePose, desk: Desk) -> Done:
    """What was typed belongs to the frame and the part that the figures stood for."""
    if not 0 <= action.place < len(desk.workspace.indices):
        raise AnnotationError(f"{action.part} was not moved: there is no frame at {action.place}")
    begun = replace(desk, view=replace(desk.view, place=action.place, selected=action.part))
    T_typed = typed_pose(begun.pose(), action.options, part=action.part)
    return replace(begun.move(action.part, T_typed, "keys"), place=desk.view.place)


def _move(action: act.Nudge | act.Turn, desk: Desk) -> Done:
    T_camera_part = desk.pose()
    axis = action.sign * np.eye(3)[action.axis]
    if isinstance(action, act.Nudge):
        T_moved = nudged(T_camera_part, axis * STEPS_MM[desk.view.step] / 1000)
    else:
        angle = float(np.radians(STEPS_DEG[desk.view.step]))
        T_moved = rotated(T_camera_part, axis, angle, centre_part=desk.centre())
    return desk.move(desk.part, T_moved, "keys")


def _revert(desk: Desk) -> Done:
    """Let the base speak again, as before the corrections: in the frame shown or the marked range."""
    store, said = desk.workspace.store, desk.workspace.said()
    first, last = desk.view.frames
    frames = [f for f in desk.workspace.indices[first : last + 1] if (f, desk.part) in said]
    if not frames:
        raise AnnotationError(f"{desk.part} was not corrected in {desk.where}")
    with store.transaction():
        for frame in frames:
            store.drop_pose(frame, desk.part, group=desk.group)
    return Done(f"dropped the correction of {desk.part} in {desk.where}", desk.view.place)


def _switch(action: act.Undo | act.Redo, desk: Desk) -> Done:
    undo = isinstance(action, act.Undo)
    store, view = desk.workspace.store, desk.view
    others = desk.workspace.pages.others(view.page)
    switch = store.undo if undo else store.redo
    edits = switch(others=others, group=desk.group)
    if not edits:
        here = " in this tab" if others else ""
        raise NothingLeft(f"nothing left to {'undo' if undo else 'redo'}{here}")
    changed = frames_of(edits)
    places = [place for place, frame in enumerate(desk.workspace.indices) if frame in changed]
    said = f"{'undid' if undo else 'redid'}: {in_words(edits)}"
    return Done(said, place_to_show(places, view.place))
