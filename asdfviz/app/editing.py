"""Turns a person's edits into rows of the annotation file. No viser in here.

Each function returns the frame's place that changed and a short sentence for the status line, or
raises InputError with what to do instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from asdfviz.annotate.edits import moved_group, nudged, previous_pose, rotated
from asdfviz.annotate.records import label_of
from asdfviz.app import actions as act
from asdfviz.app.ar import look_direction
from asdfviz.app.history import frames_of, in_words, place_to_show
from asdfviz.app.truths import drawn_truth
from asdfviz.app.view import STEPS_MM, View, centre_of
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Depth, Rotation, Transform, Vector
from asdfviz.geometry.transforms import transform_from

BURST = 0.8
"""Seconds: nudges that follow each other faster are undone as one ..."""
LONGEST_BURST = 1.5
"""... up to so many seconds after the first: nobody wants to lose a minute's work at once."""
FALLBACK_DEPTH = 0.5
"""Metres at which a part is put where nothing was measured."""
Edits = (
    act.Nudge
    | act.Turn
    | act.MovePart
    | act.CopyPrevious
    | act.PlacePart
    | act.RevertPart
    | act.SetState
    | act.Undo
    | act.Redo
)

_DEEDS = {"gizmo": "dragged", "keys": "moved", "copied": "copied", "placed": "placed"}


@dataclass(frozen=True, slots=True)
class Burst:
    """Nudges in a row, which are one step for undo."""

    name: str = ""
    until: float = 0.0
    """Time (monotonic) up to which the next nudge still belongs to it."""

    end: float = 0.0
    """Time (monotonic) at which it is over however fast nudges come."""

    def joined(self, name: str, now: float) -> Burst:
        """This burst prolonged, or a new one where the last is over or was of something else."""
        if now < self.until and self.name.split("@")[0] == name:
            return replace(self, until=min(now + BURST, self.end))
        return Burst(f"{name}@{now:.6f}", now + BURST, now + LONGEST_BURST)


@dataclass(frozen=True, slots=True)
class Done:
    """What an edit did."""

    message: str
    place: int
    burst: Burst = Burst()


def apply_edit(
    action: Edits, view: View, workspace: Workspace, *, burst: Burst, now: float
) -> Done:
    """Keep an edit.

    Raises:
        AnnotationError: it cannot be done here; the message says why and what to do.
    """
    if isinstance(action, (act.Nudge, act.Turn)):
        burst = burst.joined(f"keys {view.selected} {view.place}", now)
        group = burst.name
    else:
        burst, group = Burst(), f"edit@{now:.6f}"
    desk = _Desk(workspace, view, group)
    done = _dispatch(action, desk)
    return replace(done, burst=burst)


@dataclass(frozen=True, slots=True)
class _Desk:
    """Where an edit happens."""

    workspace: Workspace
    view: View
    group: str
    """What belongs to one step of undo."""

    @property
    def frame(self) -> int:
        return self.workspace.indices[self.view.place]

    @property
    def part(self) -> str:
        if self.view.selected is None:
            raise AnnotationError("no part is selected: click one in the picture or in the list")
        return self.view.selected

    def pose(self) -> Transform:
        found = self.workspace.poses(self.view.place, self.view.base).get(self.part)
        if found is None:
            raise AnnotationError(
                f"{self.part} has no pose in frame {self.frame}: "
                "place it, or copy it from the frame before"
            )
        return found.T_camera_part

    def begin(self) -> None:
        """Note what the corrections start from, once, as part of the first edit's step."""
        store = self.workspace.store
        if store.seed().kind == "none" and self.view.base is not None:
            store.set_seed(self.workspace.seed_of(self.view.base), group=self.group)

    def keep(self, T_camera_part: Transform, provenance: str) -> Done:
        """Say where the selected part is."""
        return self._keep({self.part: T_camera_part}, self.part, provenance)

    def move(self, part: str, T_camera_part: Transform, provenance: str) -> Done:
        """Move a part, and what is joined with it if it is to come along."""
        moved = carried(self.workspace, self.view, part=part, T_camera_part=T_camera_part)
        return self._keep(moved, part, provenance)

    def _keep(self, moved: Mapping[str, Transform], part: str, provenance: str) -> Done:
        self.begin()
        store = self.workspace.store
        store.set_poses(self.frame, moved, provenance=provenance, group=self.group)
        along = f" and {len(moved) - 1} joined with it" if len(moved) > 1 else ""
        said = f"{part}{along} {_DEEDS[provenance]} in frame {self.frame}"
        return Done(said, self.view.place)

    def earlier(self) -> tuple[int, Transform] | None:
        """The nearest frame before in which the selected part has a pose, and the pose."""
        return previous_pose(drawn_truth(self.workspace, self.view.base), self.frame, self.part)

    def centre(self) -> Vector:
        return self.workspace.assembly.parts[self.part].middle


def carried(
    workspace: Workspace, view: View, *, part: str, T_camera_part: Transform
) -> dict[str, Transform]:
    """The new poses where a part is moved: its own, and those of what is joined if all move as one."""
    shown = workspace.poses(view.place, view.base)
    if not view.together or part not in shown:
        return {part: T_camera_part}
    poses = {name: pose.T_camera_part for name, pose in shown.items()}
    attached = workspace.attached(view.place, view.base)
    return moved_group(poses, part, T_camera_part, attached=attached)


def _dispatch(action: Edits, desk: _Desk) -> Done:
    match action:
        case act.Undo() | act.Redo():
            return _switch(action, desk)
        case act.SetState():
            return _set_state(action, desk)
        case act.MovePart():
            return _drag(action, desk)
        case act.Nudge() | act.Turn():
            return _move(action, desk)
        case act.CopyPrevious():
            return _copy(desk)
        case act.PlacePart():
            return _place(action, desk)
        case act.RevertPart():
            return _revert(desk)


def _drag(action: act.MovePart, desk: _Desk) -> Done:
    """A drag belongs to the frame in which it was begun, whichever is shown when it ends."""
    begun = replace(desk, view=replace(desk.view, place=action.place))
    done = begun.move(action.part, action.T_camera_part, "gizmo")
    return replace(done, place=desk.view.place)


def _move(action: act.Nudge | act.Turn, desk: _Desk) -> Done:
    T_camera_part = desk.pose()
    step = STEPS_MM[desk.view.step]
    axis = action.sign * np.eye(3)[action.axis]
    if isinstance(action, act.Nudge):
        T_moved = nudged(T_camera_part, axis * step / 1000)
    else:
        angle = float(np.radians(step))
        T_moved = rotated(T_camera_part, axis, angle, centre_part=desk.centre())
    return desk.move(desk.part, T_moved, "keys")


def _copy(desk: _Desk) -> Done:
    before = desk.earlier()
    if before is None:
        raise AnnotationError(
            f"{desk.part} has no pose in any of the frames before {desk.frame}: place it"
        )
    frame, T_camera_part = before
    done = desk.keep(T_camera_part, "copied")
    return replace(done, message=f"{desk.part} copied from frame {frame}")


def _place(action: act.PlacePart, desk: _Desk) -> Done:
    """Put the part's middle where a pixel's depth says, turned as it was last."""
    frame = desk.workspace.frames[desk.view.place]
    pixel = _pixel_of(action, desk)
    depth = _depth_near(frame.depth, pixel) or FALLBACK_DEPTH
    ray = look_direction(frame.camera.K, pixel)
    R = _last_rotation(desk)
    T_camera_part = transform_from(R, ray / ray[2] * depth - R @ desk.centre())
    return desk.keep(T_camera_part, "placed")


def _pixel_of(action: act.PlacePart, desk: _Desk) -> tuple[float, float]:
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


def _last_rotation(desk: _Desk) -> Rotation:
    """The rotation in this frame or the nearest before that has the part; upright CAD axes otherwise."""
    now = desk.workspace.poses(desk.view.place, desk.view.base).get(desk.part)
    if now is not None:
        return now.T_camera_part[:3, :3]
    before = desk.earlier()
    return np.diag([1.0, -1.0, -1.0]) if before is None else before[1][:3, :3]


def _revert(desk: _Desk) -> Done:
    """Let the base speak again, as before the correction."""
    store = desk.workspace.store
    if store.pose(desk.frame, desk.part) is None:
        raise AnnotationError(f"{desk.part} was not corrected in frame {desk.frame}")
    store.drop_pose(desk.frame, desk.part, group=desk.group)
    said = f"dropped the correction of {desk.part} in frame {desk.frame}"
    return Done(said, desk.view.place)


def _set_state(action: act.SetState, desk: _Desk) -> Done:
    states = desk.workspace.assembly.states
    if not 0 <= action.state < len(states):
        raise AnnotationError(f"there is no state {action.state}; states: 0 to {len(states) - 1}")
    desk.begin()
    first, last = (desk.workspace.indices[place] for place in desk.view.frames)
    label = label_of(states[action.state])
    desk.workspace.store.set_state(first, label, last_frame=last, group=desk.group)
    where = f"frame {first}" if first == last else f"frames {first} to {last}"
    return Done(f"state of {where}: {states[action.state].name}", desk.view.place)


def _switch(action: act.Undo | act.Redo, desk: _Desk) -> Done:
    undo = isinstance(action, act.Undo)
    store, view = desk.workspace.store, desk.view
    edits = store.undo() if undo else store.redo()
    if not edits:
        raise AnnotationError(f"nothing left to {'undo' if undo else 'redo'}")
    changed = frames_of(edits)
    places = [place for place, frame in enumerate(desk.workspace.indices) if frame in changed]
    said = f"{'undid' if undo else 'redid'}: {in_words(edits)}"
    return Done(said, place_to_show(places, view.place))
