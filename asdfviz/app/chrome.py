"""What lies around the picture: the bar above, the controls and the timeline below, cards. Pure HTML."""

from __future__ import annotations

import json

from asdfviz.app import lanes, theme, timeline
from asdfviz.app.actions import TABS
from asdfviz.app.hotkeys import sheet
from asdfviz.app.items import JobStatus
from asdfviz.app.markup import act, button, chip, text
from asdfviz.app.naming import short_names
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.view import SPEEDS, View

_PLAY = '<svg viewBox="0 0 16 16"><path d="M4 2.5v11l9-5.5z"/></svg>'
_PAUSE = '<svg viewBox="0 0 16 16"><path d="M4 3h3v10H4zM9 3h3v10H9z"/></svg>'
_NEXT = '<svg viewBox="0 0 16 16"><path d="M5 3l6 5-6 5z"/></svg>'
_BACK = '<svg viewBox="0 0 16 16"><path d="M11 3L5 8l6 5z"/></svg>'
_LAST = '<svg viewBox="0 0 16 16"><path d="M3 3l7 5-7 5zM11 3h2v10h-2z"/></svg>'
_FIRST = '<svg viewBox="0 0 16 16"><path d="M13 3L6 8l7 5zM3 3h2v10H3z"/></svg>'


def top_bar(snap: Snapshot) -> str:
    """Sequence, frame, state in words; the view and its zoom; the tabs."""
    view = snap.view
    return (
        f'<div class="ax-where"><b class="ax-name" data-testid="sequence">{text(snap.workspace.frames.name)}</b>'
        f'<span class="ax-sub">{text(snap.workspace.assembly.title)}</span>'
        f"{_state_badge(snap)}</div>"
        f'<div class="ax-tools">{_job(snap.workspace.job)}{_view_switch(view)}{_zoom(view)}{_keys()}</div>'
    )


def tabs(view: View) -> str:
    """The four tabs of the panel."""
    items = "".join(
        f'<span class="ax-tab" role="tab" aria-selected="{str(tab == view.tab).lower()}" '
        f'data-testid="tab-{tab}" {act("ShowTab", tab=tab)}>{tab.title()}</span>'
        for tab in TABS
    )
    return f'<div class="ax-tabs" role="tablist">{items}</div>'


def controls(snap: Snapshot) -> str:
    """Play, step and speed at the left; what is drawn at the right."""
    view, count = snap.view, snap.facts.count
    last = snap.workspace.indices[-1]
    play = button(
        _PAUSE if view.playing else _PLAY,
        act("TogglePlay"),
        title="Pause" if view.playing else "Play",
        key="Space",
        classes="ax-play",
        testid="play",
        pressed=view.playing,
    )
    steps = (
        button(_FIRST, act("Seek", place=0), title="First frame", key="Home", testid="first")
        + button(_BACK, act("Step", by=-1), title="Back one frame", key="Left", testid="back")
        + play
        + button(_NEXT, act("Step", by=1), title="On one frame", key="Right", testid="next")
        + button(_LAST, act("Seek", place=count - 1), title="Last frame", key="End", testid="last")
    )
    number = (
        f'<span class="ax-frame" title="Number in the file name, click to type another; {count} frames"><b data-testid="frame" data-place="{view.place}">'
        f"{snap.index:0{len(str(last))}d}</b><span> / {last}</span></span>"
    )
    speeds = "".join(
        button(
            _speed_name(speed),
            act("SetSpeed", speed=speed),
            title=f"Play at {_speed_name(speed)}",
            classes="ax-seg",
            pressed=speed == view.speed,
        )
        for speed in SPEEDS
    )
    return (
        f'<div class="ax-group">{steps}</div>{number}'
        f'<div class="ax-group ax-segs" aria-label="Speed">{speeds}</div>'
        f'<span class="ax-fill"></span><div class="ax-group">{_switches(view)}</div>'
    )


def timeline_rows(snap: Snapshot) -> str:
    """The strips, and the frames' numbers for the page's script."""
    steps = len(snap.workspace.assembly.steps)
    color = snap.workspace.colors.get(snap.lane.part or "", theme.ANNOTATION)
    label = short_names(snap.facts.parts).get(snap.lane.part or "", "poses")
    lane = lanes.build(snap.lane, label, count=snap.facts.count, color=color)
    rows = lane + timeline.build(snap.rows, count=snap.facts.count, steps=steps)
    return f'<div data-numbers="{text(json.dumps(snap.workspace.indices))}">{rows}</div>'


def keys_sheet() -> str:
    """All keys, by what they are for."""
    columns = "".join(
        f"<section><h3>{text(name)}</h3><ul class='ax-keys'>"
        + "".join(f"<li><kbd>{text(key)}</kbd><span>{text(say)}</span></li>" for key, say in rows)
        + "</ul></section>"
        for name, rows in sheet().items()
    )
    close = button("Close", act("ToggleKeys"), classes="ax-primary", testid="keys-close")
    return (
        '<div class="ax-card ax-wide ax-sheet" role="dialog" aria-label="Keys" data-testid="keys">'
        f"<h2>Keys and mouse</h2><div class='ax-columns'>{columns}</div><div class='ax-end'>{close}</div></div>"
    )


def _state_badge(snap: Snapshot) -> str:
    mark, who = snap.mark
    if mark is None:
        return '<span class="ax-state" data-testid="state"><span>state unknown</span></span>'
    count = len(snap.workspace.assembly.steps)
    color = timeline.color_of(mark, count)
    word = "error: " if mark.is_error else ""
    return (
        f'<span class="ax-state" data-testid="state" title="{text(f"{word}{mark.name}, {who}")}">'
        f"<span>{chip(color)}{word}{text(mark.name)}</span><small>{text(who)}</small></span>"
    )


def _job(job: JobStatus | None) -> str:
    if job is None or not job.is_active:
        return ""
    share = job.done / job.total if job.total else 0
    pace = f"{job.milliseconds:.0f} ms a frame" if job.milliseconds else "starting"
    if job.state == "stopping":
        pace = "stopping"
    stop = button("Stop", act("StopRun"), title="Stop the method", testid="stop-top")
    return (
        f'<span class="ax-job" data-testid="job"><span class="ax-meter"><i style="width:{100 * share:.1f}%">'
        f"</i></span><span>Running {text(job.method)}: {job.done}/{job.total}, {pace}</span></span>{stop}"
    )


def _keys() -> str:
    return button("Keys", act("ToggleKeys"), title="All keys", key="?", testid="keys-open")


def _view_switch(view: View) -> str:
    def side(label: str, mode: str) -> str:
        pressed = view.mode == mode
        action = act("FitView") if pressed else act("ToggleView")
        title = "Over the picture" if mode == "ar" else "In space, with the depth cloud"
        return button(
            label,
            action,
            title=title,
            key="T",
            classes="ax-seg",
            pressed=pressed,
            testid=f"view-{mode}",
        )

    return f'<div class="ax-group ax-segs">{side("AR", "ar")}{side("3D", "3d")}</div>'


def _zoom(view: View) -> str:
    if view.mode != "ar":
        return f'<div class="ax-group">{button("Reset view", act("FitView"), title="Back to the start")}</div>'
    less = button("\u2212", act("Zoom", factor=1 / 1.25), title="Zoom out", testid="zoom-out")
    more = button("+", act("Zoom", factor=1.25), title="Zoom in", key="wheel", testid="zoom-in")
    fit = button(
        f"{100 * view.zoom:.0f} %",
        act("FitView"),
        title="Show the whole picture",
        classes="ax-zoom",
        testid="zoom",
    )
    return f'<div class="ax-group">{less}{fit}{more}</div>'


def _switches(view: View) -> str:
    marks = (
        ("overlay", "Meshes", "Show or hide the meshes", "H", view.overlay),
        ("xray", "X-ray", "Only the edges, to look through", "X", view.xray),
        ("boxes", "Boxes", "Boxes that the network found", "B", view.boxes),
        ("keypoints", "Keypoints", "Keypoints that the network found", "Y", view.keypoints),
    )
    return "".join(
        button(
            label,
            act("Toggle", what=what),
            title=title,
            key=key,
            classes="ax-switch",
            pressed=is_on,
            testid=f"toggle-{what}",
        )
        for what, label, title, key, is_on in marks
    )


def _speed_name(speed: float) -> str:
    return {0.25: "¼\u00d7", 0.5: "½\u00d7"}.get(speed, f"{speed:g}\u00d7")
