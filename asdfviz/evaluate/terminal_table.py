"""The summary of judged runs for a terminal: as many of the figures that are defined as fit its width."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from asdfviz.evaluate.paper_layout import one_line
from asdfviz.evaluate.protocols import TWINS
from asdfviz.evaluate.summary import (
    DECODED,
    GIVEN,
    START,
    frames_told,
    starts_differ,
    with_offline,
)
from asdfviz.evaluate.tables import MEANS, UNDEFINED, number, pose_columns

_WHO = ("Method", "Start")
_LEAST_NAME = 12
"""Characters that a name keeps."""
_GAP = "  "
_OFFLINE = "  offline"
"""Shorter than `DECODED`, or the middle of it would be cut."""


@dataclass(frozen=True, slots=True)
class _Column:
    title: str
    unit: str
    section: str
    key: str
    rank: int
    """The larger, the sooner it is left out."""


_COLUMNS = (
    _Column("ADD(S)", "<10cm%", "mean", "add_s_10cm", 1),
    _Column("ADD(S)", "<0.1d%", "mean", "add_s_01d", 0),
    _Column("twins", "<0.1d%", "mean", f"add_s_01d{TWINS}", 8),
    _Column("AUC", "2 cm", "mean", "auc_add_s_2cm", 11),
    _Column("AR", "BOP", "mean", "ar_bop", 2),
    _Column("e_t", "mm", "mean", "e_t_mm", 3),
    _Column("e_t", "median", "mean", "e_t_mm_median", 9),
    _Column("e_r", "sym. °", "mean", "e_r_sym_deg", 4),
    _Column("e_r", "median", "mean", "e_r_sym_deg_median", 13),
    _Column("found", "%", "mean", "detection_recall", 7),
    _Column("state", "%", "state", "accuracy", 5),
    _Column("±2", "frames", "state", "accuracy_tol2", 12),
    _Column("macro", "F1", "state", "macro_f1", 10),
    _Column("frame", "ms", "runtime_ms", "total_median", 6),
)


@dataclass(frozen=True, slots=True)
class _Row:
    names: tuple[str, ...]
    frames: str
    report: Mapping[str, Any]


def runs_summary(results: Sequence[Mapping[str, Any]], *, width: int) -> str:
    """One row a run; below, what was warned about, and where all figures are."""
    has_starts = starts_differ(results)
    rows = [
        _Row((*_who(one, has_starts), one_line(str(one["sequence"]))), frames_told(one), one)
        for one in with_offline(results)
    ]
    notes = [textwrap.fill(f"{GIVEN}.", width)] if has_starts else []
    notes += [
        textwrap.fill(f"{one['method']}: {warning}", width, subsequent_indent="  ")
        for one in results
        for warning in one.get("warnings", ())
    ]
    heads = (*_WHO[: 1 + has_starts], "Sequence")
    rules = f"Protocol {results[0]['protocol']}. All figures, part by part: --json; as a table: --format md"
    if any(row.names[0] == _OFFLINE for row in rows):
        rules = f"{rules}. Offline: states decoded with all frames known (Viterbi)"
    closing = textwrap.fill(rules, width, break_on_hyphens=False)
    return "\n".join(
        [_laid_out(heads, rows, width=width), *(["", *notes] if notes else []), "", closing]
    )


def means_summary(means: Sequence[Mapping[str, Any]], *, width: int) -> str:
    """Two rows a method (and one assembly of it): the plain and the frame-weighted mean over runs."""
    has_starts = starts_differ(means)
    rows = [
        _Row(
            (*_who(row, has_starts), one_line(str(row["assembly"] or "all")), title),
            frames_told(row),
            row,
        )
        for entry in means
        for title, kind in MEANS
        for row in with_offline([{**entry, **entry[kind]}])
    ]
    return _laid_out((*_WHO[: 1 + has_starts], "Assembly", "Mean"), rows, width=width)


def _who(row: Mapping[str, Any], has_starts: bool) -> tuple[str, ...]:
    """A row's method, and what it began with where that is told."""
    return (_told(row), str(row[START]))[: 1 + has_starts]


def _told(row: Mapping[str, Any]) -> str:
    """The method; of a row of states decoded offline only that, as it stands below its run's."""
    method = one_line(str(row["method"]))
    return _OFFLINE if method.endswith(f", {DECODED}") else method


def _laid_out(heads: tuple[str, ...], rows: Sequence[_Row], *, width: int) -> str:
    names = [heads, ("",) * len(heads), *(row.names for row in rows)]
    spaces = _widths(names)
    least = [min(space, _LEAST_NAME) for space in spaces]
    columns = _defined(rows)
    while columns and _taken([*least, *_widths(_figures(rows, columns))]) > width:
        columns.remove(max(columns, key=lambda column: column.rank))
    figures = _figures(rows, columns)
    widths = _widths(figures)
    while _taken([*spaces, *widths]) > width and max(spaces) > _LEAST_NAME:
        spaces[spaces.index(max(spaces))] -= 1
    lines = [
        [
            *(_cut(name, space).ljust(space) for name, space in zip(told, spaces, strict=True)),
            *(cell.rjust(one) for cell, one in zip(cells, widths, strict=True)),
        ]
        for told, cells in zip(names, figures, strict=True)
    ]
    return "\n".join(_GAP.join(line).rstrip() for line in lines)


def _figures(rows: Sequence[_Row], columns: Sequence[_Column]) -> list[list[str]]:
    """Two lines of headings, and the cells of every row."""
    return [
        ["frames", *(column.title for column in columns)],
        ["", *(column.unit for column in columns)],
        *([row.frames, *(_figure(row, column) for column in columns)] for row in rows),
    ]


def _widths(lines: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*lines, strict=True)]


def _taken(widths: Sequence[int]) -> int:
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _defined(rows: Sequence[_Row]) -> list[_Column]:
    """The columns in which any row has a figure; that of twins only where it says another one."""
    reports = [row.report for row in rows]
    has_twins = any(key.endswith(TWINS) for _, key in pose_columns([r["mean"] for r in reports]))
    return [
        column
        for column in _COLUMNS
        if any(_figure(row, column) != UNDEFINED for row in rows)
        and (has_twins or not column.key.endswith(TWINS))
    ]


def _cut(name: str, width: int) -> str:
    """A name that is too long without its middle: beginnings and ends tell names apart."""
    if len(name) <= width:
        return name
    head = (width - 1) // 2
    return f"{name[:head]}…{name[len(name) - (width - 1 - head) :]}"


def _figure(row: _Row, column: _Column) -> str:
    return number(row.report.get(column.section, {}).get(column.key))
