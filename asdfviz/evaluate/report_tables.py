"""The tables of the report page, as HTML. Pure; every name is escaped, undefined figures are dashes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from asdfviz.evaluate.protocols import TWINS, twins_matter
from asdfviz.evaluate.report_style import escape, part_color
from asdfviz.evaluate.summary import (
    DECODED,
    HELD,
    START,
    frames_told,
    starts_differ,
    with_offline,
)
from asdfviz.evaluate.tables import UNDEFINED, is_best


@dataclass(frozen=True, slots=True)
class Column:
    """A figure: where it stands in the JSON report, and which way is better (0 for neither)."""

    section: str
    key: str
    title: str
    """HTML."""
    unit: str
    """HTML."""
    better: int = 1
    decimals: int = 1


POSES = (
    Column("mean", "add_s_10cm", "ADD(S)", "&lt; 10 cm, %"),
    Column("mean", "add_s_01d", "ADD(S)", "&lt; 0.1 d, %"),
    Column("mean", "auc_add_s_2cm", "AUC", "to 2 cm, %"),
    Column("mean", "e_t_mm", "e<sub>t</sub> mean", "mm", -1),
    Column("mean", "e_t_mm_median", "median", "mm", -1),
    Column("mean", "e_t_mm_p90", "p90", "mm", -1),
    Column("mean", "e_r_sym_deg", "e<sub>r</sub> sym. mean", "°", -1),
    Column("mean", "e_r_sym_deg_median", "median", "°", -1),
    Column("mean", "e_r_sym_deg_p90", "p90", "°", -1),
    Column("mean", "detection_recall", "found", "%"),
    Column("mean", "box_recall", "in place", "% of parts"),
    Column("mean", "box_precision", "in place", "% of poses"),
    Column("mean", "score_auc", "score AUC", "%"),
    Column("mean", "score_ece", "score ECE", "%", -1),
)
TWIN_POSES = (
    Column("mean", f"add_s_10cm{TWINS}", "twins exch.", "&lt; 10 cm, %"),
    Column("mean", f"add_s_01d{TWINS}", "twins exch.", "&lt; 0.1 d, %"),
    Column("mean", f"score_auc{TWINS}", "twins exch.", "score AUC, %"),
    Column("mean", f"score_ece{TWINS}", "twins exch.", "score ECE, %", -1),
)
"""Where a pose may lie on either of two identical parts; only shown where that changes a figure."""
STATES = (
    Column("state", "accuracy", "accuracy", "%"),
    Column("state", "accuracy_tol2", "± 2 frames", "%"),
    Column("state", "macro_f1", "macro F1", "%"),
    Column("state", "macro_f1_state_part", "F1 state, part", "%"),
    Column("state", "edit", "edit", "%"),
    Column("state", "f1_50", "F1@50", "%"),
    Column("state", "delay_frames_median", "delay", "frames", 0),
    Column("state", "delay_frames_abs_median", "|delay|", "frames", -1),
    Column("state", "false_transitions", "false changes", "count", -1, 0),
    Column("state", "pos", "POS", "%"),
    Column("state", "error_recall", "error recall", "%"),
    Column("state", "error_precision", "precision", "%"),
    Column("state", "ece", "ECE", "%", -1),
    Column("runtime_ms", "total_median", "a frame", "ms", -1),
)
PAPER = (
    Column("state", "micro_f1", "F1", "%"),
    Column("mean", "add_s_10cm", "ADD(S)", "%"),
    Column("mean", "e_t_mm", "e<sub>t</sub>", "mm", -1),
    Column("mean", "e_r_deg", "e<sub>r</sub>", "°", -1),
    Column("mean", "e_t_mm_median", "e<sub>t</sub> median", "mm", -1),
    Column("mean", "e_r_deg_median", "e<sub>r</sub> median", "°", -1),
)
_PART_COLUMNS = tuple(c for c in POSES if c.key not in ("score_auc", "score_ece"))


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table: what it is called, its colour, the JSON report behind it."""

    name: str
    color: str | None
    group: str
    """Runs of one group are compared: the best figure of each column stands out."""
    report: Mapping[str, Any]
    is_comparable: bool = True
    """Whether its figures may stand out."""


def pose_columns(reports: Iterable[Mapping[str, Any]]) -> tuple[Column, ...]:
    """The columns of poses under the strict rules, by reports or means."""
    has_twins = twins_matter((report["mean"] for report in reports), (c.key for c in TWIN_POSES))
    return (*POSES, *TWIN_POSES) if has_twins else POSES


def states_rows(online: Row) -> list[Row]:
    """What a run said, and below it the states decoded offline, if any, which are no rival to it."""
    _, *offline = with_offline([online.report])
    name = f"{online.name}, {DECODED}"
    apart = [replace(online, name=name, report=one, is_comparable=False) for one in offline]
    return [online, *apart]


def runs_table(rows: Sequence[Row], columns: Sequence[Column]) -> str:
    """One line a run (or mean)."""
    body: list[str] = []
    has_starts = starts_differ(row.report for row in rows)
    for row in rows:
        rivals = [r.report for r in rows if r.group == row.group and r.is_comparable]
        rivals = rivals if row.is_comparable else []
        cells = "".join(_cell(row.report, column, rivals) for column in columns)
        name = _text_cell(row.name, row.color)
        name += _text_cell(row.report[START], None) if has_starts else ""
        group = _text_cell(row.group, None)
        mark = ' class="part"' if HELD in row.report else ""
        frames = f"<td{mark}>{frames_told(row.report)}</td>"
        body.append(f"<tr>{name}{group}{frames}{cells}</tr>")
    start = '<th class="t">Start</th>' if has_starts else ""
    first = f'<th class="t">Run</th>{start}<th class="t">Sequence</th><th>frames</th>'
    return _table(first, columns, body)


def parts_table(report: Mapping[str, Any]) -> str:
    """One line a part of a run, and the mean."""
    body: list[str] = []
    counts = ("n_visible", "n_poses", "false_positives")
    for place, (name, figures) in enumerate(report["parts"].items()):
        cells = "".join(f"<td>{figures[key]}</td>" for key in counts)
        cells += "".join(f"<td>{_number(figures.get(c.key), c)}</td>" for c in _PART_COLUMNS)
        body.append(f"<tr>{_text_cell(name, part_color(place))}{cells}</tr>")
    means = "".join(f"<td>{_number(report['mean'][c.key], c)}</td>" for c in _PART_COLUMNS)
    body.append(f'<tr class="mean"><td class="t">mean</td><td></td><td></td><td></td>{means}</tr>')
    first = '<th class="t">Part</th><th>visible</th><th>poses</th><th>extra</th>'
    return _table(first, _PART_COLUMNS, body)


def _table(first: str, columns: Sequence[Column], body: Iterable[str]) -> str:
    heads = "".join(f"<th>{c.title}<small>{c.unit}</small></th>" for c in columns)
    return (
        f'<div class="scroll"><table><thead><tr>{first}{heads}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def _text_cell(text: str, color: str | None) -> str:
    """A name that is cut where it is too long; pointing at it shows all of it."""
    chip = "" if color is None else f'<i class="chip" style="background:{color}"></i>'
    return f'<td class="t" title="{escape(text)}">{chip}{escape(text)}</td>'


def _cell(report: Mapping[str, Any], column: Column, rivals: Sequence[Mapping[str, Any]]) -> str:
    value = report[column.section].get(column.key)
    others = [r[column.section].get(column.key) for r in rivals]
    stands_out = is_best(value, others, better=column.better, decimals=column.decimals)
    mark = ' class="best"' if stands_out else ""
    return f"<td{mark}>{_number(value, column)}</td>"


def _number(value: float | int | None, column: Column) -> str:
    return UNDEFINED if value is None else f"{value:.{column.decimals}f}"
