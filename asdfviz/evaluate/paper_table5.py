"""The ASDF paper's Table 5, its figures beside ours: seven methods on GBOT's four conditions.

The paper counts by the GBOT authors' rules (`gbot` in `asdfviz.evaluate.protocols`), where what a
method leaves out costs nothing; the strict figures beside them count it as a miss. Its sequences are
not ours, so a row compares methods on like sequences, not on the same ones.
Its trackers say every pose; ours also know which ones are lost, so they are judged without those too.
"Twins exchanged" are the figures where a pose may lie on either of two identical parts: the authors
leave the copies out, and what starts from nothing cannot know which of two twins has which name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from asdfviz.evaluate.paper_layout import Layout, laid_out
from asdfviz.evaluate.protocols import TWINS, mean
from asdfviz.evaluate.summary import frames_lacking, start_told
from asdfviz.evaluate.tables import number


@dataclass(frozen=True, slots=True)
class PaperRow:
    """Means over the paper's sixteen sequences (Schieber et al., ISMAR 2024, Table 5)."""

    title: str
    add_s: float
    """Percent, by the authors' rules."""
    e_t_mm: float
    e_r_deg: float


PAPER: Mapping[str, PaperRow] = {
    "yolov8pose": PaperRow("YOLOv8Pose", 82.5, 93.0, 16.6),
    "srt3d": PaperRow("SRT3D", 80.8, 62.0, 19.7),
    "icg": PaperRow("ICG", 91.3, 25.0, 19.4),
    "icg_srt3d": PaperRow("ICG+SRT3D", 91.2, 28.0, 19.7),
    "gbot": PaperRow("GBOT", 93.5, 21.0, 17.9),
    "gbot_reinit": PaperRow("GBOT + re-init", 94.2, 20.0, 10.8),
    "asdf": PaperRow("ASDF", 95.8, 17.0, 8.1),
}
METHODS = (*PAPER, "asdf_plus", "asdf_track")
"""In the paper's order, then our own."""

GBOT_COLUMNS = (("ADD(S)", "add_s_10cm"), ("e_t mm", "e_t_mm"), ("e_r deg", "e_r_deg"))
KEPT_COLUMNS = GBOT_COLUMNS[:2]
STRICT_COLUMNS = (
    ("ADD(S) 10 cm", "add_s_10cm"),
    ("ADD(S) 0.1 d", "add_s_01d"),
    ("e_t mm", "e_t_mm"),
    ("sym. e_r deg", "e_r_sym_deg"),
)


def _exchanged(columns: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    return tuple((f"{title}, twins exchanged", f"{key}{TWINS}") for title, key in columns)


GBOT_TWINS = _exchanged(GBOT_COLUMNS[:2])
STRICT_TWINS = _exchanged(STRICT_COLUMNS)


@dataclass(frozen=True, slots=True)
class JudgedRun:
    """One method, with one kind of first pose, on one sequence, by both protocols.

    The reports are those of `evaluate_run`.
    """

    method: str
    first_pose: str
    """"-": it starts from no detector's poses."""
    sequence: str
    initial: str
    """Whether it started from the truth of the first frame."""
    gbot: Mapping[str, Any]
    kept: Mapping[str, Any]
    """By the same rules, without the poses that the method itself says are lost."""
    strict: Mapping[str, Any]


def table5(runs: Sequence[JudgedRun], *, layout: Layout = "markdown") -> str:
    """Lay out the mean of every method and first pose over its sequences, the paper's figures first.

    CSV holds every single sequence as well, without the paper's figures: those are means.
    """
    kinds = dict.fromkeys((run.method, run.first_pose) for run in runs)
    rows = [
        _mean_row([r for r in runs if (r.method, r.first_pose) == kind])
        for kind in sorted(kinds, key=lambda kind: _place(kind[0]))
    ]
    if layout == "csv":
        rows += [_row(run.sequence, [run], theirs=_UNKNOWN) for run in runs]
    return laid_out(HEADINGS, rows, texts=4, layout=layout)


_UNKNOWN = (None,) * 3

HEADINGS = (
    "Method",
    "First pose",
    "Start",
    "Sequences",
    *(f"paper {title}" for title, _ in GBOT_COLUMNS),
    *(f"gbot {title}" for title, _ in GBOT_COLUMNS),
    *(f"gbot {title}" for title, _ in GBOT_TWINS),
    *(f"kept {title}" for title, _ in KEPT_COLUMNS),
    *(f"strict {title}" for title, _ in (*STRICT_COLUMNS, *STRICT_TWINS)),
    "ms a frame",
)


def _place(method: str) -> tuple[int, str]:
    return (METHODS.index(method) if method in METHODS else len(METHODS), method)


def _mean_row(runs: Sequence[JudgedRun]) -> list[str]:
    paper = PAPER.get(runs[0].method)
    theirs = _UNKNOWN if paper is None else (paper.add_s, paper.e_t_mm, paper.e_r_deg)
    return _row(str(len(runs)), runs, theirs=theirs)


def _row(sequences: str, runs: Sequence[JudgedRun], *, theirs: Sequence[float | None]) -> list[str]:
    method, first_pose = runs[0].method, runs[0].first_pose
    paper = PAPER.get(method)
    gbot = [mean(r.gbot["mean"].get(key) for r in runs) for _, key in (*GBOT_COLUMNS, *GBOT_TWINS)]
    kept = [mean(r.kept["mean"].get(key) for r in runs) for _, key in KEPT_COLUMNS]
    strict = [
        mean(r.strict["mean"].get(key) for r in runs) for _, key in (*STRICT_COLUMNS, *STRICT_TWINS)
    ]
    ms = mean(r.strict["runtime_ms"].get("total_median") for r in runs)
    return [
        method if paper is None else paper.title,
        first_pose,
        start_told(run.initial for run in runs),
        sequences + frames_lacking([run.strict for run in runs]),
        *map(number, (*theirs, *gbot, *kept, *strict, ms)),
    ]
