"""Methods tab: the runs on this sequence, why the one that is drawn says its state, and running a method."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from asdfviz.app import theme
from asdfviz.app.items import JobStatus, LoadedRun
from asdfviz.app.markup import EYE, act, button, chip, empty, heading, number, text
from asdfviz.app.options import differences, label_of
from asdfviz.app.panels import job_box, reasons
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.truths import lost_base
from asdfviz.app.view import TRUTH, View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Assembly
from asdfviz.errors import counted
from asdfviz.methods.network import NetworkConfig, weights_path
from asdfviz.methods.spec import BrokenMethod, MethodSpec
from asdfviz.run import resolved_config


def content(snap: Snapshot, methods: Mapping[str, MethodSpec | BrokenMethod]) -> str:
    """The tab as HTML; `methods` is everything that could be run."""
    return (
        heading("Runs on this sequence")
        + _runs(snap, methods)
        + reasons.section(snap)
        + heading("Run a method")
        + _job(snap.workspace.job)
        + "".join(_method(name, spec, snap) for name, spec in methods.items())
    )


def _runs(snap: Snapshot, methods: Mapping[str, MethodSpec | BrokenMethod]) -> str:
    runs, lost = snap.workspace.runs, lost_base(snap.workspace)
    # What is drawn while corrections have lost their run is not what they go on from until it is used.
    in_use = snap.view.base if lost is None else None
    specs = {m.name: m for m in methods.values() if isinstance(m, MethodSpec)}
    items = [
        _run(place, run, snap, specs.get(run.run.method), in_use=in_use)
        for place, run in enumerate(runs, 1)
    ]
    if snap.facts.has_truth:
        items.append(_truth(len(runs) + 1, snap.view, in_use=in_use))
    note = ""
    if lost is not None:
        note = f'<p class="ax-note" data-testid="lost">Not what was corrected: {text(lost)}.</p>'
    if not items:
        return empty("No run yet. Run a method below: its poses appear while it works.") + note
    legend = (
        '<p class="ax-note">What is <em>in use</em> is drawn, and corrections start from it; the '
        "eye adds another run's outlines.</p>"
    )
    return f'<ul class="ax-list" data-testid="runs">{"".join(items)}</ul>{legend}{note}'


def _run(
    place: int,
    run: LoadedRun,
    snap: Snapshot,
    spec: MethodSpec | None,
    *,
    in_use: str | None,
) -> str:
    said = sum(p is not None for p in run.by_place)
    whole = said == snap.facts.count
    frames = "all frames" if whole else f"{said} of {snap.facts.count} frames"
    changed = _changed(run, snap.workspace.assembly, spec)
    where = str(run.folder) if run.folder else "not saved yet"
    return (
        f'<li class="ax-item" title="{text(where)}">{chip(run.color)}'
        f'<span class="ax-main"><b>{text(run.label)}</b><small>{frames}{text(changed)}</small></span>'
        f'<span class="ax-num">{number(run.milliseconds, decimals=0, unit="ms")}</span>'
        f"{_use(run.id, run.label, in_use)}{_eye(run.id, run.label, place, snap.view)}</li>"
    )


def _changed(run: LoadedRun, assembly: Assembly, spec: MethodSpec | None) -> str:
    """The options that were not left as they are, which tell runs of one method apart."""
    if spec is None:
        return ""
    changed = differences(resolved_config(spec.config(), assembly), run.run.config)
    return "".join(f"; {label_of(name)} {value}" for name, value in changed.items())


def _truth(place: int, view: View, *, in_use: str | None) -> str:
    return (
        f'<li class="ax-item">{chip(theme.TRUTH)}<span class="ax-main"><b>truth</b>'
        f"<small>of the dataset</small></span><span class='ax-num'></span>"
        f"{_use(TRUTH, 'the truth', in_use)}{_eye(TRUTH, 'the truth', place, view)}</li>"
    )


def _use(layer: str, label: str, in_use: str | None) -> str:
    return button(
        "in use" if layer == in_use else "use",
        act("UseRun", run=layer),
        title=f"Draw {label} and correct from it",
        classes="ax-tiny",
        pressed=layer == in_use,
        testid=f"use-{label}",
    )


def _eye(layer: str, label: str, place: int, view: View) -> str:
    key = str(place) if place <= 9 else ""
    return button(
        f"{EYE}<small>{key}</small>",
        act("ToggleLayer", layer=layer),
        title=f"Outlines of {label}",
        key=key,
        classes="ax-eye",
        pressed=layer in view.layers,
        testid=f"eye-{label}",
    )


def _job(job: JobStatus | None) -> str:
    if job is None:
        return ""
    if job.is_active:
        pace = f", {job.milliseconds:.0f} ms a frame" if job.milliseconds else ""
        word = "Stopping" if job.state == "stopping" else "Running"
        what = ", views of its parts, made once" if job.preparing else ""
        stop = button("Stop", act("StopRun"), title="Stop; what is done is kept", testid="stop")
        doing = f"{word} {job.method}{what}"
        return job_box.running(job, doing, control=stop, testid="job-panel", pace=pace)
    words = {
        "done": f"✓ {job.method} is done: {counted(job.done, 'frame')}.",
        "stopped": f"{job.method} was stopped after {job.done} of {job.total} frames, which are kept.",
        "failed": f"✕ {job.method} failed: {job.message}",
    }
    return job_box.ended(job, words, testid="job-end")


def _method(name: str, spec: MethodSpec | BrokenMethod, snap: Snapshot) -> str:
    if isinstance(spec, BrokenMethod):
        return (
            f'<div class="ax-item ax-off"><span class="ax-main"><b>{text(name)}</b>'
            f"<small>cannot be loaded: {text(spec.reason)}</small></span></div>"
        )
    job = snap.workspace.job
    busy = job is not None and job.is_active
    chosen = snap.view.options.get(name, {})
    lacking = _lacking(spec, snap.workspace, chosen)
    summary = f"{spec.summary.rstrip('.')}.{f' Not here: {lacking}.' if lacking else ''}"
    if spec.initial == "first_frame_truth" and "truth" not in summary:
        summary += " Starts from the truth of the first frame."
    changed = len(chosen)
    options = button(
        f"Options ({changed})" if changed else "Options",
        act("AskOptions", method=name),
        title=f"Weights, image size and more, before {spec.name} is run",
        classes=f"ax-plain{' ax-disabled' if busy else ''}",
        testid=f"options-{name}",
    )
    go = button(
        "Run",
        act("RunMethod", method=name),
        title=f"Run {spec.name} on this sequence",
        classes=f"ax-primary{' ax-disabled' if busy or lacking else ''}",
        testid=f"run-{name}",
    )
    return (
        f'<div class="ax-item"><span class="ax-main"><b>{text(spec.name)}</b>'
        f"<small>{text(summary)}</small></span>{options}{go}</div>"
    )


def _lacking(spec: MethodSpec, workspace: Workspace, chosen: Mapping[str, str]) -> str:
    """What a method lacks to be run on this sequence; empty where it can be."""
    if spec.initial == "first_frame_truth" and workspace.truths[0] is None:
        return "it starts from the truth of the first frame, and there is none"
    needs_weights = any(field.name == "detector" for field in dataclasses.fields(spec.config))
    if not needs_weights or "detector.weights" in chosen:
        return ""
    if weights_path(NetworkConfig(), workspace.assembly).is_file():
        return ""
    return (
        "no weights lie beside the assembly; train some (asdfviz train), or name a file under Options. "
        "Annotate needs none"
    )
