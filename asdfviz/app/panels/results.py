"""Results tab: how good each run is, where it is worst, and the export."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from asdfviz.app.markup import act, button, chip, empty, heading, number, table, text
from asdfviz.app.snapshot import Snapshot
from asdfviz.evaluate.worst import MEASURE, TOLD, WorstFrame

_POSE = (
    ("ADD(S) < 10 cm", "add_s_10cm", "%"),
    ("ADD(S) < 0.1 d", "add_s_01d", "%"),
    ("parts found", "detection_recall", "%"),
    ("found in place", "box_recall", "%"),
    ("poses in place", "box_precision", "%"),
    ("translation, mean", "e_t_mm", "mm"),
    ("translation, median", "e_t_mm_median", "mm"),
    ("rotation up to symmetry", "e_r_sym_deg", "°"),
)
_STATE = (
    ("state right", "accuracy", "%"),
    ("state right, ± 2 frames", "accuracy_tol2", "%"),
    ("errors noticed", "error_recall", "%"),
)


def content(snap: Snapshot) -> str:
    """The tab as HTML."""
    return (
        heading("How good the runs are", _judge(snap))
        + _tables(snap)
        + _worst(snap)
        + _export(snap)
    )


def _judge(snap: Snapshot) -> str:
    if snap.workspace.is_judging or not snap.workspace.runs or not _is_known(snap):
        return ""
    again = "Judge again" if snap.workspace.reports is not None else "Judge"
    return button(
        again,
        act("Evaluate"),
        title="Against the truth, corrected where it was corrected",
        classes="ax-tiny ax-primary",
        testid="judge",
    )


def _is_known(snap: Snapshot) -> bool:
    """Whether there is anything to judge by."""
    return any(snap.workspace.truths) or snap.workspace.store.version() > 0


def _tables(snap: Snapshot) -> str:
    work = snap.workspace
    if work.is_judging:
        return '<p class="ax-busy" data-testid="judging">Judging every run …</p>'
    if not work.runs:
        return empty("There is no run yet: run a method in the Methods tab.")
    if not _is_known(snap):
        return empty("Nothing is known to be right here: correct some frames, then judge the runs.")
    if work.reports is None:
        return empty("Press Judge: each run is compared with the truth, corrections included.")
    labels = {run.id: run for run in work.runs}
    known = [report for report in work.reports if report["run"] in labels]
    heads = ["", *(labels[report["run"]].label for report in known)]
    chips = [chip(labels[report["run"]].color) for report in known]
    rows = [[f"<small>strict, {known[0]['n_frames']} frames</small>", *chips]] if known else []
    rows += [_figures(label, "mean", key, unit, known) for label, key, unit in _POSE]
    rows += [_figures(label, "state", key, unit, known) for label, key, unit in _STATE]
    rows.append(_figures("time of a frame", "runtime_ms", "total_median", "ms", known))
    judged = f'{_stale(snap)}<div data-testid="report">{table(heads, rows)}</div>'
    judged += "".join(_doubts(labels[report["run"]].label, report) for report in known)
    return judged + "".join(_by_part(labels[report["run"]].label, report) for report in known)


def _doubts(label: str, report: Mapping[str, Any]) -> str:
    """What hints at a run of something else, in another unit, or with frames missing."""
    return "".join(
        f'<p class="ax-stale" data-testid="doubt">{text(label)}: {text(warning)}</p>'
        for warning in report.get("warnings", ())
    )


def _stale(snap: Snapshot) -> str:
    if not snap.workspace.is_stale:
        return ""
    return '<p class="ax-stale" data-testid="stale">Corrections were made since: judge again.</p>'


def _figures(
    label: str, section: str, key: str, unit: str, reports: list[Mapping[str, Any]]
) -> list[str]:
    cells = [number(report[section].get(key), decimals=1, unit=unit) for report in reports]
    return [text(label), *cells]


def _by_part(label: str, report: Mapping[str, Any]) -> str:
    rows = [
        [
            text(name),
            number(figures["detection_recall"], decimals=0, unit="%"),
            number(figures["e_t_mm"], decimals=1, unit="mm"),
            number(figures["e_r_sym_deg"], decimals=1, unit="°"),
        ]
        for name, figures in report["parts"].items()
    ]
    heads = [f"{label}, by part", "found", "shift", "turn"]
    return table(heads, rows)


def _worst(snap: Snapshot) -> str:
    """Where the run that is drawn is worst, as it was judged."""
    work, base = snap.workspace, snap.view.base
    reports = work.reports or ()
    worst: tuple[WorstFrame, ...] = next((r["worst"] for r in reports if r["run"] == base), ())
    if not worst or not _is_known(snap):
        return ""
    items = "".join(_worst_item(work.place_of[one.record.frame_index], one) for one in worst)
    return (
        heading(f"Worst frames of {snap.source_name(base or '')}")
        + f'<p class="ax-note">{text(TOLD)}</p>'
        + f'<ul class="ax-list" data-testid="worst">{items}</ul>'
    )


def _worst_item(place: int, one: WorstFrame) -> str:
    index, part = one.record.frame_index, one.record.part
    return (
        f'<li class="ax-item ax-pick" {act("Seek", place=place, part=part)}><span class="ax-main">'
        f"<b>frame {index}</b><small>{text(part)}</small></span>"
        f'<span class="ax-num"><small>{MEASURE} </small>'
        f"{number(one.add_s_mm, decimals=1, unit='mm')}</span></li>"
    )


def _export(snap: Snapshot) -> str:
    run = snap.workspace.run(snap.view.base)
    what = "What is drawn, with every correction,"
    buttons = button(
        "Export as BOP",
        act("Export"),
        title="scene_gt.json, scene_camera.json and states.json",
        classes="ax-primary",
        testid="export",
    )
    if run is not None:
        what = "Frames in which a pose was set, tracked or verified, and states that were set,"
        buttons += button(
            "Unchecked, too",
            act("Export", unchecked=True),
            title=f"Also all else, as {run.label} has it: guesses that nobody looked at",
            testid="export-unchecked",
        )
    return (
        heading("Export") + f'<p class="ax-note">{what} as a BOP scene with states.json, into '
        f"<code>{text(snap.workspace.export_folder)}</code></p>"
        f'<div class="ax-row">{buttons}</div>'
    )
