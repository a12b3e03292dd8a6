"""Annotate tab: the parts of this frame, the selected part's pose, the state, undo."""

from __future__ import annotations

import json

from asdfviz.app import theme
from asdfviz.app.history import range_in_words
from asdfviz.app.items import ANNOTATION, Shown
from asdfviz.app.markup import (
    EYE,
    act,
    bar,
    button,
    chip,
    empty,
    fixed,
    heading,
    number,
    table,
    text,
)
from asdfviz.app.naming import short_names
from asdfviz.app.panels import placing, tracking, verdicts
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.timeline import color_of, mark_of_state
from asdfviz.app.typed_pose import FIGURES, figures_of
from asdfviz.app.view import STEP_NAMES, STEPS_DEG, STEPS_MM, View
from asdfviz.datatypes import State

ROOMY = 5
"""Parts and states with two lines each; more parts get one line, more states stand in two columns, so
that all of the tab is in sight in a window of 800 pixels."""
STAGES = {
    "pnp": "from keypoints",
    "crop": "from its crop",
    "refined": "refined by depth",
    "group": "solved as a group",
    "tracked": "tracked",
    "annotated": "corrected",
    "truth": "truth",
    "csv": "from a result csv",
}
"""How a pose came about, in words."""
_TURNS = "Euler angles: turns about the camera's fixed x, then y, then z axis (R = Rz Ry Rx). "
_DERIVED = {"tracked": "tracked", "group": "by the state"}
"""The same of corrected poses that no hand has set."""


def content(snap: Snapshot) -> str:
    """The tab as HTML."""
    return _history(snap) + _parts(snap) + _selected(snap) + _state(snap)


def _history(snap: Snapshot) -> str:
    undo = button(
        "Undo", act("Undo"), title="Take the last change back", key="Ctrl Z", testid="undo"
    )
    redo = button("Redo", act("Redo"), title="Do it again", key="Ctrl Shift Z", testid="redo")
    said = snap.status or "Every change is saved at once."
    return (
        f'<div class="ax-row ax-history">{undo}{redo}'
        f'<span class="ax-status" title="{text(said)}" data-testid="status">{text(said)}</span></div>'
    )


def _parts(snap: Snapshot) -> str:
    shorts = short_names(snap.facts.parts)
    items = "".join(_part(name, shorts[name], snap) for name in snap.facts.parts)
    dense = " ax-dense" if len(snap.facts.parts) > ROOMY else ""
    found = f"<small>{len(snap.poses)} of {len(snap.facts.parts)} have a pose</small>"
    listed = f'<ul class="ax-list{dense}" data-testid="parts">{items}</ul>'
    return heading("Parts", found) + listed + placing.joined(snap)


def _part(name: str, short: str, snap: Snapshot) -> str:
    shown = snap.poses.get(name)
    chosen = " ax-on" if snap.view.selected == name else ""
    hidden = name in snap.view.hidden
    red, green, blue = (int(value) for value in snap.workspace.assembly.parts[name].color)
    colors = chip(snap.workspace.colors[name], other=(red, green, blue))
    eye = button(
        EYE,
        act("TogglePart", part=name),
        title=f"{'Show' if hidden else 'Hide'} {name}",
        classes="ax-eye ax-quiet",
        pressed=not hidden,
        testid=f"show-{name}",
    )
    return (
        f'<li class="ax-item ax-pick{chosen}" title="{text(name)}: drawn in the upper colour; the lower is its own" data-testid="part-{text(name)}" '
        f'aria-selected="{str(bool(chosen)).lower()}" {act("SelectPart", part=name)}>'
        f'{colors}<span class="ax-main"><b>{text(short)}</b>'
        f"<small>{_provenance(name, snap)}</small></span>"
        f'<span class="ax-num">{_score(shown)}</span>{eye}</li>'
    )


def _provenance(name: str, snap: Snapshot) -> str:
    shown, said = snap.poses.get(name), snap.said.get(name)
    if shown is None and said is not None:
        return f"{chip(theme.ANNOTATION, shape='dot')}not in this frame<i>, by hand</i>"
    if shown is None:
        return "no pose<i> in this frame</i>"
    dot = chip(snap.source_color(shown.source), shape="dot")
    if shown.source == ANNOTATION:
        how = _DERIVED.get(shown.stage)
        if said is None or not said.verified:
            return f"{dot}{how or _by_hand(name, snap)}"
        return f"{dot}verified" + (f"<i>, {how}</i>" if how else "")
    stage = STAGES[shown.stage]
    source = snap.source_name(shown.source)
    return f"{dot}{text(source)}" + (f"<i>, {stage}</i>" if stage != source else "")


def _by_hand(name: str, snap: Snapshot) -> str:
    """Where nobody else had a pose there was nothing to correct."""
    is_given = name in snap.workspace.base_poses(snap.view.place, snap.view.base)
    return "corrected" if is_given else "placed by hand"


def _score(shown: Shown | None) -> str:
    if shown is None or shown.score is None:
        return ""
    return f'<span title="score">{number(100 * shown.score, decimals=0, unit="%")}</span>'


def _selected(snap: Snapshot) -> str:
    name = snap.view.selected
    if name is None:
        hint = empty("Click a part in the picture or in the list, or press N.")
        return heading("Pose") + hint + tracking.progress(snap)
    shown = snap.poses.get(name)
    if shown is None:
        found = "is marked as not in" if name in snap.said else "has no pose in"
        return (
            heading(f"Pose of {name}")
            + f'<p class="ax-empty">{text(name)} {found} this frame.</p>'
            + f'<div class="ax-row">{placing.button_for(snap, name)}{_copy_button()}</div>'
            + placing.HINT
            + verdicts.content(snap, name)
            + tracking.progress(snap)
        )
    return (
        heading(f"Pose of {name}", _steps(snap.view))
        + _pose_table(name, shown, snap.view.place)
        + _tools(snap, name)
        + verdicts.content(snap, name)
        + tracking.content(snap)
    )


def _pose_table(name: str, shown: Shown, place: int) -> str:
    """Figures that can be typed over; the page's script sends what was (static/typing.js)."""
    values = figures_of(shown.T_camera_part)
    cells = [_figure(figure, values[figure]) for figure in FIGURES]
    rows = [["position", *cells[:3]], ["rotation", *cells[3:]]]
    figures = table(["", "x right", "y down", "z away"], rows)
    typed = text(json.dumps({"kind": "TypePose", "part": name, "place": place}))
    return f'<div class="ax-typed" data-testid="pose" data-typed="{typed}">{figures}</div>'


def _figure(name: str, value: float) -> str:
    shown = fixed(value, decimals=1)
    unit, order = ("°", _TURNS) if name in FIGURES[3:] else ("mm", "")
    return (
        f'<label><input type="text" inputmode="decimal" spellcheck="false" autocomplete="off" '
        f'aria-label="{name}, {unit}" title="{text(order)}Type a figure; Enter takes it, Esc leaves it" '
        f'data-testid="pose-{name.replace(" ", "-")}" data-option="{name}" '
        f'data-default="{shown}" value="{shown}"><small> {unit}</small></label>'
    )


def _steps(view: View) -> str:
    name, by_mm, by_deg = STEP_NAMES[view.step], STEPS_MM[view.step], STEPS_DEG[view.step]
    return button(
        f"{name}: {by_mm:g} mm, {by_deg:g}°",
        act("CycleStep"),
        title="Step size of nudges and turns",
        key="0",
        classes="ax-tiny",
        testid="step",
    )


def _tools(snap: Snapshot, name: str) -> str:
    gizmo = "".join(
        button(
            label,
            act("SetGizmo", gizmo=mode),
            title=title,
            key="G",
            classes="ax-seg",
            pressed=snap.view.gizmo == mode,
            testid=f"gizmo-{mode}",
        )
        for mode, label, title in (
            ("move", "Move", "Arrows to drag"),
            ("turn", "Turn", "Arcs to drag"),
            ("off", "Off", "Nothing to drag"),
        )
    )
    keys = "".join(f"<kbd>{key}</kbd>" for key in "IKJLUO")
    hint = (
        '<p class="ax-note" title="I, K: up, down; J, L: left, right; U, O: nearer, farther">'
        f"{keys} move it, with <kbd>Shift</kbd> they turn it.</p>"
    )
    segments = f'<div class="ax-group ax-segs">{gizmo}</div>{_together(snap, name)}'
    return f'<div class="ax-row">{segments}{_copy_button()}</div>{hint}'


def _together(snap: Snapshot, name: str) -> str:
    """Only where something would come along."""
    joined = set(snap.workspace.attached(snap.view.place, snap.view.base)) & set(snap.poses)
    if name not in joined or len(joined) < 2:
        return ""
    return button(
        "Joined too",
        act("Toggle", what="together"),
        title="Move, turn and verify what is joined in this state as one",
        classes="ax-switch",
        pressed=snap.view.together,
        testid="together",
    )


def _copy_button() -> str:
    return button(
        "Copy previous",
        act("CopyPrevious"),
        title="Take the pose of the frame before, or else of the next; in a marked range, for all frames without one",
        key="C",
        testid="copy",
    )


def _state(snap: Snapshot) -> str:
    view = snap.view
    where = range_in_words(*(snap.workspace.indices[place] for place in view.frames))
    ends = ", M ends the range" if view.marking is not None else ""
    clear = (
        button("Drop range", act("Cancel"), title="Only this frame", key="Esc", classes="ax-tiny")
        if view.range_here
        else button(
            "Begin a range",
            act("MarkRange"),
            title="Begin here, step on, end it with M; or drag on the timeline with Shift",
            key="M",
            classes="ax-tiny",
            testid="mark",
        )
    )
    mark, _ = snap.mark
    now = None if mark is None else (mark.state, mark.is_error, mark.name)
    states = snap.workspace.assembly.states
    shorts = {
        **short_names([state.name for state in states if not state.is_error]),
        **short_names([state.name for state in states if state.is_error]),
    }
    items = "".join(_state_row(state, shorts[state.name], snap, now, where) for state in states)
    columns = " ax-dense ax-columned" if len(states) > ROOMY else ""
    return (
        heading(
            "State",
            f'<small class="ax-for" data-testid="range">for <em>{text(where)}</em>{ends}</small>'
            f'<span class="ax-group">{verdicts.clear_label(snap)}{clear}</span>',
        )
        + f'<ul class="ax-list{columns}" data-testid="states">{items}</ul>'
    )


def _state_row(
    state: State, short: str, snap: Snapshot, now: tuple[int, bool, str] | None, where: str
) -> str:
    steps = len(snap.workspace.assembly.steps)
    color = color_of(mark_of_state(snap.workspace.assembly, state.index), steps)
    estimate = snap.prediction.state if snap.prediction else None
    share = None if estimate is None else float(estimate.probabilities[state.index])
    is_now = now is not None and (
        now[2] == state.name
        or (now[:2] == (state.completed, state.is_error) and not state.is_error)
    )
    after = snap.workspace.assembly.states[state.completed].name
    note = f"error after {text(after)}" if state.is_error else f"{len(state.attached)} joined"
    gauge = "" if share is None else bar(share, color)
    percent = "" if share is None else number(100 * share, decimals=0, unit="%")
    return (
        f'<li class="ax-item ax-pick ax-staterow{" ax-on" if is_now else ""}" '
        f'title="{text(state.name)}, {note}: press to set it for {text(where)}" '
        f'data-testid="state-{state.index}" aria-selected="{str(is_now).lower()}" '
        f"{act('SetState', state=state.index)}>{chip(color)}"
        f'<span class="ax-main"><b>{text(short)}</b><small>{note}</small></span>'
        f'{gauge}<span class="ax-num">{percent}</span></li>'
    )
