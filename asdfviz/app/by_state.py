"""Puts joined parts where the state has them, once one of them stands: the assembly's share of the work.

What was placed so gives way when it is asked for again, as after the base was moved; what a person
set stays.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from asdfviz.annotate.records import BY_STATE, by_hand_of, gone_of
from asdfviz.app.desk import Desk, Done, NothingLeft
from asdfviz.app.history import parts_in_words, range_in_words
from asdfviz.app.joined import Joined, Poses, base_by_group
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Assembly, FrameTruth, State
from asdfviz.errors import AnnotationError, counted
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse
from asdfviz.state.joints import off_place

Key = tuple[int, str]
"""Number of a frame, and a part."""
_FOLLOWS = ("pose", BY_STATE)
"""What is said of a pose that follows from others, and so tells nothing of them."""
_OFF, _OFF_DEG = 0.001, 0.5
"""Farther from its place, metres and degrees, a part that was placed by the state no longer fits."""
_SAME = 1e-9
"""Entries of poses that differ by less are the same, metres."""


def told_parts(workspace: Workspace, place: int, base: str | None) -> frozenset[str]:
    """The parts of which the state of a frame tells where they are, by others that stand."""
    state = workspace.state(place, base)
    if state is None:
        return frozenset()
    telling = {
        name: shown.T_camera_part
        for name, shown in workspace.poses(place, base).items()
        if not follows(workspace, place, name)
    }
    return frozenset(
        part
        for part in state.attached
        if base_by_group(workspace.assembly, state, {n: T for n, T in telling.items() if n != part})
        is not None
    )


def follows(workspace: Workspace, place: int, part: str) -> bool:
    """Whether a part's pose was placed by the state, so that it may be placed again."""
    return workspace.said().get((workspace.indices[place], part)) == _FOLLOWS


def unfitting(
    assembly: Assembly, state: State | None, poses: Poses, said: Collection[str]
) -> list[str]:
    """The parts, of those that were placed by the state, that no longer fit the base.

    Args:
        assembly: the parts.
        state: of the frame; None where it is not known.
        poses: T_camera_part of what is drawn in the frame.
        said: the parts that were placed by the state.
    """
    base = poses.get(assembly.base)
    if state is None or base is None:
        return []
    off: list[str] = []
    for name in said:
        if name not in state.attached:
            off.append(name)
        elif name in poses and name != assembly.base:
            T_base_part = inverse(base) @ poses[name]
            if not off_place(T_base_part, assembly.parts[name], state).within(_OFF, _OFF_DEG):
                off.append(name)
    return off


def told_off(workspace: Workspace, base: str | None, truth: Mapping[int, FrameTruth]) -> str:
    """Say in how many frames parts that were placed by the state no longer fit; empty if they all do.

    Args:
        workspace: the corrections.
        base: what is drawn where nothing was corrected.
        truth: what is drawn, by frame number.
    """
    placed: dict[int, list[str]] = {}
    for (frame, name), said in workspace.said().items():
        if said == _FOLLOWS:
            placed.setdefault(frame, []).append(name)
    count = 0
    for frame, names in placed.items():
        place = workspace.place_of.get(frame)
        if place is not None and frame in truth:
            state = workspace.state(place, base)
            count += bool(unfitting(workspace.assembly, state, truth[frame].T_camera_part, names))
    words = "parts that were placed by the state no longer fit the base, or the state, in"
    return f"{words} {counted(count, 'frame')}: mark them and press Shift G" if count else ""


def place_one(desk: Desk) -> Done | None:
    """Put the selected part where the state of the frame shown has it; None where that says nothing.

    This is asked for one part, so it is put there whoever set its pose before.
    """
    workspace, view = desk.workspace, desk.view
    if desk.part not in told_parts(workspace, view.place, view.base):
        return None
    state = workspace.state(view.place, view.base)
    # It does not tell where it is itself, but how far it is in its joint.
    own = None if state is not None and desk.part in state.joints else (desk.frame, desk.part)
    joined = _known(desk, without=own)
    found = joined.placed((view.place, view.place), lambda _place, name: name == desk.part)
    if not found:
        return None
    key, T_camera_part = (desk.frame, desk.part), found[view.place][desk.part]
    # Where a person had set it, this is a person's word as well.
    told = "placed" if key in by_hand_of(workspace.said()) else BY_STATE
    span = (view.place, view.place)
    return _kept(desk, {key: T_camera_part}, span=span, provenance=told, replaces=True)


def place_joined(desk: Desk) -> Done:
    """Put every joined part without a pose where the state has it.

    In the frame shown, in the marked range, or in the one that the state was just set for. Poses that
    followed from a state which joins the part no longer are taken away.

    Raises:
        AnnotationError: there is nothing to put anywhere; the message says why.
    """
    workspace, span = desk.workspace, desk.view.joined
    joined, followed = _known(desk), _followed(desk, span)
    gone = gone_of(workspace.said())
    found = joined.placed(
        span,
        lambda place, name: (
            name not in joined.poses(place) and (workspace.indices[place], name) not in gone
        ),
    )
    placed = {
        (workspace.indices[place], name): T
        for place, poses in found.items()
        for name, T in poses.items()
    }
    fresh = {key: T for key, T in placed.items() if not _is_same(followed.get(key), T)}
    stale = [
        (frame, name)
        for frame, name in followed
        if (state := joined.state(workspace.place_of[frame])) is not None
        and name not in state.attached
    ]
    stateless, loose, unposed = unknown = joined.unknown(span)
    if not fresh and not stale:
        if placed and not any(unknown):
            raise NothingLeft("every joined part is where the state has it already")
        raise AnnotationError(_why_none(desk, stateless, loose, unposed))
    done = _kept(desk, fresh, stale, span=span)
    lack = f"; nothing tells where the group is in {unposed} of them" if unposed else ""
    return replace(done, message=f"{done.message}{lack}")


def _known(desk: Desk, *, without: Key | None = None) -> Joined:
    """What tells where joined parts are."""
    workspace, said, base = desk.workspace, desk.workspace.said(), desk.base

    @cache
    def telling(place: int) -> dict[str, Transform]:
        frame = workspace.indices[place]
        return {
            name: shown.T_camera_part
            for name, shown in workspace.poses(place, base).items()
            if said.get((frame, name)) != _FOLLOWS and (frame, name) != without
        }

    def known(place: int) -> set[str]:
        frame = workspace.indices[place]
        spoken = {name for name in workspace.assembly.parts if (frame, name) in said}
        return spoken if base is None else spoken | workspace.layer(place, base).keys()

    @cache
    def state(place: int) -> State | None:
        return workspace.state(place, desk.view.base)

    return Joined(workspace.assembly, len(workspace.indices), state, telling, known)


def _followed(desk: Desk, span: tuple[int, int]) -> dict[Key, Transform]:
    """The poses in a span that followed from others earlier."""
    workspace, said = desk.workspace, desk.workspace.said()
    return {
        (workspace.indices[place], name): shown.T_camera_part
        for place in range(span[0], span[1] + 1)
        for name, shown in workspace.poses(place, desk.base).items()
        if said.get((workspace.indices[place], name)) == _FOLLOWS
    }


def _is_same(before: Transform | None, T_camera_part: Transform) -> bool:
    return before is not None and bool(np.allclose(before, T_camera_part, rtol=0, atol=_SAME))


def _kept(
    desk: Desk,
    found: Mapping[Key, Transform],
    stale: Collection[Key] = (),
    *,
    span: tuple[int, int],
    provenance: str = BY_STATE,
    replaces: bool = False,
) -> Done:
    """Write poses, and take stale ones away; what somebody said meanwhile stays, unless it is replaced."""
    store = desk.workspace.store
    with store.transaction():
        said = desk.workspace.said()
        kept = {k: T for k, T in found.items() if replaces or said.get(k, _FOLLOWS) == _FOLLOWS}
        gone = [key for key in stale if said.get(key) == _FOLLOWS]
        desk.begin()
        for frame, name in gone:
            store.drop_pose(frame, name, group=desk.group)
        by_frame: dict[int, dict[str, Transform]] = {}
        for (frame, name), T_camera_part in kept.items():
            by_frame.setdefault(frame, {})[name] = T_camera_part
        if by_frame:
            store.set_frames(by_frame, provenance=provenance, group=desk.group)
    told = [_told(desk, kept, "placed by the state", span)] if kept else []
    told += (
        [_told(desk, gone, "taken away, since the state does not join it", span)] if gone else []
    )
    return Done("; ".join(told) or "nothing was placed", desk.view.place)


def _told(desk: Desk, keys: Collection[Key], deed: str, span: tuple[int, int]) -> str:
    who = parts_in_words((name for _, name in keys), "joined parts")
    frames = sorted({frame for frame, _ in keys})
    first, last = (desk.workspace.indices[place] for place in span)
    if len(frames) == span[1] - span[0] + 1:
        return f"{who} {deed} in {range_in_words(first, last)}"
    return f"{who} {deed} in {len(frames)} of {range_in_words(first, last)}"


def _why_none(desk: Desk, stateless: int, loose: int, unposed: int) -> str:
    assembly, span = desk.workspace.assembly, desk.view.joined
    where = range_in_words(*(desk.workspace.indices[place] for place in span))
    if not stateless and not loose and not unposed:
        return f"every part that is joined in {where} has a pose, or is said not to be there"
    if span[0] == span[1]:
        if stateless:
            return f"the state of {where} is not known: set it, then joined parts can be placed"
        if loose:
            return f"nothing is joined to {assembly.base} in the state of {where}"
        return f"no pose tells where the others are in {where}: place {assembly.base} first"
    reasons = [f"the state of {stateless} is not known"] if stateless else []
    reasons += [f"nothing is joined in {loose}"] if loose else []
    where_others = f"no pose tells where the others are in {unposed}: place {assembly.base}"
    reasons += [where_others] if unposed else []
    return f"nothing is to be placed in {where}: {'; '.join(reasons)}"
