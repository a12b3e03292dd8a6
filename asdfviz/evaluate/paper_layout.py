"""Lays out the rows of the paper's tables: Markdown, CSV or LaTeX.

Names come from datasets and plug-ins, so what Markdown, HTML or MDX would read in them is escaped.
"""

from __future__ import annotations

import csv
import html
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
    rule = ["---"] * texts + ["---:"] * (len(headings) - texts)
    lines = [headings, rule, *escaped_texts(rows, texts)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def escaped_texts(rows: Sequence[Sequence[str]], texts: int) -> list[list[str]]:
    """The rows of a Markdown table, the first so many cells of each being text."""
    return [[*map(escaped, row[:texts]), *row[texts:]] for row in rows]


def escaped(text: str) -> str:
    """Text that Markdown, HTML and MDX show as it is, in one table cell."""
    shown = html.escape(one_line(text), quote=False)
    for mark in "|{}`*[]\\":
        shown = shown.replace(mark, f"&#{ord(mark)};")
    return shown


def one_line(text: str) -> str:
    """Text without the breaks that would end a row."""
    return " ".join(text.split())


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
    return one_line(text).translate(_TEX)


_TEX = str.maketrans(
    {
        **{mark: f"\\{mark}" for mark in "&%$#_{}"},
        **{"<": "$<$", ">": "$>$", "±": "$\\pm$", "°": "$^\\circ$", "~": "$\\sim$", "|": "$|$"},
        **{"\\": "\\textbackslash{}", "^": "\\textasciicircum{}"},
    }
)
