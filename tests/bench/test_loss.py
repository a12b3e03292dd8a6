from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from asdfviz.bench.loss import told_apart
from asdfviz.cli.bench import BenchLoss
from asdfviz.data.run_files import save_run
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import FramePrediction, PoseEstimate, Run
from asdfviz.errors import InputError
from asdfviz.geometry.transforms import transform_from


def test_what_is_neither_right_nor_lost_is_left_out() -> None:
    given = [(0.9, 0.01), (0.8, 0.07), (0.3, 0.2), (0.2, 0.049)]
    assert told_apart(given) == [(0.9, True), (0.3, False), (0.2, True)]


def _run(folder: Path, *, metres: float, score: float) -> Path:
    """A run of the sample's first frames whose poses are all off by so much."""
    sequence = open_sequence("sample")
    assembly = sequence.assembly
    assert assembly is not None
    shift = transform_from(np.eye(3), np.array([metres, 0.0, 0.0]))
    said: list[FramePrediction] = []
    for place in range(3):
        truth = sequence.truth(place)
        assert truth is not None
        poses = {
            n: PoseEstimate(n, shift @ T, score, "tracked") for n, T in truth.T_camera_part.items()
        }
        said.append(FramePrediction(truth.frame_index, poses, None))
    save_run(Run("icg", {}, sequence.path, assembly.path, "0", tuple(said)), folder)
    return folder


@pytest.mark.parametrize(("sure_of_lost", "area"), [(0.1, 100.0), (0.95, 0.0)])
def test_runs_are_judged_together(
    sure_of_lost: float, area: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = (
        _run(tmp_path / "right", metres=0.0, score=0.9),
        _run(tmp_path / "lost", metres=0.1, score=sure_of_lost),
    )
    BenchLoss(folders, json=True)()
    figures = json.loads(capsys.readouterr().out)
    assert figures["loss_auc"] == pytest.approx(area)
    assert figures["right"] == figures["lost"] > 0
    assert figures["loss_auc_twins"] == figures["loss_auc"], "the corner clamp has no twins"
    BenchLoss(folders)()
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"AUC {area:.1f} %")


def test_where_nothing_can_be_told_apart_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name at least one run"):
        BenchLoss(())()
    right = _run(tmp_path / "right", metres=0.0, score=0.9)
    with pytest.raises(InputError, match=r"[1-9] are right and 0 are lost.*--report-lost"):
        BenchLoss((right,))()
    with pytest.raises(InputError, match="0 are right and 0 are lost"):
        BenchLoss((right,), visible=1.5, json=True)()
