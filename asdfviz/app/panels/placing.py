"""The part of the annotate tab that puts parts somewhere: at a pixel, or where the state joins them."""

from __future__ import annotations

from asdfviz.app.by_state import can_place
from asdfviz.app.history import range_in_words
from asdfviz.app.markup import act, button
from asdfviz.app.snapshot import Snapshot

HINT = (
    '<p class="ax-note">Or press <kbd>Shift</kbd> and click into the picture: it is put there, as far '
    "away as the depth says.</p>"
)


def button_for(snap: Snapshot, name: str) -> str:
    """The button that puts the selected part somewhere, and says where."""
    by_state = _is_told(snap, name)
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
    """What puts all joined parts in place, where some have no pose; else nothing."""
    view = snap.view
    attached = snap.workspace.attached(view.place, view.base)
    missing = [
        name
        for name in attached
        if name not in snap.poses and name not in snap.said and _is_told(snap, name)
    ]
    if not missing:
        return ""
    count = f"{len(missing)} joined part{'s' * (len(missing) > 1)}"
    first, last = (snap.workspace.indices[place] for place in view.joined)
    place = button(
        "Place them" if first == last else f"Place in {range_in_words(first, last)}",
        act("PlaceJoined"),
        title="Put every joined part without a pose where the state has it",
        key="Shift G",
        testid="place-joined",
    )
    return f'<div class="ax-row">{place}<span class="ax-note">{count} without a pose</span></div>'


def _is_told(snap: Snapshot, name: str) -> bool:
    workspace, view = snap.workspace, snap.view
    poses = {other: shown.T_camera_part for other, shown in snap.poses.items()}
    return can_place(workspace.assembly, workspace.state(view.place, view.base), poses, name)
