"""The ASDF paper's ablations, Tables 2 and 3, its figures beside ours, and our own of like form.

The paper's times are those of an RTX 3090, ours of the machine at hand; its errors are on its own
test sets. Where it has no row of that kind, its cells stay empty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from asdfviz.evaluate.paper_layout import Layout, laid_out
from asdfviz.evaluate.protocols import mean
from asdfviz.evaluate.tables import number


@dataclass(frozen=True, slots=True)
class PaperAblation:
    """A row of the paper's Table 2 or 3 (Schieber et al., ISMAR 2024)."""

    ms: float
    """A frame on an RTX 3090."""
    e_t_mm: float
    e_r_deg: float | None
    """None where it gives none."""


PAPER_REFINEMENT: Mapping[str, tuple[tuple[str, PaperAblation], ...]] = {
    "none": (
        ("n", PaperAblation(24.83, 29.13, 18.76)),
        ("x-p6", PaperAblation(50.83, 19.11, 11.14)),
    ),
    "icp": (
        ("n", PaperAblation(151.77, 12.27, 18.96)),
        ("x-p6", PaperAblation(145.76, 9.24, 14.35)),
    ),
    "segmentation": (
        ("n", PaperAblation(64.46, 8.52, None)),
        ("x-p6", PaperAblation(85.03, 6.53, None)),
    ),
    "translation": (
        ("n", PaperAblation(32.45, 8.13, 18.76)),
        ("x-p6", PaperAblation(55.70, 5.98, 11.14)),
    ),
}
"""Table 2 by what depth does, with the smallest and the largest network."""
PAPER_BACKBONES: Mapping[str, PaperAblation] = {
    "n": PaperAblation(24.83, 29.13, 18.76),
    "m": PaperAblation(33.72, 27.85, 15.21),
    "l": PaperAblation(35.55, 23.69, 13.09),
    "x-p6": PaperAblation(50.83, 19.11, 11.14),
}
"""Table 3, before refinement."""
NOT_TRAINED = "not trained"


@dataclass(frozen=True, slots=True)
class JudgedVariant:
    """One variant on one scene; the report is that of `evaluate_run`, strict."""

    title: str
    paper: str
    """Key of the paper's row, empty without one."""
    report: Mapping[str, Any]


POSE_COLUMNS = (
    ("mean", "add_s_01d", "ADD(S) 0.1 d"),
    ("mean", "add_s_10cm", "ADD(S) 10 cm"),
    ("mean", "e_t_mm", "e_t mm"),
    ("mean", "e_t_mm_median", "median"),
    ("mean", "e_r_deg", "e_r deg"),
    ("mean", "e_r_sym_deg_median", "sym. median"),
    ("mean", "detection_recall", "found"),
)
STATE_COLUMNS = (
    ("state", "accuracy", "state"),
    ("state", "accuracy_tol2", "within 2"),
    ("state", "macro_f1", "macro F1"),
    ("state", "delay_frames_median", "delay frames"),
    ("state", "error_recall", "error recall"),
    ("state", "error_precision", "error precision"),
)
TIME_COLUMNS = (("runtime_ms", "total_median", "ms a frame"),)


def refinement_table(judged: Sequence[JudgedVariant], *, layout: Layout = "markdown") -> str:
    """Table 2: what depth does to first poses."""
    sizes = [size for size, _ in PAPER_REFINEMENT["none"]]
    headings = ["Variant", "Scenes"]
    for size in sizes:
        headings += [f"paper {size} ms", f"paper {size} e_t mm", f"paper {size} e_r deg"]
    columns = (*POSE_COLUMNS, *TIME_COLUMNS)
    rows: list[list[str]] = []
    for title, variants in _by_title(judged).items():
        theirs = dict(PAPER_REFINEMENT.get(variants[0].paper, ()))
        cells = [cell for size in sizes for cell in _paper_cells(theirs.get(size))]
        rows.append([title, str(len(variants)), *cells, *_ours(variants, columns)])
    headings += [heading for *_, heading in columns]
    return laid_out(headings, rows, texts=2, layout=layout)


def plain_table(
    judged: Sequence[JudgedVariant],
    *,
    poses: bool = True,
    states: bool = True,
    layout: Layout = "markdown",
) -> str:
    """Our own ablations, which the paper has no figures for, with the columns that they are about."""
    columns = POSE_COLUMNS * poses + STATE_COLUMNS * states + TIME_COLUMNS * poses
    rows = [
        [title, str(len(variants)), *_ours(variants, columns)]
        for title, variants in _by_title(judged).items()
    ]
    headings = ["Variant", "Scenes", *(heading for *_, heading in columns)]
    return laid_out(headings, rows, texts=2, layout=layout)


@dataclass(frozen=True, slots=True)
class Backbone:
    """A size of the network: its time here, and what trained weights of that size reach."""

    scale: str
    million_weights: float
    ms: float
    """Of the network alone, median over pictures."""
    judged: tuple[JudgedVariant, ...]
    """Empty where nothing of that size is trained."""


def backbone_table(backbones: Sequence[Backbone], *, layout: Layout = "markdown") -> str:
    """Table 3: sizes of the network. Accuracy only of trained ones; time needs no training."""
    headings = ["Size", "Weights", "paper ms", "paper e_t mm", "paper e_r deg"]
    headings += ["network ms", "million weights", *(title for *_, title in POSE_COLUMNS)]
    rows: list[list[str]] = []
    for one in backbones:
        ours = [NOT_TRAINED] * len(POSE_COLUMNS)
        if one.judged:
            ours = _ours(one.judged, POSE_COLUMNS)
        trained = ", ".join(dict.fromkeys(v.title for v in one.judged)) or "random, for time alone"
        theirs = _paper_cells(PAPER_BACKBONES.get(one.scale))
        time = [number(one.ms), number(one.million_weights)]
        rows.append([one.scale, trained, *theirs, *time, *ours])
    return laid_out(headings, rows, texts=2, layout=layout)


def _by_title(judged: Sequence[JudgedVariant]) -> dict[str, list[JudgedVariant]]:
    found: dict[str, list[JudgedVariant]] = {}
    for variant in judged:
        found.setdefault(variant.title, []).append(variant)
    return found


def _ours(variants: Sequence[JudgedVariant], columns: Sequence[tuple[str, str, str]]) -> list[str]:
    """Plain means over scenes."""
    return [number(mean(v.report[group].get(key) for v in variants)) for group, key, _ in columns]


def _paper_cells(paper: PaperAblation | None) -> list[str]:
    if paper is None:
        return ["-"] * 3
    return [number(paper.ms), number(paper.e_t_mm), number(paper.e_r_deg)]
