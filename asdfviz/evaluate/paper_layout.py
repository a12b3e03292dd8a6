"""Lays out the rows of the paper's tables: Markdown, CSV or LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypeAlias

from asdfviz.errors import InputError

Layout: TypeAlias = Literal["markdown", "csv", "latex"]
LAYOUTS: dict[str, Layout] = {".md": "markdown", ".csv": "csv", ".tex": "latex"}
"""By the ending of the file that a table is written to."""


def layout_of(out: Path | None) -> Layout:
    """The layout for a file; Markdown without one.

    Raises:
        InputError: the file's ending stands for none.
    """
    if out is None:
        return "markdown"
    if out.suffix not in LAYOUTS:
        raise InputError(f"{out}: name the table .md, .csv or .tex")
    return LAYOUTS[out.suffix]


def laid_out(
    headings: Sequence[str], rows: Sequence[Sequence[str]], *, texts: int, layout: Layout
) -> str:
    """Lay out a table.

    Args:
        headings: of the columns.
        rows: cells, as many as headings.
        texts: the first so many columns hold text, the others figures.
        layout: which of the three.
    """
    if layout == "csv":
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([headings, *rows])
        return text.getvalue().rstrip("\n")
    if layout == "latex":
        return _latex(headings, rows, texts)
    lines = [headings, ["---"] * texts + ["---:"] * (len(headings) - texts), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _latex(headings: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> str:
    lines = [
        f"\\begin{{tabular}}{{{'l' * texts}{'r' * (len(headings) - texts)}}}",
        "\\toprule",
        " & ".join(map(_tex, headings)) + " \\\\",
        "\\midrule",
        *(" & ".join(map(_tex, row)) + " \\\\" for row in rows),
        "\\bottomrule",
        "\\end{tabular}",
    ]
    return "\n".join(lines)


def _tex(text: str) -> str:
    return text.translate(_TEX)


_TEX = str.maketrans(
    {
        **{mark: f"\\{mark}" for mark in "&%$#_{}"},
        **{"<": "$<$", ">": "$>$", "±": "$\\pm$", "°": "$^\\circ$", "~": "$\\sim$"},
        **{"\\": "\\textbackslash{}", "^": "\\textasciicircum{}"},
    }
)
