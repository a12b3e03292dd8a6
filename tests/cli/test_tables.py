from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from asdfviz.cli.judged_runs import kept_run
from asdfviz.cli.tables import Tables, condition_folders, knowing_no_loss, without_lost
from asdfviz.data.resources import sample_folder
from asdfviz.data.run_files import save_run
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import FramePrediction, PoseEstimate, Run
from asdfviz.errors import InputError
from asdfviz.methods.registry import find_method
from asdfviz.run import input_hashes, resolved_config


def test_only_the_four_conditions_are_taken(tmp_path: Path) -> None:
    for name in ("clamp/normal/rgb", "clamp/table1/rgb", "vise/hand/rgb", "vise/blur"):
        (tmp_path / name).mkdir(parents=True)
    found = [folder.relative_to(tmp_path).as_posix() for folder in condition_folders(tmp_path)]
    assert found == ["clamp/normal", "vise/hand"]


def test_a_folder_without_sets_and_a_wrong_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="asdfviz synth testset"):
        condition_folders(tmp_path)
    with pytest.raises(InputError, match=r"\.md, \.csv or \.tex"):
        Tables("gbot", tmp_path, out=tmp_path / "table.pdf")()


@pytest.mark.parametrize("name", ["icg", "gbot"])
def test_the_papers_trackers_say_all_their_poses(name: str) -> None:
    spec = find_method(name)
    assert vars(spec.config())["report_lost"] is False
    config = knowing_no_loss(spec)
    assert isinstance(config, spec.config)
    assert vars(config)["report_lost"] is True


def test_a_method_that_knows_no_loss_runs_as_it_is() -> None:
    spec = find_method("asdf")
    assert knowing_no_loss(spec) == spec.config()


def test_poses_that_a_tracker_takes_to_be_lost_are_left_out() -> None:
    spec = find_method("icg")
    poses = {n: PoseEstimate(n, np.eye(4), s, "tracked") for n, s in (("jaw", 0.9), ("bolt", 0.1))}
    run = Run("icg", {}, "scene", "assembly.yaml", "0", (FramePrediction(3, poses, None),))
    told = without_lost(run, knowing_no_loss(spec))
    assert list(told.predictions[0].poses) == ["jaw"]
    assert told.predictions[0].frame_index == 3
    detector = find_method("yolov8pose")
    assert without_lost(run, knowing_no_loss(detector)) is run


def test_table1_counts_the_test_sets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "corner_clamp" / "table1"
    shutil.copytree(sample_folder(), target, ignore=shutil.ignore_patterns("annotations", "runs"))
    Tables("table1", tmp_path)()
    row = capsys.readouterr().out.splitlines()[2]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    frames = len(list((target / "rgb").iterdir()))
    assert cells[:5] == ["corner_clamp", "table1", "CornerClamp", "3", "66"]
    assert cells[5:9] == ["3", "3", "1", str(frames)]


def test_a_kept_run_is_taken_only_with_the_same_config(tmp_path: Path) -> None:
    sequence = open_sequence("sample")
    assert sequence.assembly is not None
    spec = find_method("asdf")
    config = spec.config()
    run = Run(
        "asdf",
        dataclasses.asdict(resolved_config(config, sequence.assembly)),
        sequence.path,
        sequence.assembly.path,
        "0",
        tuple(FramePrediction(index, {}, None) for index in sequence.frame_indices),
        input_hashes(sequence, sequence.assembly, config),
    )
    save_run(run, tmp_path / "kept")
    assert kept_run(tmp_path / "kept", sequence, config) is not None
    other = dataclasses.replace(config, refinement="none")
    assert kept_run(tmp_path / "kept", sequence, other) is None
    assert kept_run(tmp_path / "elsewhere", sequence, config) is None
