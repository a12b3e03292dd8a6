"""The part of the annotate tab that settles the selected part's pose, and carries it to other frames."""

from __future__ import annotations

from asdfviz.app.items import JobStatus
from asdfviz.app.job_actions import Direction
from asdfviz.app.markup import act, button, heading
from asdfviz.app.panels import job_box
from asdfviz.app.snapshot import Snapshot

BUTTONS: tuple[tuple[Direction, str, str, str], ...] = (
    ("back", "◀ Back", "Carry this pose to the frames before", "Shift R"),
    ("both", "◀ Both ▶", "Carry this pose to all frames", ""),
    ("forward", "On ▶", "Carry this pose to the frames after", "R"),
)


def content(snap: Snapshot) -> str:
    """The section as HTML."""
    at_work = progress(snap)
    if at_work:
        return at_work
    job = snap.workspace.carrying
    where = " in the range" if snap.view.range_here else ""
    buttons = "".join(
        button(
            label,
            act("TrackPart", direction=way),
            title=f"{title}{where}; your corrections stay",
            key=key,
            testid=f"track-{way}",
        )
        for way, label, title, key in BUTTONS
    )
    fit = button(
        "Fit here",
        act("FitPart"),
        title="Settle this part in this frame by its contours and depth",
        key="F",
        testid="fit",
    )
    return heading(
        f"Track{where or ' from here'}", f'<span class="ax-group">{fit}{buttons}</span>'
    ) + ("" if job is None else _end(job, snap))


def progress(snap: Snapshot) -> str:
    """How far the tracker is, whatever is selected; nothing where none is at work."""
    job = snap.workspace.carrying
    if job is None or not job.is_active:
        return ""
    doing = f"Cancelling {job.method}" if job.state == "stopping" else job.told
    what = ", views of the parts, made once" if job.preparing else ""
    cancel = button(
        "Cancel",
        act("StopTracking"),
        title="Stop; nothing is changed",
        key="Esc",
        testid="cancel-tracking",
    )
    return job_box.running(job, f"{doing}{what}", control=cancel, testid="tracking")


def _end(job: JobStatus, snap: Snapshot) -> str:
    """How it ended, while that is still so: no word of another part, none once more was done or undone."""
    if job.state == "done":
        is_new = job.version == snap.workspace.store.version()
        if not is_new or job.part != snap.view.selected:
            return ""
    sign = "!" if job.message or job.unsure else "✓"
    lost = f", {job.message}{_what_is_there(job, snap)}" if job.message else ""
    words = {
        "done": f"{sign} {job.told}{lost}. Undo takes it back.",
        "stopped": f"{job.told} was cancelled; nothing was changed.",
        "failed": f"✕ {job.message}",
    }
    return job_box.ended(job, words, testid="tracking-end", control=_to_lost(job, snap))


def _what_is_there(job: JobStatus, snap: Snapshot) -> str:
    """Whose pose stands where the part was lost, or the key that goes to where there is none."""
    lane = snap.workspace.lane(snap.view.selected, snap.view.base)
    if not any(lane.cells[place].is_gap for place in job.lost):
        return f", where its pose is {lane.cells[job.lost[0]].say}"
    for arrow, direction in (("↓", 1), ("↑", -1)):
        if lane.gap(snap.view.place, direction) is not None:
            return f"; Shift Page {arrow} goes to frames without a pose"
    return ""


def _to_lost(job: JobStatus, snap: Snapshot) -> str:
    """A button to where the part was lost next, from the shown frame on and then from the first."""
    begun = [place for place in job.lost if place - 1 not in job.lost]
    place = next((at for at in begun if at > snap.view.place), next(iter(begun), None))
    if place is None or place == snap.view.place:
        return ""
    title = f"Show frame {snap.workspace.indices[place]}, where {job.part} was lost"
    return " " + button("Go there", act("Seek", place=place), title=title, testid="to-lost")
