"""Puts parts somewhere: at a pixel, where they were before, or where the state joins them. No viser in here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asdfviz.app import actions as act
from asdfviz.app import by_state
from asdfviz.app.ar import look_direction
from asdfviz.app.desk import Desk, Done
from asdfviz.app.history import NAMED
from asdfviz.app.view import centre_of
from asdfviz.errors import AnnotationError, counted, some
from asdfviz.geometry.shapes import Depth, Intrinsics, Rotation
from asdfviz.geometry.transforms import transform_from

FALLBACK_DEPTH = 0.5
"""Metres at which a part is put where nothing was measured."""


def give(action: act.CopyPrevious | act.PlacePart | act.PlaceJoined, desk: Desk) -> Done:
    """Keep the poses.

    Raises:
        AnnotationError: nothing tells where a part is to be put; the message says why.
    """
    match action:
        case act.CopyPrevious():
            return _copy(desk)
        case act.PlacePart():
            return _place(action, desk)
        case act.PlaceJoined():
            return by_state.place_joined(desk)


def _copy(desk: Desk) -> Done:
    """In a marked range, into every frame without a pose: a part that lies still, or is hidden."""
    if desk.view.range_here is not None:
        return _copy_along(desk)
    at = desk.lane().source(desk.view.place)
    if at is None:
        raise _nowhere(desk)
    done = desk.keep(desk.pose_at(at), "copied")
    later = ", as it has no pose in any before" if at > desk.view.place else ""
    said = f"{desk.part} copied from frame {desk.workspace.indices[at]}{later}"
    return replace(done, message=said)


def _copy_along(desk: Desk) -> Done:
    lane, indices = desk.lane(), desk.workspace.indices
    first, last = desk.view.frames
    source = lane.source(first)
    filled: dict[int, list[int]] = {}
    for place in range(first, last + 1):
        if lane.cells[place].is_posed:
            source = place
        elif lane.cells[place].is_gap and source is not None:
            filled.setdefault(source, []).append(indices[place])
    if source is None:
        raise _nowhere(desk)
    if not filled:
        raise AnnotationError(f"in {desk.where} no frame lacks a pose of {desk.part}")
    Ts = {source: desk.pose_at(source) for source in filled}
    found = {f: {desk.part: Ts[source]} for source, frames in filled.items() for f in frames}
    with desk.workspace.store.transaction():
        desk.begin()
        desk.workspace.store.set_frames(found, provenance="copied", group=desk.group)
    count = counted(len(found), "frame")
    named = some((indices[source] for source in filled), most=NAMED)
    sources = f"frame{'s' if len(filled) > 1 else ''} {named}"
    return Done(f"{desk.part} copied into {count} of {desk.where}, from {sources}", desk.view.place)


def _nowhere(desk: Desk) -> AnnotationError:
    return AnnotationError(f"{desk.part} has no pose in any other frame to copy: place it")


def _place(action: act.PlacePart, desk: Desk) -> Done:
    """Put the part's middle where a pixel's depth says, turned as it was last.

    Without a pixel it goes where the state has it, else into the middle of the view if it has no pose.
    """
    if action.u is None:
        joined = by_state.place_one(desk)
        if joined is not None:
            return joined
        _check_is_missing(desk)
    frame = desk.workspace.frames[desk.view.place]
    pixel = _pixel_of(action, desk, frame.camera.K)
    measured = _depth_near(frame.depth, pixel)
    depth = measured or FALLBACK_DEPTH
    ray = look_direction(frame.camera.K, pixel)
    R = _last_rotation(desk)
    T_camera_part = transform_from(R, ray / ray[2] * depth - R @ desk.centre())
    done = desk.keep(T_camera_part, "placed")
    if measured is not None:
        return done
    return replace(
        done, message=f"{done.message}, {depth:g} m away, since no depth is measured there"
    )


def _check_is_missing(desk: Desk) -> None:
    """The middle of the view is no better place than the one that a part has."""
    workspace, view = desk.workspace, desk.view
    if desk.part not in workspace.poses(view.place, view.base):
        return
    state = workspace.state(view.place, view.base)
    if state is None:
        why = "the state there is not known"
    elif desk.part not in state.attached:
        why = f"it is not joined in {state.name}"
    else:
        why = "no other part tells where what is joined lies"
    raise AnnotationError(
        f"{desk.part} keeps its pose in frame {desk.frame}, since {why}: "
        "press Shift and click where it should be"
    )


def _pixel_of(action: act.PlacePart, desk: Desk, K: Intrinsics) -> tuple[float, float]:
    facts = replace(desk.workspace.facts(), K=K)
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
    """The rotation in this frame, else in one before or after; upright CAD axes if none has the part."""
    now = desk.workspace.poses(desk.view.place, desk.view.base).get(desk.part)
    if now is not None:
        return now.T_camera_part[:3, :3]
    at = desk.lane().source(desk.view.place)
    return np.diag([1.0, -1.0, -1.0]) if at is None else desk.pose_at(at)[:3, :3]
