from __future__ import annotations

import csv
import io
from typing import Any

import pytest

from asdfviz.evaluate.paper_table5 import HEADINGS, METHODS, PAPER, JudgedRun, table5
from asdfviz.evaluate.protocols import TWINS


def judged(
    method: str,
    sequence: str,
    *,
    gbot: float,
    strict: float | None,
    ms: float = 10.0,
    first_pose: str = "-",
) -> JudgedRun:
    def report(value: float | None) -> dict[str, Any]:
        keys = ("add_s_10cm", "add_s_01d", "e_t_mm", "e_r_deg", "e_r_sym_deg")
        means = dict.fromkeys(keys, value)
        exchanged = None if value is None else value + 3
        means |= {f"{key}{TWINS}": exchanged for key in keys if key != "e_r_deg"}
        return {"mean": means, "runtime_ms": {"total_median": ms}}

    initial = "none" if method.startswith("asdf") else "first_frame_truth"
    reports = (report(gbot), report(gbot + 5), report(strict))
    return JudgedRun(method, first_pose, sequence, initial, *reports)


RUNS = [
    judged("asdf_track", "clamp/hand", gbot=90.0, strict=80.0),
    judged("icg", "clamp/normal", gbot=80.0, strict=70.0, ms=4.0),
    judged("icg", "clamp/hand", gbot=40.0, strict=None, ms=8.0),
    judged("my_own", "clamp/hand", gbot=1.0, strict=2.0),
]


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_means_stand_beside_the_papers_figures() -> None:
    rows = rows_of(table5(RUNS, layout="csv"))
    assert [row["Method"] for row in rows[:3]] == ["ICG", "asdf_track", "my_own"]
    icg, ours = rows[0], rows[1]
    assert icg["paper ADD(S)"] == "91.3"
    assert icg["gbot ADD(S)"] == "60.0"
    assert icg["gbot ADD(S), twins exchanged"] == icg["gbot e_t mm, twins exchanged"] == "63.0"
    assert icg["strict ADD(S) 0.1 d, twins exchanged"] == "73.0"
    assert (icg["kept ADD(S)"], icg["kept e_t mm"]) == ("65.0", "65.0")
    assert icg["strict ADD(S) 0.1 d"] == "70.0"  # what is not defined does not count
    assert (icg["Start"], icg["Sequences"], icg["ms a frame"]) == ("truth", "2", "6.0")
    assert (ours["Start"], ours["paper ADD(S)"]) == ("none", "-")
    # Then every sequence by itself.
    assert [row["Sequences"] for row in rows[3:]] == [run.sequence for run in RUNS]
    assert rows[5]["strict e_t mm"] == "-"
    assert {row["paper ADD(S)"] for row in rows[3:]} == {"-"}  # the paper's are means


def test_the_layouts_hold_the_same_cells() -> None:
    markdown = table5(RUNS).splitlines()
    assert [cell.strip() for cell in markdown[0].strip("|").split("|")] == list(HEADINGS)
    assert len(markdown) == 2 + 3
    latex = table5(RUNS, layout="latex")
    assert latex.count(r"\\") == 1 + 3
    assert r"asdf\_track & - & none & 1" in latex


def test_each_kind_of_first_pose_has_a_row_beside_the_papers_figures() -> None:
    runs = [
        judged("asdf_track", "clamp/hand", gbot=90.0, strict=80.0, first_pose="keypoints"),
        judged("asdf", "clamp/hand", gbot=60.0, strict=50.0, first_pose="keypoints"),
        judged("asdf", "clamp/hand", gbot=70.0, strict=60.0, first_pose="hypotheses"),
        judged("asdf", "vise/hand", gbot=80.0, strict=70.0, first_pose="keypoints"),
    ]
    rows = rows_of(table5(runs, layout="csv"))[:3]
    assert [(row["Method"], row["First pose"], row["Sequences"]) for row in rows] == [
        ("ASDF", "keypoints", "2"),
        ("ASDF", "hypotheses", "1"),
        ("asdf_track", "keypoints", "1"),
    ]
    assert [row["gbot ADD(S)"] for row in rows] == ["70.0", "70.0", "90.0"]
    assert [row["paper ADD(S)"] for row in rows] == ["95.8", "95.8", "-"]


@pytest.mark.parametrize("method", PAPER)
def test_the_papers_rows_are_whole(method: str) -> None:
    row = PAPER[method]
    assert 80 < row.add_s < 96
    assert 8 < row.e_r_deg < 20
    assert 17 <= row.e_t_mm <= 93
    assert METHODS[-1] == "asdf_track"
