"""Results tab: how good each run is, where it is worst, and the export."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from asdfviz.app.markup import act, button, chip, empty, heading, number, table, text
from asdfviz.app.naming import short_names
from asdfviz.app.snapshot import Snapshot
from asdfviz.errors import counted
from asdfviz.evaluate.summary import GIVEN, HELD, START, frames_told, starts_differ
from asdfviz.evaluate.tables import NEVER_BEST, is_best
from asdfviz.evaluate.worst import MEASURE, TOLD, WorstFrame

# What it is called, its key and unit, and whether more or less of it is better.
_POSE = (
    ("ADD(S) < 10 cm", "add_s_10cm", "%", 1),
    ("ADD(S) < 0.1 d", "add_s_01d", "%", 1),
    ("parts found", "detection_recall", "%", 1),
    ("found in place", "box_recall", "%", 1),
    ("poses in place", "box_precision", "%", 1),
    ("translation, mean", "e_t_mm", "mm", -1),
    ("translation, median", "e_t_mm_median", "mm", -1),
    ("rotation up to symmetry", "e_r_sym_deg", "°", -1),
)
_STATE = (
    ("state right", "accuracy", "%", 1),
    ("state right, ± 2 frames", "accuracy_tol2", "%", 1),
    ("errors noticed", "error_recall", "%", 1),
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
    rows = [["<small>strict</small>", *chips], ["frames", *map(_frames, known)]] if known else []
    if starts_differ(known):
        rows.append(["start", *(text(report[START]) for report in known)])
    if known:
        rows.append(["true poses", *map(_true_poses, known)])
        rows.append(["true states", *map(_true_states, known)])
    rows += [_figures("mean", *row, known) for row in _POSE]
    rows += [_figures("state", *row, known) for row in _STATE]
    rows.append(_figures("runtime_ms", "time of a frame", "total_median", "ms", -1, known))
    doubtful = [labels[report["run"]].label for report in known if not report["is_comparable"]]
    judged = (
        f'{_stale(snap)}<div class="ax-wide" data-testid="report">'
        f"{table(heads, rows, classes='ax-runs')}</div>"
    )
    if doubtful and len(known) > 1:
        judged += f'<p class="ax-note">{NEVER_BEST}: {text(", ".join(doubtful))}.</p>'
    if starts_differ(known):
        judged += f'<p class="ax-note">{GIVEN}.</p>'
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


def _frames(report: Mapping[str, Any]) -> str:
    """How many frames count, and how many of them a run has that lacks some."""
    told = frames_told(report)
    return f'<span class="ax-bad">{told}</span>' if HELD in report else told


def _true_poses(report: Mapping[str, Any]) -> str:
    """How many true poses the figures rest on, and of how many parts."""
    counts = [figures["n_visible"] for figures in report["parts"].values()]
    parts = counted(sum(count > 0 for count in counts), "part")
    return f"{sum(counts)}<small> of {parts}</small>"


def _true_states(report: Mapping[str, Any]) -> str:
    """In how many frames the true state is known."""
    return str(report["state_details"]["frames"])


def _figures(
    section: str, label: str, key: str, unit: str, better: int, reports: list[Mapping[str, Any]]
) -> list[str]:
    """A row; the best figure of the runs that compare stands out."""
    rivals = [report[section].get(key) for report in reports if report["is_comparable"]]
    cells = [text(label)]
    for report in reports:
        value = report[section].get(key)
        cell = number(value, decimals=1, unit=unit)
        stands_out = report["is_comparable"] and is_best(value, rivals, better=better)
        cells.append(f'<b class="ax-good">{cell}</b>' if stands_out else cell)
    return cells


def _by_part(label: str, report: Mapping[str, Any]) -> str:
    shorts = short_names(report["parts"])
    rows = [
        [
            f'<span title="{text(name)}">{text(shorts[name])}</span>',
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
