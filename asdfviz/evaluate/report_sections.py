"""Puts the report page together, section by section. Pure: what is judged goes in, HTML comes out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asdfviz.errors import counted
from asdfviz.evaluate.protocols import VISIBLE
from asdfviz.evaluate.report_charts import (
    Curve,
    State,
    confusion_table,
    error_line,
    frame_ticks,
    line_chart,
    part_curves,
    recall_curve,
    reliability_curve,
    run_color,
    state_legend,
    state_strip,
)
from asdfviz.evaluate.report_pictures import Shot
from asdfviz.evaluate.report_runs import JudgedRun, frame_errors_mm, judged_frames_of
from asdfviz.evaluate.report_style import DASHES, STYLE, escape
from asdfviz.evaluate.report_tables import (
    PAPER,
    STATES,
    Row,
    parts_table,
    pose_columns,
    runs_table,
    states_rows,
)
from asdfviz.evaluate.summary import DECODED, GIVEN, starts_differ, summaries
from asdfviz.evaluate.tables import NEVER_BEST
from asdfviz.evaluate.worst import MEASURE, TOLD

_ADD_LIMIT_MM = 100.0
_DIAMETER_LIMIT = 50.0
_TRANSITIONS_SHOWN = 12


def page(runs: Sequence[JudgedRun]) -> str:
    """The whole page."""
    sequences = dict.fromkeys(run.result.run.sequence for run in runs)
    groups = [[run for run in runs if run.result.run.sequence == path] for path in sequences]
    names = ", ".join(dict.fromkeys(run.name for run in runs))
    frames = sum(len(judged_frames_of(group)) for group in groups)
    links = "".join(
        f'<a href="#s{i}">{escape(group[0].sequence_name)}</a>' for i, group in enumerate(groups)
    )
    details = "".join(_run_section(run, f"r{i}") for i, run in enumerate(runs))
    strips = "".join(_sequence_section(group, f"s{i}") for i, group in enumerate(groups))
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>asdfviz report: {escape(names)}</title><style>{STYLE}</style></head><body><main>"
        f"<h1>{escape(names)}</h1><p>{counted(len(runs), 'run')} on {counted(len(groups), 'sequence')}, "
        f"{frames} frames with truth.</p>"
        f'<nav><a href="#tables">Tables</a>{links}<a href="#runs">Runs, part by part</a></nav>'
        f'<h2 id="tables">Tables</h2>{_tables(runs)}{strips}<h2 id="runs">Runs</h2>{details}'
        "<footer>Made by asdfviz report. Shares in percent; lengths in mm; nothing on this page is "
        "loaded from elsewhere.</footer></main></body></html>\n"
    )


def _tables(runs: Sequence[JudgedRun]) -> str:
    strict, gbot = ([_row(run, report) for run in runs] for report in ("strict", "gbot"))
    states = [row for online in strict for row in states_rows(online)]
    told = f" {DECODED}: decoded with the whole recording known." if len(states) > len(runs) else ""
    several = len({run.result.run.sequence for run in runs}) > 1
    given = f"<p>{GIVEN}.</p>" if starts_differ(run.strict for run in runs) else ""
    return (
        '<div class="card"><h3>Poses, strict</h3><p>Every part of which 10 % can be seen counts; a '
        "missing pose is a miss. Means over parts; errors over the poses found.</p>"
        f"{given}{_doubtful(runs)}{runs_table(strict, pose_columns(r.strict for r in runs))}"
        f"{_means(runs, 'strict') if several else ''}</div>"
        '<div class="card"><h3>States and time</h3><p>A delay below 0 is early. ECE says how far the '
        f"run's confidence is from its accuracy.{told}</p>{runs_table(states, STATES)}</div>"
        '<div class="card"><h3>By the authors\' rules (gbot)</h3><p>Only the poses handed in count, '
        "e<sub>r</sub> over unsymmetric parts, F1 over frames: the rules behind the paper's tables. Its "
        "figures are lenient and stand here to compare with the paper.</p>"
        f"{runs_table(gbot, PAPER)}{_means(runs, 'gbot') if several else ''}</div>"
    )


def _row(run: JudgedRun, protocol: str) -> Row:
    report, is_comparable = getattr(run, protocol), run.judgement.is_comparable
    return Row(run.name, run_color(run.place), run.sequence_name, report, is_comparable)


def _doubtful(runs: Sequence[JudgedRun]) -> str:
    """Names the runs whose figures never stand out."""
    told = [f"{r.name} on {r.sequence_name}" for r in runs if not r.judgement.is_comparable]
    if not told:
        return ""
    return f"<p>{NEVER_BEST}: {escape(', '.join(told))}. See the notes on each run.</p>"


def _means(runs: Sequence[JudgedRun], protocol: str) -> str:
    """The means over sequences of each method, plain and weighted by frames."""
    reports = [{**getattr(run, protocol), "method": run.name} for run in runs]
    columns = pose_columns(reports) if protocol == "strict" else PAPER
    doubtful = {r.name for r in runs if not r.judgement.is_comparable}
    rows = [
        Row(
            entry["method"],
            None,
            f"{entry['assembly'] or 'all'}, {title}",
            {**entry, **entry[kind]},
            is_comparable=entry["method"] not in doubtful,
        )
        for title, kind in (("plain", "plain"), ("by frames", "frame_weighted"))
        for entry in sorted(summaries(reports), key=lambda entry: entry["assembly"] or "")
        if entry["n_runs"] > 1
    ]
    if not rows:
        return ""
    return f'<h3 class="next">Means over sequences</h3>{runs_table(rows, columns)}'


def _sequence_section(runs: Sequence[JudgedRun], anchor: str) -> str:
    first = runs[0]
    assembly = first.judgement.assembly
    return (
        f'<h2 id="{anchor}">{escape(first.sequence_name)}</h2>'
        f"<p>{escape(assembly.title)}, {len(assembly.parts)} parts, {len(assembly.steps)} states.</p>"
        f'<div class="card"><h3>States over time</h3>{_strips(runs)}</div>'
        f'<div class="two"><div class="card"><h3>Recall over ADD(S)</h3>{_recall_chart(runs, in_diameters=False)}</div>'
        f'<div class="card"><h3>Recall over ADD(S) in diameters</h3>{_recall_chart(runs, in_diameters=True)}</div></div>'
    )


def _strips(runs: Sequence[JudgedRun]) -> str:
    """The truth, then each run with the error of its poses below it."""
    assembly, known = runs[0].judgement.assembly, judged_frames_of(runs)
    frames = [frame.frame_index for frame in known]
    if not frames:
        return "<p>No frame with truth.</p>"
    truth = [(frame.state, bool(frame.is_error)) for frame in known]
    rows = [state_strip("truth", truth, frames, assembly)]
    has_poses = any(run.judgement.comparison.records for run in runs)
    for run in runs:
        said = {r.frame_index: (r.predicted, r.predicted_error) for r in run.judgement.states}
        states: list[State] = [said.get(index, (None, False)) for index in frames]
        rows.append(state_strip(run.name, states, frames, assembly))
        if has_poses:
            errors, missed = frame_errors_mm(run, frames)
            rows.append(error_line(errors, missed, color=run_color(run.place)))
    hint = (
        "<p>Below each run: mean ADD(S) of the visible parts that have a pose, 0 to 50 mm; red bars: the "
        "share of the visible parts without one.</p>"
        if has_poses
        else ""
    )
    return f"{''.join(rows)}{frame_ticks(frames)}{state_legend(assembly)}{hint}"


def _errors_by_part(run: JudgedRun, *, in_diameters: bool) -> dict[str, list[float]]:
    """ADD(S) of every visible part, mm or percent of its diameter; infinite where it was missed."""
    errors: dict[str, list[float]] = {}
    for record in run.judgement.comparison.records:
        if record.visible < VISIBLE:
            continue
        diameter = run.judgement.assembly.parts[record.part].diameter
        scale = 100.0 / diameter if in_diameters else 1000.0
        value = float("inf") if record.error is None else scale * record.error.add_s
        errors.setdefault(record.part, []).append(value)
    return errors


def _recall_chart(runs: Sequence[JudgedRun], *, in_diameters: bool) -> str:
    limit = _DIAMETER_LIMIT if in_diameters else _ADD_LIMIT_MM
    unit = "% of the part's diameter" if in_diameters else "mm"
    return line_chart(
        [_curve(run, limit, in_diameters=in_diameters) for run in runs],
        x_limit=limit,
        x_title=f"threshold, {unit}",
        y_title="parts below it, %",
        marks={10.0: "0.1 d"} if in_diameters else {20.0: "2 cm"},
        description=f"Recall over the ADD(S) threshold in {unit}",
    )


def _curve(run: JudgedRun, limit: float, *, in_diameters: bool) -> Curve:
    x, y = recall_curve(_errors_by_part(run, in_diameters=in_diameters), limit=limit)
    return Curve(run.name, run_color(run.place), DASHES[run.place % len(DASHES)], x, y)


def _run_section(run: JudgedRun, anchor: str) -> str:
    details: Mapping[str, Any] = run.strict["state_details"]
    curves = part_curves(
        _errors_by_part(run, in_diameters=False), run.judgement.assembly, limit=_ADD_LIMIT_MM
    )
    chart = line_chart(
        curves,
        x_limit=_ADD_LIMIT_MM,
        x_title="threshold, mm",
        y_title="frames below it, %",
        marks={20.0: "2 cm"},
        description=f"Recall over the ADD(S) threshold by part, {run.name}",
    )
    notes = "".join(f"<li>{escape(note)}</li>" for note in run.notes)
    warnings = f'<ul class="warn">{notes}</ul>' if notes else ""
    return (
        f'<div class="card" id="{anchor}"><h3><i class="chip" style="background:{run_color(run.place)}">'
        f"</i>{escape(run.name)} on {escape(run.sequence_name)}</h3>"
        f"{warnings}{parts_table(run.strict)}</div>"
        f'<div class="two"><div class="card"><h3>Recall by part</h3>{chart}</div>'
        f'<div class="card"><h3>Confusion of states</h3>{_confusion(run, details)}</div></div>'
        f'<div class="card"><h3>Worst frames</h3>{_shots(run.shots)}</div>'
        f'<div class="two">{_calibration(run, details)}{_about(run)}</div>'
    )


def _confusion(run: JudgedRun, details: Mapping[str, Any]) -> str:
    if not run.judgement.states:
        is_known = any(frame.state is not None for frame in run.judgement.frames)
        return f"<p>{'The run says' if is_known else 'The truth has'} no states.</p>"
    return (
        f"{confusion_table(details['confusion'])}"
        '<p style="margin-top:10px">Frames, and their share of the row. '
        f"{_transitions(details['transitions'])}</p>"
    )


def _transitions(transitions: Sequence[Mapping[str, Any]]) -> str:
    """Every true change and when the run followed, in words; only how many where they are many."""
    if not transitions:
        return ""
    if len(transitions) > _TRANSITIONS_SHOWN:
        followed = sum(t["delay_frames"] is not None for t in transitions)
        return f"{followed} of {len(transitions)} changes of state were followed."
    said = [
        f"{t['from']} to {t['to']} at frame {t['frame']}: "
        + ("never" if t["delay_frames"] is None else _when(t["delay_frames"]))
        for t in transitions
    ]
    return f"Changes of state: {'; '.join(said)}."


def _when(delay: int) -> str:
    if delay == 0:
        return "on time"
    return f"{counted(abs(delay), 'frame')} {'late' if delay > 0 else 'early'}"


def _calibration(run: JudgedRun, details: Mapping[str, Any]) -> str:
    if not details["reliability"]:
        return ""
    ideal = Curve("as sure as right", "var(--soft)", "2 4", [0.0, 100.0], [0.0, 100.0])
    found = reliability_curve(details, name=run.name, color=run_color(run.place), dash="")
    chart = line_chart(
        [ideal, found],
        x_limit=100.0,
        x_title="how sure of the state, %",
        y_title="how often right, %",
        description=f"Calibration of the state, {run.name}",
    )
    return f'<div class="card"><h3>Calibration of the state</h3>{chart}</div>'


def _about(run: JudgedRun) -> str:
    facts = run.result.run
    times = "".join(
        f"<tr><td class='t'>{escape(stage.replace('_', ' '))}</td><td>{value:.1f}</td></tr>"
        for stage, value in run.strict["runtime_ms"].items()
        if value is not None
    )
    return (
        f'<div class="card"><h3>How it was made</h3><p>{escape(facts.method)}, version '
        f"{escape(facts.version)}, from <code>{escape(run.result.source)}</code></p>"
        f"<table><thead><tr><th class='t'>time a frame (a stage's is its median)</th><th>ms</th></tr></thead>"
        f"<tbody>{times}</tbody></table>"
        f"<details><summary>Options</summary><pre>{escape(run.config)}</pre></details></div>"
    )


def _shots(shots: Sequence[Shot]) -> str:
    if not shots:
        return "<p>No pose to show.</p>"
    figures = "".join(
        f'<figure><img src="{shot.jpeg}" alt="{escape(f"{shot.part} in frame {shot.frame_index}")}">'
        f"<figcaption><b>{escape(shot.part)}</b>, frame {shot.frame_index}<br>{MEASURE} "
        f"{1000 * shot.error.add_s:.1f} mm, e<sub>t</sub> {1000 * shot.error.e_t_sym:.1f} mm, e<sub>r</sub> "
        f"{np.rad2deg(shot.error.e_r_sym):.1f}°</figcaption></figure>"
        for shot in shots
    )
    return (
        f"<p>{TOLD}</p><p>Filled: all poses of the run, in the colours of the parts. White outline: where the "
        f'named part truly is.</p><div class="shots">{figures}</div>'
    )
