"""Tables 1 to 4 of the paper and our own ablations: what stands where."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import FramePrediction, FrameTruth, StateEstimate
from asdfviz.errors import InputError
from asdfviz.evaluate.fusion_study import StudiedRun, fusion_study
from asdfviz.evaluate.paper_ablations import (
    NOT_TRAINED,
    Backbone,
    JudgedVariant,
    backbone_table,
    plain_table,
    refinement_table,
)
from asdfviz.evaluate.paper_layout import laid_out, layout_of
from asdfviz.evaluate.paper_table1 import PAPER_ASSEMBLIES, SetFacts, counterpart, table1
from asdfviz.evaluate.paper_table4 import MEAN, PAPER, JudgedSet, table4
from asdfviz.state.fusion import FusionConfig


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def report(value: float) -> dict[str, Any]:
    class Everything(dict[str, float]):
        def get(self, key: str, default: object = None) -> Any:
            return value

    return {group: Everything() for group in ("mean", "state", "state_offline", "runtime_ms")}


def test_layouts_follow_the_files_ending() -> None:
    assert layout_of(None) == layout_of(Path("a.md")) == "markdown"
    with pytest.raises(InputError, match=r"\.md, \.csv or \.tex"):
        layout_of(Path("a.pdf"))
    cells = (["a_b", "n"], [["x & y", "1"]])
    assert laid_out(*cells, texts=1, layout="markdown").splitlines()[1] == "| --- | ---: |"
    latex = laid_out(*cells, texts=1, layout="latex")
    assert r"x \& y & 1 \\" in latex
    assert r"a\_b" in latex
    assert rows_of(laid_out(*cells, texts=1, layout="csv")) == [{"a_b": "x & y", "n": "1"}]


@pytest.mark.parametrize("name", ["a|b", "a\nb", "a\r\nb", "`a`|", "<a> *b* [c]"])
def test_names_break_no_table(name: str) -> None:
    facts = SetFacts(name, name, 3, 3, 1, 60, 640, 360, 0)
    heading, _, row = table1([facts]).splitlines()
    assert row.count("|") == heading.count("|")
    assert not set("`<>*[") & set(row)
    latex = [line for line in table1([facts], layout="latex").splitlines() if "640" in line]
    assert len(latex) == 1
    assert latex[0].count("|") == latex[0].count("$|$")
    (cells,) = rows_of(table1([facts], layout="csv"))
    assert cells["Assembly"] == name


@pytest.mark.parametrize(
    ("name", "frames"),
    [("corner_clamp", 66), ("gbot_gearedcaliper", 111), ("vise", 191), ("gbot_screwclamp", 231)],
)
def test_ours_stand_beside_the_papers_of_the_same_kind(name: str, frames: int) -> None:
    found = counterpart(name)
    assert found is not None
    assert found.frames == frames
    facts = SetFacts(name, "table1", 3, 3, 1, 60, 640, 360, 0)
    ours, other = rows_of(
        table1([facts, SetFacts(name, "hand", 3, 3, 1, 9, 640, 360, 4)], layout="csv")
    )
    assert (ours["paper frames"], ours["frames"]) == (str(frames), "60")
    assert (other["paper frames"], other["with an error"]) == ("-", "4")
    assert counterpart("toy") is None


def test_the_papers_means_are_those_of_its_rows() -> None:
    rows = [PAPER["asdf", one.title] for one in PAPER_ASSEMBLIES]
    mean = PAPER["asdf", MEAN]
    assert mean.f1 == pytest.approx(np.mean([r.f1 for r in rows]), abs=0.02)
    assert mean.add_s == pytest.approx(np.mean([r.add_s for r in rows]), abs=0.02)
    assert mean.e_t_mm == pytest.approx(np.mean([r.e_t_mm for r in rows]), abs=0.02)
    assert mean.e_r_deg == pytest.approx(np.mean([r.e_r_deg for r in rows]), abs=0.02)


def test_table4_has_a_row_for_every_set_and_their_mean() -> None:
    sets = [
        JudgedSet("asdf", kind, name, report(value), report(value + 1))
        for kind in ("keypoints", "hypotheses")
        for name, value in (("corner_clamp", 60.0), ("vise", 80.0))
    ]
    rows = rows_of(table4(sets, layout="csv"))
    assert [row["Assembly"] for row in rows] == ["corner_clamp", "vise", "mean of 2"] * 2
    theirs = [float(row["paper F1"]) for row in rows[:3]]
    assert theirs == pytest.approx([93.85, 78.95, 79.52], abs=0.06)
    assert rows[2]["gbot F1"] == "70.0"
    assert rows[2]["gbot ADD(S), twins exchanged"] == "70.0"
    assert rows[2]["strict ADD(S) 0.1 d"] == "71.0"
    assert rows[2]["strict state, offline (Viterbi)"] == "71.0"
    assert rows[3]["First pose"] == "hypotheses"


def test_ablations_name_the_papers_rows_and_print_no_accuracy_of_untrained_sizes() -> None:
    judged = [JudgedVariant("shift", "translation", report(v)) for v in (2.0, 4.0)]
    judged.append(JudgedVariant("asdf_plus", "", report(1.0)))
    judged.append(JudgedVariant("masks", "segmentation", report(2.0)))
    shift, plus, masks = rows_of(refinement_table(judged, layout="csv"))
    theirs = [masks[f"paper {key}"] for key in ("n ms", "n e_t mm", "n e_r deg", "x-p6 e_t mm")]
    assert theirs == ["64.5", "8.5", "-", "6.5"]
    assert (shift["Scenes"], shift["paper n e_t mm"], shift["e_t mm"]) == ("2", "8.1", "3.0")
    assert plus["paper n e_t mm"] == "-"
    backbones = [Backbone("n", 3.2, 25.0, tuple(judged[:2])), Backbone("m", 26.0, 200.0, ())]
    small, medium = rows_of(backbone_table(backbones, layout="csv"))
    assert (small["paper e_t mm"], small["e_t mm"], small["Weights"]) == ("29.1", "3.0", "shift")
    assert (medium["network ms"], medium["e_t mm"]) == ("200.0", NOT_TRAINED)
    assert "e_t mm" in plain_table(judged)
    assert "macro F1" not in plain_table(judged, states=False)
    assert "e_t mm" not in plain_table(judged, poses=False)


def test_fusing_anew_gives_every_way_its_row() -> None:
    assembly = load_assembly("corner_clamp")
    count = len(assembly.states)
    true = [0] * 8 + [1] * 8 + [2] * 8
    predictions: list[FramePrediction] = []
    for index, state in enumerate([*true[1:], true[-1]]):
        # In the last frame of a state the next part arrives, which looks as if it were in.
        right = np.full(count, 0.1 / (count - 1))
        right[state] = 0.9
        wrong = np.roll(right, 1)
        # Looks are right, poses wrong now and then.
        places = wrong if index % 8 == 5 else right
        terms = {"appearance": right, "relative_pose": places}
        predictions.append(FramePrediction(index, {}, StateEstimate(places, terms)))
    truth = {i: FrameTruth(i, {}, state, is_error=False) for i, state in enumerate(true)}
    calls: list[tuple[int, int]] = []
    found = fusion_study(
        [StudiedRun(assembly, tuple(predictions), truth, FusionConfig())],
        progress=lambda done, total: calls.append((done, total)),
    )
    accuracy = {variant.title: variant.report["state"]["accuracy"] for variant in found}
    assert accuracy["looks alone, frame by frame"] == pytest.approx(100 * 22 / 24)
    assert accuracy["poses alone, frame by frame"] == pytest.approx(100 * 19 / 24)
    assert accuracy["hidden Markov model, offline"] == 100
    best = next(title for title in accuracy if title.startswith("best of 120"))
    assert accuracy[best] == max(v for k, v in accuracy.items() if k.startswith(("w_", "best")))
    assert calls[-1][0] == calls[-1][1] == len(calls)
