"""States decoded offline are judged apart, and only of runs that keep what it takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth, Run, StateEstimate
from asdfviz.evaluate.evaluate import evaluate_run
from asdfviz.evaluate.report_tables import Row, states_rows
from asdfviz.evaluate.summary import summaries
from asdfviz.evaluate.tables import markdown_table, means_table
from asdfviz.evaluate.terminal_table import means_summary, runs_summary
from asdfviz.state.smoothing import FOLLOWED, StateFilter

TRUTH = [0] * 21 + [1] * 9
SEEN = [0] * 6 + [1] * 4 + [0] * 10 + [1] * 10
MakeRun = Callable[..., Run]
OPTIONS: Mapping[str, object] = {"smoothing": dataclasses.asdict(FOLLOWED)}


@pytest.fixture
def run(assembly: Assembly, make_run: MakeRun) -> Run:
    """Four frames show the state after the step long before it is done; in the frame before that its part arrives."""
    model, predictions = StateFilter(assembly, config=FOLLOWED), list[FramePrediction]()
    for i, state in enumerate(SEEN):
        term = np.full(4, 0.1)
        term[state] = 0.7
        belief = model.step(None, term, term, term)
        assert belief is not None
        terms: dict[str, np.ndarray] = dict.fromkeys(
            ("relative_pose", "group_fit", "place_looks"), term
        )
        predictions.append(FramePrediction(i, {}, StateEstimate(belief, terms)))
    return make_run(predictions, config=OPTIONS, method="asdf_plus")


def judged(run: Run, assembly: Assembly) -> dict[str, Any]:
    truth = {i: FrameTruth(i, {}, state, False) for i, state in enumerate(TRUTH)}
    return evaluate_run(run, assembly=assembly, truth=truth)


def test_offline_figures_stand_apart(run: Run, assembly: Assembly) -> None:
    report = judged(run, assembly)
    assert report["state_offline"]["accuracy"] == 100
    assert report["state_offline"]["ece"] is None
    assert report["state_offline"].keys() == report["state"].keys()
    assert report["state"]["accuracy"] < 90
    assert (
        report["state"]["accuracy"]
        == judged(dataclasses.replace(run, config={}), assembly)["state"]["accuracy"]
    )
    online, offline = markdown_table([report]).splitlines()[2:]
    assert "offline (Viterbi)" in offline
    assert " 100.0 |" in offline
    assert "offline" not in online
    lines = runs_summary([report], width=80).splitlines()
    assert lines[3].split()[0] == "offline"
    assert lines[3].split()[-1] == "100.0"
    assert "Viterbi" in lines[-1]
    said = states_rows(Row("asdf_plus", None, "scene", report))
    assert [row.is_comparable for row in said] == [True, False]


def test_means_are_of_runs_that_all_have_offline_states(run: Run, assembly: Assembly) -> None:
    report = judged(run, assembly)
    both = summaries([report, report])
    assert both[0]["plain"]["state_offline"]["accuracy"] == 100
    assert means_table(both).count("offline") == 2
    assert means_summary(both, width=80).count("  offline") == 2
    without = judged(dataclasses.replace(run, config={}), assembly)
    assert "state_offline" not in without
    assert "state_offline" not in summaries([report, without])[0]["plain"]


@pytest.mark.parametrize(
    "config",
    [
        {},
        {"smoothing": 3},
        {"smoothing": {"stay": 2.0}},
        {"smoothing": {"stays": 0.5}},
        {"smoothing": {**dataclasses.asdict(FOLLOWED), "stay": 0.5}},
    ],
)
def test_a_model_that_is_not_the_runs_gives_no_offline_figures(
    run: Run, assembly: Assembly, config: Mapping[str, object]
) -> None:
    assert "state_offline" not in judged(dataclasses.replace(run, config=config), assembly)


def test_a_run_of_pose2state_is_decoded_from_its_terms(run: Run, assembly: Assembly) -> None:
    fused = judged(dataclasses.replace(run, config={"fusion": {}}), assembly)
    assert fused["state_offline"]["accuracy"] == 100
