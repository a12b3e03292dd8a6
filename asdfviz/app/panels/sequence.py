"""Sequence tab: what it is, whether it is sound, its camera, how much depth there is."""

from __future__ import annotations

import numpy as np

from asdfviz.app.markup import empty, heading, number, table, text
from asdfviz.app.snapshot import Snapshot
from asdfviz.datatypes import Frame
from asdfviz.errors import counted
from asdfviz.evaluate.health import Finding

_SIGNS = {"error": ("✕", "Wrong"), "warning": ("!", "Doubtful"), "info": ("i", "Note")}


def content(snap: Snapshot) -> str:
    """The tab as HTML."""
    return (
        _about(snap)
        + heading("Health")
        + _health(snap.workspace.findings)
        + heading("Camera")
        + _camera(snap)
        + heading("This frame")
        + _frame(snap.frame, snap.index)
    )


def _about(snap: Snapshot) -> str:
    work = snap.workspace
    states = len(work.assembly.steps)
    errors = len(work.assembly.errors)
    words = counted(states, "state") + (f", {counted(errors, 'error state')}" if errors else "")
    truth = sum(truth is not None for truth in work.truths)
    rows = [
        ["assembly", text(work.assembly.title)],
        ["parts", f"{len(work.assembly.parts)}"],
        ["states", words],
        ["frames", f"{snap.facts.count}<small> at {work.fps:.0f} a second</small>"],
        ["truth", f"{truth}<small> frames</small>" if truth else "none"],
        ["corrections", f"<code>{text(work.store.path.name)}</code>"],
    ]
    title = f'<p class="ax-path" title="{text(work.frames.path)}"><bdi>{text(work.frames.path)}</bdi></p>'
    return heading(work.frames.name) + title + table([], rows, classes="ax-facts")


def _health(findings: tuple[Finding, ...] | None) -> str:
    if findings is None:
        return '<p class="ax-busy" data-testid="health">Checking units, sizes and shifts …</p>'
    if not findings:
        return (
            '<p class="ax-good" data-testid="health"><b>✓</b> '
            "Units, sizes, frames and alignment look right.</p>"
        )
    items = "".join(_finding(finding) for finding in findings)
    return f'<ul class="ax-findings" data-testid="health">{items}</ul>'


def _finding(finding: Finding) -> str:
    sign, word = _SIGNS.get(finding.severity, _SIGNS["info"])
    return (
        f'<li class="ax-{text(finding.severity)}"><b title="{word}">{sign}</b>'
        f"<span><em>{word}.</em> {text(finding.message)}</span></li>"
    )


def _camera(snap: Snapshot) -> str:
    camera = snap.frame.camera if snap.frame else snap.workspace.frames.camera
    K = camera.K
    rows = [
        ["size", f"{camera.width} \u00d7 {camera.height}<small> px</small>"],
        [
            "focal length",
            f"{number(K[0, 0], decimals=1)}, {number(K[1, 1], decimals=1, unit='px')}",
        ],
        [
            "principal point",
            f"{number(K[0, 2], decimals=1)}, {number(K[1, 2], decimals=1, unit='px')}",
        ],
    ]
    return table([], rows, classes="ax-facts")


def _frame(frame: Frame | None, index: int) -> str:
    if frame is None:
        return empty(f"Frame {index} cannot be read. The others can still be used.")
    if frame.depth is None:
        return empty("No depth in this frame: the cloud of the 3D view is off.")
    known = frame.depth[frame.depth > 0]
    share = 100 * known.size / frame.depth.size
    median = float(np.median(known)) if known.size else None
    rows = [
        ["depth measured", f"{number(share, decimals=0, unit='%')}"],
        [
            "median distance",
            number(None if median is None else 1000 * median, decimals=0, unit="mm"),
        ],
    ]
    return table([], rows, classes="ax-facts")
