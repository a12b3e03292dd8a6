"""`asdfviz evaluate` and `asdfviz report` on results made elsewhere, from the command line."""

from __future__ import annotations

import io
import json
import sys
from csv import DictReader
from pathlib import Path
from typing import Any

import pytest
from exits import exit_code

from asdfviz.data.resources import sample_folder
from asdfviz.data.run_files import save_run
from asdfviz.datatypes import Run

POSED = 12
"""Frames of the sample that the csv has poses for: as many as show that it is read."""


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    """The sample's own truth in GBOT's layout, 5 mm too far right, and another scene's rows."""
    truth: dict[str, Any] = json.loads((sample_folder() / "scene_gt.json").read_text())
    rows: list[str] = ["elsewhere,000001,base,-1,1 0 0 0 1 0 0 0 1,1 2 500,3"]
    for frame, entries in truth.items():
        for entry in entries:
            R = " ".join(map(str, entry["cam_R_m2c"]))
            x, y, z = entry["cam_t_m2c"]
            if 0 < int(frame) <= POSED:
                rows.append(f"sample,{int(frame):06d},{entry['obj_id']},-1,{R},{x + 5} {y} {z},12")
    file = tmp_path / "theirs.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def test_a_csv_is_judged_like_a_run(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("evaluate", str(csv), "--sequence", "sample", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["method"], said["sequence"], said["protocol"]) == ("theirs", "sample", "strict")
    frames = len(json.loads((sample_folder() / "scene_gt.json").read_text()))
    assert said["n_frames"] == frames - 1  # the first one was given
    assert "theirs.csv has no header and was read as GBOT's" in said["warnings"][0]
    assert said["n_frames_in_run"] == POSED
    assert said["mean"]["e_t_mm"] == pytest.approx(5)
    assert said["parts"]["base"]["n_poses"] == POSED
    assert said["parts"]["base"]["add_s_10cm"] == pytest.approx(100 * POSED / (frames - 1))
    assert said["runtime_ms"]["total_median"] == pytest.approx(12)
    assert said["mean"]["ar_bop"] is None
    assert set(said["state"].values()) == {None}


def test_what_a_terminal_cannot_show_ends_nothing(
    csv: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding="ascii"))
    assert exit_code("evaluate", str(csv), "--sequence", "sample", "--format", "md") == 0
    assert rb"e_r [\xb0]" in shown.getvalue()


def test_several_runs_and_their_means(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    both = ("evaluate", str(csv), str(csv), "--sequence", "sample", "--protocol", "gbot")
    assert exit_code(*both, "--summary") == 0
    said = capsys.readouterr()
    assert list(summary := json.loads(said.out)) == ["runs", "means"]
    assert len(summary["runs"]) == summary["means"][0]["n_runs"] == 2
    assert summary["means"][0]["plain"]["mean"]["e_t_mm"] == pytest.approx(5)
    assert "by frames" in said.err


def test_runs_of_one_method_are_rows_and_means_of_their_own(
    csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "new").mkdir()
    other = tmp_path / "new" / csv.name
    other.write_bytes(csv.read_bytes())
    both = ("evaluate", str(csv), str(other), "--sequence", "sample", "--json", "--summary")
    assert exit_code(*both) == 0
    said = json.loads(capsys.readouterr().out)
    names = [f"theirs ({csv.parent.name}/theirs.csv)", "theirs (new/theirs.csv)"]
    assert [run["method"] for run in said["runs"]] == names
    assert [(mean["method"], mean["n_runs"]) for mean in said["means"]] == [(n, 1) for n in names]


def test_a_terminal_is_shown_a_table_and_no_json(
    csv: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    line = ("evaluate", str(csv), "--sequence", "sample")
    assert exit_code(*line) == 0
    shown = capsys.readouterr().out
    assert "{" not in shown
    assert max(map(len, shown.splitlines())) <= 100
    heads, _, row = shown.splitlines()[:3]
    assert row.split()[:4] == ["theirs", "truth", "sample", f"{POSED}/94"]
    assert "5.0" in row.split()
    assert "state" not in heads  # a csv says none
    assert "-" not in row.split()
    assert "read as GBOT's" in shown
    assert exit_code(*line, "--json") == 0
    assert json.loads(capsys.readouterr().out)["mean"]["e_t_mm"] == pytest.approx(5)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: False)
    assert exit_code(*line) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["mean"]["e_t_mm"] == pytest.approx(5)
    assert row in said.err


def test_runs_as_a_table_of_a_form(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ("evaluate", str(csv), str(csv), "--sequence", "sample")
    assert exit_code(*line, "--format", "csv") == 0
    said = capsys.readouterr()
    rows = list(DictReader(said.out.splitlines()))
    assert [(row["Method"], row["e_t [mm]"], row["state [%]"]) for row in rows] == [
        ("theirs", "5.0", "-")
    ] * 2
    assert said.err.count("warning: theirs: ") == 4
    assert exit_code(*line, "--format", "latex") == 0
    latex = capsys.readouterr().out
    assert r"theirs & truth & sample & strict & 12/94 &" in latex
    assert r"ADD(S) $<$ 0.1 d [\%]" in latex
    assert "state" not in latex
    assert exit_code(*line, "--format", "md") == 0
    assert "| theirs | truth | sample   | strict   |" in capsys.readouterr().out
    assert exit_code(*line, "--format", "csv", "--summary") == 0
    means = list(DictReader(capsys.readouterr().out.splitlines()))
    assert [(row["Mean"], row["Runs"], row["e_t [mm]"]) for row in means] == [
        ("plain", "2", "5.0"),
        ("by frames", "2", "5.0"),
    ]
    assert exit_code(*line, "--format", "csv", "--json") == 2
    assert "--json and --format csv are two outputs" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [((), "--sequence"), (("--sequence", "sample", "--scene", "moon"), "no scene 'moon'")],
)
def test_a_csv_that_lacks_something(
    options: tuple[str, ...], said: str, csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code("evaluate", str(csv), *options) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("command", ["evaluate", "report"])
@pytest.mark.parametrize("option", ["--sequence", "--scene"])
def test_a_run_folder_is_not_told_its_frames(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = tmp_path / "run", tmp_path / "report.html"
    sample = str(sample_folder())
    save_run(Run("mine", {}, sample, "corner_clamp", "0", ()), run)
    page = ("-o", str(out)) if command == "report" else ()
    assert exit_code(command, str(run), option, "sample", *page) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {option} is for csv files, and {run} is a run folder")
    assert "--truth" in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_report(csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("report", "--help") == 0
    assert "Example: asdfviz report" in capsys.readouterr().out
    out = tmp_path / "new" / "report.html"
    options = ("--sequence", "sample", "--pictures", "1")
    assert exit_code("report", str(csv), "-o", str(out), *options) == 0
    assert capsys.readouterr().out == f"{out}\n"
    page = out.read_text()
    assert "theirs on sample" in page
    assert "The run says no states." in page
    assert page.count("data:image/jpeg") == 1
    assert len(page) < 3_000_000
    assert exit_code("report", str(tmp_path / "nowhere")) == 2
    assert "nowhere" in capsys.readouterr().err


def test_a_page_replaces_no_file_of_another_kind(
    csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = csv.read_text()
    for out in (csv, tmp_path / "000040.jpg", tmp_path):
        assert exit_code("report", str(csv), "-o", str(out), "--sequence", "sample") == 2
        assert "ends in .html" in capsys.readouterr().err
    assert csv.read_text() == before


def test_results_of_something_else_are_doubted(
    csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = csv.read_text().splitlines()[1:]
    in_metres: list[str] = []
    for row in rows:
        cells = row.split(",")
        cells[5] = " ".join(str(float(mm) / 1000) for mm in cells[5].split())
        in_metres.append(",".join(cells))
    stranger = [rows[0].replace(f",{rows[0].split(',')[2]},", ",77,")]
    csv.write_text("\n".join([*in_metres, *stranger]) + "\n")
    assert exit_code("evaluate", str(csv), "--sequence", "sample", "--json") == 0
    warnings = "\n".join(json.loads(capsys.readouterr().out)["warnings"])
    assert "1 rows are of objects that the assembly does not have" in warnings
    assert "0.001 times as far from the camera as the truth: are they in another unit?" in warnings
