"""Tables of what `evaluate_run` returns: Markdown with all figures, and the same as CSV or LaTeX."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from asdfviz.evaluate.paper_layout import Layout, escaped, escaped_texts, laid_out
from asdfviz.evaluate.protocols import TWINS, twins_matter
from asdfviz.evaluate.summary import GIVEN, START, frames_told, starts_differ, with_offline

UNDEFINED = "-"
NEVER_BEST = "Never marked as best, as frames are missing or the unit is in doubt"
"""What to say of runs whose figures never stand out."""

# Heading and key of the report.
POSE_COLUMNS = (
    ("ADD(S) < 10 cm [%]", "add_s_10cm"),
    ("ADD(S) < 0.1 d [%]", "add_s_01d"),
    ("AUC 2 cm", "auc_add_s_2cm"),
    ("AR BOP", "ar_bop"),
    ("e_t [mm]", "e_t_mm"),
    ("median", "e_t_mm_median"),
    ("p90", "e_t_mm_p90"),
    ("e_r [°]", "e_r_deg"),
    ("sym. [°]", "e_r_sym_deg"),
    ("sym. median", "e_r_sym_deg_median"),
    ("sym. p90", "e_r_sym_deg_p90"),
    ("found [%]", "detection_recall"),
    ("in place, of parts [%]", "box_recall"),
    ("of poses [%]", "box_precision"),
)
TWIN_COLUMNS = (
    ("ADD(S) < 10 cm, twins [%]", f"add_s_10cm{TWINS}"),
    ("ADD(S) < 0.1 d, twins [%]", f"add_s_01d{TWINS}"),
    ("e_t median, twins [mm]", f"e_t_mm_median{TWINS}"),
)
"""With the poses of twins exchanged; only shown where that changes a figure."""
STATE_COLUMNS = (
    ("state [%]", "accuracy"),
    ("± 2 frames", "accuracy_tol2"),
    ("macro F1", "macro_f1"),
    ("edit", "edit"),
    ("F1@50", "f1_50"),
    ("delay [frames]", "delay_frames_median"),
    ("error recall", "error_recall"),
    ("precision", "error_precision"),
)

MEANS = (("plain", "plain"), ("by frames", "frame_weighted"))
"""The two means of a summary: what they are called, and their key."""
_TEXTS = ("Method", "Start", "Sequence", "Protocol", "Assembly", "Mean")
"""Headings of the columns that hold text; all stand before those of figures."""


def markdown_table(results: Sequence[Mapping[str, Any]]) -> str:
    """One row a result: means over parts, state and time, and one of its states decoded offline, where
    it has any; then what was warned about."""
    headings, rows = _runs(results)
    notes = [f"- {GIVEN}."] if starts_differ(results) else []
    notes += [
        f"- {escaped(str(result['method']))}: {escaped(str(warning))}"
        for result in results
        for warning in result.get("warnings", ())
    ]
    table = _table(headings, rows)
    return "\n".join([table, "", *notes]) if notes else table


def means_table(means: Sequence[Mapping[str, Any]]) -> str:
    """Two rows a method (and one assembly of it): the plain and the frame-weighted mean over runs."""
    return _table(*_means(means))


def runs_in(layout: Layout, results: Sequence[Mapping[str, Any]]) -> str:
    """The rows of `markdown_table` in a layout; in LaTeX, where width counts, what is never defined is left out."""
    return _in(layout, *_runs(results))


def means_in(layout: Layout, means: Sequence[Mapping[str, Any]]) -> str:
    """The rows of `means_table`, likewise."""
    return _in(layout, *_means(means))


def _in(layout: Layout, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    kept = range(len(headings))
    if layout == "latex":
        kept = [i for i in kept if any(row[i] != UNDEFINED for row in rows)]
    shown = [[row[i] for i in kept] for row in (headings, *rows)]
    return laid_out(shown[0], shown[1:], texts=_texts(shown[0]), layout=layout)


def _runs(
    results: Sequence[Mapping[str, Any]],
) -> tuple[list[str], list[list[str]]]:
    poses = pose_columns([result["mean"] for result in results])
    has_starts = starts_differ(results)
    headings = ["Method", *(["Start"] if has_starts else []), "Sequence", "Protocol", "Frames"]
    headings += [title for title, _ in (*poses, *STATE_COLUMNS)]
    rows = [
        [
            str(result["method"]),
            *([result[START]] if has_starts else []),
            str(result["sequence"]),
            str(result["protocol"]),
            frames_told(result),
            *(number(result["mean"].get(key)) for _, key in poses),
            *(number(result["state"].get(key)) for _, key in STATE_COLUMNS),
            number(result["runtime_ms"].get("total_median")),
        ]
        for result in with_offline(results)
    ]
    return [*headings, "ms a frame"], rows


def _means(
    means: Sequence[Mapping[str, Any]],
) -> tuple[list[str], list[list[str]]]:
    poses = pose_columns([entry["plain"]["mean"] for entry in means])
    has_starts = starts_differ(means)
    headings = ["Method", *(["Start"] if has_starts else []), "Assembly", "Mean", "Runs", "Frames"]
    headings += [title for title, _ in (*poses, *STATE_COLUMNS)]
    rows = [
        [
            str(row["method"]),
            *([row[START]] if has_starts else []),
            str(row["assembly"] or "all"),
            title,
            str(row["n_runs"]),
            frames_told(row),
            *(number(row["mean"].get(key)) for _, key in poses),
            *(number(row["state"].get(key)) for _, key in STATE_COLUMNS),
        ]
        for entry in means
        for title, kind in MEANS
        for row in with_offline([{**entry, **entry[kind]}])
    ]
    return headings, rows


def pose_columns(means: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, str], ...]:
    """The columns of poses, those of twins among them where they differ from the plain ones."""
    has_twins = twins_matter(means, (key for _, key in TWIN_COLUMNS))
    return (*POSE_COLUMNS, *TWIN_COLUMNS) if has_twins else POSE_COLUMNS


def is_best(
    value: float | int | None,
    rivals: Iterable[float | int | None],
    *,
    better: int,
    decimals: int = 1,
) -> bool:
    """Whether a figure stands out in its table: no rival's is better as shown, and not all are the same.

    Args:
        value: the figure.
        rivals: the same figure of all runs that are comparable, itself among them; none where its own
            run is not.
        better: 1 where more is better, -1 where less is, 0 where neither.
        decimals: as it is shown.
    """
    known = {better * round(rival, decimals) for rival in rivals if rival is not None}
    return (
        value is not None
        and better != 0
        and len(known) > 1
        and better * round(value, decimals) == max(known)
    )


def number(value: float | int | None) -> str:
    """One decimal, or a dash where the figure is not defined."""
    return UNDEFINED if value is None else f"{value:.1f}"


def _texts(headings: Sequence[str]) -> int:
    """How many columns, the first ones, hold text."""
    return sum(heading in _TEXTS for heading in headings)


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a table, text at the left of its columns and figures at the right."""
    texts = _texts(headings)
    rows = escaped_texts(rows, texts)
    widths = [max(len(row[i]) for row in (headings, *rows)) for i in range(len(headings))]

    def line(cells: Sequence[str]) -> str:
        padded = [
            cell.ljust(width) if i < texts else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ]
        return f"| {' | '.join(padded)} |"

    rule = ["-" * width if i < texts else "-" * (width - 1) + ":" for i, width in enumerate(widths)]
    return "\n".join([line(headings), line(rule), *(line(row) for row in rows)])
