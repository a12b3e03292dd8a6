from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Iterable
from csv import DictReader
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from exits import exit_code

from asdfviz import __version__
from asdfviz.cli.given_runs import given_runs
from asdfviz.cli.judged_runs import judged, kept_run
from asdfviz.cli.tables import Tables, condition_folders, judged_set, knowing_no_loss, without_lost
from asdfviz.data.csv_layout import COLUMNS as CSV_COLUMNS
from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.resources import sample_folder
from asdfviz.data.run_files import save_run
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import FramePrediction, PoseEstimate, Run
from asdfviz.errors import InputError
from asdfviz.methods.network import weights_path
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


def test_what_cannot_be_written_is_told_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "folder.md").mkdir()
    (tmp_path / "file").touch()
    for out in ("folder.md", "file/table.md"):
        with pytest.raises(InputError, match=r"is a (folder|file)"):
            Tables("gbot", tmp_path / "nowhere", out=tmp_path / out)()
    monkeypatch.setattr("asdfviz.cli.tables.made_run", None)
    scene = tmp_path / "corner_clamp" / "normal"
    shutil.copytree(sample_folder(), scene, ignore=shutil.ignore_patterns("annotations", "runs"))
    (scene / "runs").touch()
    with pytest.raises(InputError, match="runs is a file; results need a folder"):
        Tables("gbot", tmp_path, methods=("icg",))()


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


def empty_run(
    sequence: FolderSequence, method: str, frames: Iterable[int], **options: object
) -> Run:
    assert sequence.assembly is not None
    config: Any = dataclasses.replace(find_method(method).config(), **options)
    return Run(
        method,
        dataclasses.asdict(resolved_config(config, sequence.assembly)),
        sequence.path,
        sequence.assembly.path,
        __version__,
        tuple(FramePrediction(index, {}, None) for index in frames),
        input_hashes(sequence, sequence.assembly, config),
    )


def test_a_kept_run_is_taken_only_with_the_same_config_and_version(tmp_path: Path) -> None:
    sequence = open_sequence("sample")
    config = find_method("asdf").config()
    run = empty_run(sequence, "asdf", sequence.frame_indices)
    save_run(run, tmp_path / "kept")
    save_run(dataclasses.replace(run, version="0.0.9"), tmp_path / "older")
    assert kept_run(tmp_path / "older", sequence, config) is None
    assert kept_run(tmp_path / "kept", sequence, config) is not None
    other = dataclasses.replace(config, refinement="none")
    assert kept_run(tmp_path / "kept", sequence, other) is None
    assert kept_run(tmp_path / "elsewhere", sequence, config) is None


def test_a_kept_run_is_taken_wherever_the_same_weights_lie(tmp_path: Path) -> None:
    sequence = open_sequence("sample")
    assert sequence.assembly is not None
    config: Any = find_method("asdf").config()
    save_run(empty_run(sequence, "asdf", sequence.frame_indices), tmp_path / "kept")
    ours = weights_path(config.detector, sequence.assembly)
    moved = tmp_path / ours.name
    shutil.copy(ours, moved)
    there = dataclasses.replace(
        config, detector=dataclasses.replace(config.detector, weights=moved)
    )
    assert kept_run(tmp_path / "kept", sequence, there) is not None
    moved.write_bytes(b"others")
    assert kept_run(tmp_path / "kept", sequence, there) is None


def test_a_kept_run_of_other_weighting_is_not_taken(tmp_path: Path) -> None:
    sequence = open_sequence("sample")
    config: Any = find_method("asdf").config()
    save_run(empty_run(sequence, "asdf", sequence.frame_indices), tmp_path / "kept")
    uniform = dataclasses.replace(config.translation, weights="uniform")
    other = dataclasses.replace(config, translation=uniform)
    assert kept_run(tmp_path / "kept", sequence, other) is None


@pytest.mark.parametrize(
    ("initial", "first_pose", "told"),
    [
        ("first_frame_truth", None, "truth"),
        ("first_frame_truth", "keypoints", "truth, keypoints"),
        ("none", "keypoints", "keypoints"),
        ("none", None, "-"),
    ],
)
def test_table4_tells_what_was_given_the_first_frames_truth(
    initial: Literal["none", "first_frame_truth"], first_pose: str | None, told: str
) -> None:
    sequence = open_sequence("sample")
    run = dataclasses.replace(empty_run(sequence, "icg", range(3)), initial=initial)
    found = judged(run, sequence, option="--models")
    assert judged_set(found, first_pose).first_pose == told


FRAMES = len(json.loads((sample_folder() / "scene_gt.json").read_text()))
POSED = 12


def written_csv(file: Path, scenes: dict[str, int]) -> Path:
    """The sample's truth 5 mm too far right, in BOP's layout; of each scene so many frames."""
    truth: dict[str, Any] = json.loads((sample_folder() / "scene_gt.json").read_text())
    rows = [",".join(CSV_COLUMNS)]
    for scene, count in scenes.items():
        for frame in [*truth][:count]:
            for entry in truth[frame]:
                R, (x, y, z) = " ".join(map(str, entry["cam_R_m2c"])), entry["cam_t_m2c"]
                rows.append(f"{scene},{frame},{entry['obj_id']},0.5,{R},{x + 5} {y} {z},0.02")
    file.write_text("\n".join(rows) + "\n")
    return file


KINDS = ("keypoints", "hypotheses")


@pytest.fixture(scope="module")
def testsets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two of GBOT's sets and Table 1's, with runs there that found nothing."""
    data = tmp_path_factory.mktemp("testsets")
    for name, number in (("normal", 5), ("hand", 5), ("table1", 4)):
        kept = {f"table{number}-asdf-{kind}": kind for kind in KINDS}
        folder = data / "corner_clamp" / name
        shutil.copytree(sample_folder(), folder, ignore=shutil.ignore_patterns("annotations"))
        sequence = open_sequence(folder)
        for run, kind in kept.items():
            empty = empty_run(sequence, "asdf", sequence.frame_indices, first_pose=kind)
            save_run(empty, folder / "runs" / run)
    return data


def table(data: Path, kind: str, *runs: Path) -> list[dict[str, str]]:
    out = data.parent / f"{kind}.csv"
    named = ("--methods", "asdf", "--runs", *map(str, runs))
    assert exit_code("tables", kind, "--data", str(data), "--out", str(out), *named) == 0
    return list(DictReader(out.read_text().splitlines()))


def test_results_made_elsewhere_are_rows_beside_ours(
    testsets: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sequence = open_sequence(testsets / "corner_clamp" / "normal")
    save_run(empty_run(sequence, "asdf", range(1, 3)), tmp_path / "again")
    csv = written_csv(
        tmp_path / "mine.csv", {"corner_clamp/normal": FRAMES, "hand": POSED, "moon": 1}
    )
    rows = table(testsets, "gbot", csv, tmp_path / "again")
    assert [(row["Method"], row["First pose"]) for row in rows[:4]] == [
        *(("ASDF", kind) for kind in KINDS),
        ("asdf (again)", "hypotheses"),
        ("mine", "-"),
    ]
    assert [row["Sequences"] for row in rows[:2]] == ["2", "2"]
    assert [row["paper ADD(S)"] for row in rows[:2]] == ["95.8", "95.8"]
    means = {row["Method"]: row for row in rows[:4]}
    assert means["asdf (again)"]["Sequences"] == f"1 (2/{FRAMES} frames)"
    assert means["mine"]["Sequences"] == f"2 ({FRAMES + POSED}/{2 * FRAMES} frames)"
    assert means["mine"]["gbot e_t mm"] == means["mine"]["strict e_t mm"] == "5.0"
    assert means["mine"]["paper ADD(S)"] == "-"
    assert means["mine"]["ms a frame"] == "20.0"
    assert [row["Sequences"] for row in rows if row["Method"] == "mine"][1:] == [
        "corner_clamp/normal",
        f"corner_clamp/hand ({POSED}/{FRAMES} frames)",
    ]
    said = capsys.readouterr().err
    assert "scenes that are not of this table: moon" in said
    assert f"only {POSED} of {FRAMES} frames have rows" in said


def test_results_made_elsewhere_are_rows_of_table_4(testsets: Path, tmp_path: Path) -> None:
    csv = written_csv(tmp_path / "mine.csv", {"corner_clamp": FRAMES})
    last = table(testsets, "table4", csv)[-2:]
    assert [(row["Method"], row["First pose"]) for row in last] == [("mine", "-")] * 2
    assert [row["Assembly"] for row in last] == ["corner_clamp", "mean of 1"]
    assert last[0]["strict e_t mm"] == "5.0"
    assert last[0]["gbot F1"] == "-"  # a csv says no states


def test_a_csv_in_a_scenes_folder_is_of_that_scene(testsets: Path) -> None:
    sequences = [open_sequence(testsets / "corner_clamp" / name) for name in ("normal", "hand")]
    csv = written_csv(testsets / "corner_clamp" / "hand" / "runs" / "mine.csv", {"1": POSED})
    (one,) = given_runs([csv], sequences, taken=())
    assert one.sequence is sequences[1]
    assert one.run.method == "mine"


def test_results_of_no_scene_of_the_table_are_refused(
    testsets: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, csv = tmp_path / "run", written_csv(tmp_path / "mine.csv", {"1": POSED, "2": POSED})
    save_run(empty_run(open_sequence("sample"), "asdf", [1]), run)
    line = ("tables", "gbot", "--data", str(testsets), "--methods", "asdf", "--runs")
    for given, said in (
        (run, f"{run} is a run on {sample_folder()}, which is no scene of this table; it has"),
        (csv, f"{csv} has rows of the scene 1, 2, which is none of this table: call it as here"),
        (tmp_path / "none.csv", "there is no file"),
    ):
        assert exit_code(*line, str(given)) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1
        assert given.name == "none.csv" or "corner_clamp/normal, corner_clamp/hand" in error
    assert exit_code("tables", "table1", "--data", str(testsets), "--runs", str(run)) == 2
    assert "leave out --runs" in capsys.readouterr().err
