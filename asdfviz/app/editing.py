"""Turns a person's edits into rows of the annotation file. No viser in here.

Each function returns the frame's place that changed and a short sentence for the status line, or
raises InputError with what to do instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asdfviz.annotate.edits import nudged, rotated
from asdfviz.app import actions as act
from asdfviz.app import labels, verdicts
from asdfviz.app.ar import look_direction
from asdfviz.app.desk import Burst, Desk, Done
from asdfviz.app.history import frames_of, in_words, place_to_show
from asdfviz.app.typed_pose import typed_pose
from asdfviz.app.view import STEPS_MM, View, centre_of
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Depth, Rotation
from asdfviz.geometry.transforms import transform_from

FALLBACK_DEPTH = 0.5
"""Metres at which a part is put where nothing was measured."""
Edits = (
    act.Nudge
    | act.Turn
    | act.MovePart
    | act.TypePose
    | act.CopyPrevious
    | act.PlacePart
    | act.RevertPart
    | act.RemovePart
    | act.VerifyPart
    | act.SetState
    | act.NextState
    | act.RepeatState
    | act.ClearState
    | act.Undo
    | act.Redo
)


class NothingLeft(AnnotationError):
    """There is nothing to undo or redo: no fault, only the end."""


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
    desk = Desk(workspace, view, group)
    done = _dispatch(action, desk)
    return replace(done, burst=burst)


def _dispatch(action: Edits, desk: Desk) -> Done:
    match action:
        case act.Undo() | act.Redo():
            return _switch(action, desk)
        case act.SetState() | act.NextState() | act.RepeatState() | act.ClearState():
            return labels.give(action, desk)
        case act.MovePart():
            return _drag(action, desk)
        case act.TypePose():
            return _type(action, desk)
        case act.Nudge() | act.Turn():
            return _move(action, desk)
        case act.CopyPrevious():
            return _copy(desk)
        case act.PlacePart():
            return _place(action, desk)
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
    step = STEPS_MM[desk.view.step]
    axis = action.sign * np.eye(3)[action.axis]
    if isinstance(action, act.Nudge):
        T_moved = nudged(T_camera_part, axis * step / 1000)
    else:
        angle = float(np.radians(step))
        T_moved = rotated(T_camera_part, axis, angle, centre_part=desk.centre())
    return desk.move(desk.part, T_moved, "keys")


def _copy(desk: Desk) -> Done:
    before = desk.earlier()
    if before is None:
        raise AnnotationError(
            f"{desk.part} has no pose in any of the frames before {desk.frame}: place it"
        )
    frame, T_camera_part = before
    done = desk.keep(T_camera_part, "copied")
    return replace(done, message=f"{desk.part} copied from frame {frame}")


def _place(action: act.PlacePart, desk: Desk) -> Done:
    """Put the part's middle where a pixel's depth says, turned as it was last."""
    frame = desk.workspace.frames[desk.view.place]
    pixel = _pixel_of(action, desk)
    depth = _depth_near(frame.depth, pixel) or FALLBACK_DEPTH
    ray = look_direction(frame.camera.K, pixel)
    R = _last_rotation(desk)
    T_camera_part = transform_from(R, ray / ray[2] * depth - R @ desk.centre())
    return desk.keep(T_camera_part, "placed")


def _pixel_of(action: act.PlacePart, desk: Desk) -> tuple[float, float]:
    facts = desk.workspace.facts()
    if action.u is None or action.v is None:
        return centre_of(desk.view, facts)
    width, height = facts.size_wh
    if not (-0.5 <= action.u <= width - 0.5 and -0.5 <= action.v <= height - 0.5):
        raise AnnotationError(
            f"{desk.part} was not placed: the click lies beside the picture; click into it"
        )
    return action.u, action.v


def _depth_near(depth: Depth | None, pixel: tuple[float, float]) -> float | None:
    """Median depth in a small window, metres; None where nothing was measured."""
    if depth is None:
        return None
    u, v = round(pixel[0]), round(pixel[1])
    near = depth[max(v - 4, 0) : v + 5, max(u - 4, 0) : u + 5]
    known = near[near > 0]
    return float(np.median(known)) if known.size else None


def _last_rotation(desk: Desk) -> Rotation:
    """The rotation in this frame or the nearest before that has the part; upright CAD axes otherwise."""
    now = desk.workspace.poses(desk.view.place, desk.view.base).get(desk.part)
    if now is not None:
        return now.T_camera_part[:3, :3]
    before = desk.earlier()
    return np.diag([1.0, -1.0, -1.0]) if before is None else before[1][:3, :3]


def _revert(desk: Desk) -> Done:
    """Let the base speak again, as before the correction."""
    store = desk.workspace.store
    if store.pose(desk.frame, desk.part) is None:
        raise AnnotationError(f"{desk.part} was not corrected in frame {desk.frame}")
    store.drop_pose(desk.frame, desk.part, group=desk.group)
    said = f"dropped the correction of {desk.part} in frame {desk.frame}"
    return Done(said, desk.view.place)


def _switch(action: act.Undo | act.Redo, desk: Desk) -> Done:
    undo = isinstance(action, act.Undo)
    store, view = desk.workspace.store, desk.view
    edits = store.undo() if undo else store.redo()
    if not edits:
        raise NothingLeft(f"nothing left to {'undo' if undo else 'redo'}")
    changed = frames_of(edits)
    places = [place for place, frame in enumerate(desk.workspace.indices) if frame in changed]
    said = f"{'undid' if undo else 'redid'}: {in_words(edits)}"
    return Done(said, place_to_show(places, view.place))
