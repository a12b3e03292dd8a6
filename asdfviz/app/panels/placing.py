"""The part of the annotate tab that puts parts somewhere: at a pixel, or where the state joins them."""

from __future__ import annotations

from asdfviz.app.by_state import follows, told_parts, unfitting
from asdfviz.app.history import range_in_words
from asdfviz.app.markup import act, button
from asdfviz.app.snapshot import Snapshot

HINT = (
    '<p class="ax-note">Or press <kbd>Shift</kbd> and click into the picture: it is put there, as far '
    "away as the depth says.</p>"
)


def button_for(snap: Snapshot, name: str) -> str:
    """The button that puts the selected part somewhere, and says where."""
    by_state = name in told_parts(snap.workspace, snap.view.place, snap.view.base)
    where = "where the state joins it" if by_state else "into the middle of the view"
    return button(
        "Place by the state" if by_state else "Place here",
        act("PlacePart"),
        title=f"Put it {where}",
        key="Shift Enter",
        classes="ax-primary",
        testid="place",
    )


def joined(snap: Snapshot) -> str:
    """What puts all joined parts in place, where some have no pose or were placed so before; else nothing."""
    workspace, place, base = snap.workspace, snap.view.place, snap.view.base
    told = told_parts(workspace, place, base)
    missing = [name for name in told if name not in snap.poses and name not in snap.said]
    again = [name for name in workspace.assembly.parts if follows(workspace, place, name)]
    poses = {name: shown.T_camera_part for name, shown in snap.poses.items()}
    off = unfitting(workspace.assembly, workspace.state(place, base), poses, again)
    if not missing and not again:
        return ""
    count = f"{len(missing)} joined without a pose"
    first, last = (workspace.indices[at] for at in snap.view.joined)
    where = "" if first == last else f" in {range_in_words(first, last)}"
    pressed = button(
        f"Place {'them' if missing else 'again'}{where}",
        act("PlaceJoined"),
        title="Put every joined part without a pose of its own where the state has it",
        key="Shift G",
        testid="place-joined",
    )
    note = count if missing else f"{len(again)} by the state"
    if off:
        note = f"{len(off)} by the state no longer fit"
    kind = "ax-doubt" if off else "ax-note"
    return f'<div class="ax-row ax-joined">{pressed}<span class="{kind}">{note}</span></div>'
