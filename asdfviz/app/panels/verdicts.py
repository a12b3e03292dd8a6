"""Buttons of the Annotate tab for what is said without moving anything: right, not here, no label."""

from __future__ import annotations

from asdfviz.app.markup import act, button
from asdfviz.app.snapshot import Snapshot


def content(snap: Snapshot, name: str) -> str:
    """What may be said of the selected part, as HTML."""
    said = snap.said.get(name)
    here = "these frames" if snap.view.range_here else "this frame"
    first, last = snap.view.frames
    posed = [cell for cell in snap.lane.cells[first : last + 1] if cell.is_posed]
    is_verified = bool(posed) and all(cell.kind == "verified" for cell in posed)
    back = "Take back that its" if is_verified else "Its"
    verify = button(
        "Verified",
        act("VerifyPart"),
        title=f"{back} pose in {here} was looked at and is right",
        key="V",
        pressed=is_verified,
        classes="ax-switch",
        testid="verify",
    )
    remove = button(
        f"Not in {here}",
        act("RemovePart"),
        title=f"Say that the part is not in {here}",
        key="Del",
        testid="remove",
    )
    revert = button(
        "Drop correction",
        act("RevertPart"),
        title=f"Back to what it started from in {here}",
        key="Shift ⌫",
        testid="revert",
    )
    shown = name in snap.poses
    row = (
        (verify if shown else "")
        + (remove if shown or said is None or snap.view.range_here else "")
        + (revert if said is not None or _is_said_along(snap, name) else "")
    )
    return f'<div class="ax-row">{row}</div>'


def _is_said_along(snap: Snapshot, name: str) -> bool:
    """Whether anything was said of the part in the marked range."""
    if snap.view.range_here is None:
        return False
    first, last = snap.view.range_here
    said = snap.workspace.said()
    return any((index, name) in said for index in snap.workspace.indices[first : last + 1])


def clear_label(snap: Snapshot) -> str:
    """Only where a label was set by hand."""
    if not snap.workspace.is_labelled(*snap.view.frames):
        return ""
    return button(
        "Clear",
        act("ClearState"),
        title="Take the label away: the state is as before anybody set one",
        key="Shift Del",
        classes="ax-tiny",
        testid="clear-state",
    )
