"""The command line: help with examples, exit codes, and the README's own commands."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
import trimesh
from exits import exit_code

from asdfviz.annotate.identity import open_annotation
from asdfviz.annotate.records import Seed
from asdfviz.cli.run import method_apart
from asdfviz.cli.synth_images import SynthPacks
from asdfviz.data.assembly import load_assembly
from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.resources import models_folder, sample_folder
from asdfviz.data.result_csv import read_result_csv
from asdfviz.data.run_files import check_run_folder, load_run, save_run
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly, FramePrediction, PoseEstimate, Run, Stage
from asdfviz.errors import RenderError
from asdfviz.evaluate.health_report import Finding, HealthReport, Kind, Severity
from asdfviz.methods.following import FollowConfig
from asdfviz.methods.icg import IcgConfig
from asdfviz.synth.packs import PackConfig

README = Path(__file__).resolve().parents[2] / "README.md"
COMMANDS = (
    "view",
    "run",
    "evaluate",
    "agree",
    "report",
    "tables",
    "ablate",
    "check",
    "methods",
    "synth",
    "train",
    "train-crops",
    "train-states",
    "train-masks",
    "import-gbot",
    "export",
    "bench",
)
FIRST_OF = {"synth": "images", "bench": "track"}
"""Commands with a level below them."""


def test_the_shares_of_a_crop_training_are_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("train-crops", "--assembly", "corner_clamp", "--out", str(tmp_path))
    assert exit_code(*given, "--empty-share", "2") == 2
    assert "empty_share is 2, give one from 0 to below 1" in capsys.readouterr().err


def test_frames_that_a_training_leaves_out_are_told_before_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene"
    scene.mkdir()
    (scene / "scene_gt.json").write_text('{"3": []}')
    (scene / "unchecked.json").write_text('{"3": ["jaw"]}')
    own = ("--assembly", "corner_clamp", "--out", str(tmp_path / "out"))
    crops = ("train-crops", "--validation", str(scene), "--empty-share", "2")
    states = ("train-states", "--validation", str(scene), "--scene-share", "2")
    for asked in (("train", "--data", str(scene)), crops, states):
        assert exit_code(*asked, *own) == 2
        note, error = capsys.readouterr().err.strip().splitlines()
        assert note.startswith(f"note: 1 frame of {scene} left out, with parts that nobody checked")
        assert error.startswith("error: ")


def test_nothing_is_trained_into_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene"
    (scene / "rgb").mkdir(parents=True)
    own = ("--assembly", "corner_clamp", "--out", str(scene))
    for asked in (
        ("train", "--data", str(scene)),
        ("train-crops",),
        ("train-states",),
        ("train-masks", "--data", str(scene)),
    ):
        assert exit_code(*asked, *own) == 2
        assert f"error: {scene} is a recording itself (it has rgb)" in capsys.readouterr().err
    assert [file.name for file in scene.iterdir()] == ["rgb"]


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(command, "--help") == 0
    shown = capsys.readouterr().out
    if command in FIRST_OF:
        assert exit_code(command, FIRST_OF[command], "--help") == 0
        shown = capsys.readouterr().out
    assert f"Example: asdfviz {command}" in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("check", "no/such/folder"), "no/such/folder"),
        (("run", "no/such/folder", "--method", "asdf"), "no/such/folder"),
        (("run", "sample", "--method", "nonsense"), "nonsense"),
        (("run", "sample", "--method", "asdf", "--assembly", "nowhere"), "nowhere"),
        (("evaluate", "no/such/run"), "no/such/run"),
        (("evaluate",), "run"),
        (("agree", "no/such/run"), "no/such/run"),
        (("agree", "no/such/run", "--count", "0"), "--count"),
        (("import-gbot", "no/such/folder", "--out", "x"), "no/such/folder"),
        (("methods", "--surprise"), "--surprise"),
    ],
)
def test_bad_input_exits_2_with_one_line(
    arguments: tuple[str, ...],
    said: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code(*arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


def test_the_help_of_run_shows_the_options_of_the_method(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert exit_code("run", "--method", "asdf", "--help") == 0
    shown = capsys.readouterr().out
    assert "Example: asdfviz run" in shown
    assert "--detector.confidence" in shown
    assert "--fusion.w-dl" in shown
    assert exit_code("run", "--method", "asdf_track", "--help") == 0
    assert "--fusion" not in capsys.readouterr().out
    assert exit_code("run", "--method", "nonsense", "--help") == 2
    assert "no method 'nonsense'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "--method icg --report-lost {s} --out {o}",
        "--report-lost --method=icg --out={o} {s}",
        "{s} --follow.margin 0.03 --out {o} --report-lost -m icg",
        "--out {o} --follow.margin=0.03 --report-lost {s} --format folder --method icg",
    ],
)
def test_a_method_s_options_stand_anywhere(line: str) -> None:
    words = ["run", *line.format(s="scene", o="runs/x").split()]
    kept, chosen = method_apart(words)
    assert chosen is not None
    spec, config = chosen
    assert spec.name == "icg"
    assert isinstance(config, IcgConfig)
    assert config.report_lost
    assert config.follow.margin == (0.03 if "margin" in line else FollowConfig().margin)
    own = [word for word in kept[1:] if not word.startswith("-")]
    assert "scene" in own
    assert "--report-lost" not in kept
    assert not any("margin" in word for word in kept)


def test_an_option_that_no_method_has_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("run", "--method", "icg", "--report-list", "sample") == 2
    error = capsys.readouterr().err
    assert "--report-list" in error
    assert "asdfviz run --method icg" in error


def test_a_file_where_results_should_go_is_said_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    out = ("--out", str(file))
    images = ("synth", "images", "--assembly", "corner_clamp")
    for arguments in (("run", "sample", "--method", "asdf"), images):
        assert exit_code(*arguments, *out) == 2
        assert "notes.txt is a file; results need a folder" in capsys.readouterr().err
    assert exit_code(*images, "--device", "toaster", "--out", str(tmp_path / "new")) == 2
    assert "device 'toaster' cannot be used here" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_packs_are_drawn_as_asked_and_else_as_the_library_does(tmp_path: Path) -> None:
    assert SynthPacks("corner_clamp", tmp_path).config() == PackConfig()
    asked = SynthPacks("corner_clamp", tmp_path, groups=0.8, sizes_px=(52.0, 180.0), width=320)
    assert asked.config() == PackConfig(width=320, groups=0.8, sizes_px=(52.0, 180.0))


@pytest.mark.parametrize("kind", ["images", "packs", "sequence"])
def test_photos_that_are_not_there_are_said_before_a_folder_is_begun(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    line = ("synth", kind, "--assembly", "corner_clamp", "--out", str(tmp_path / "new"))
    assert exit_code(*line, "--grounds", str(tmp_path / "bench")) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "bench is no folder; give one with photos of your empty table" in said
    assert not (tmp_path / "new" / "sequence.json").exists()


@pytest.mark.parametrize(
    ("kind", "option", "value"),
    [
        ("images", "--ground-width", "-1"),
        ("packs", "--ground-share", "0.2"),
        ("sequence", "--ground-width", "1.2"),
    ],
)
def test_what_is_said_of_photos_is_refused_where_there_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, option: str, value: str
) -> None:
    line = ("synth", kind, "--assembly", "corner_clamp", "--out", str(tmp_path / "new"))
    assert exit_code(*line, option, value, "--width", "1") == 2
    said = capsys.readouterr().err
    assert said.startswith(
        f"error: {option} {value} has no effect without photos: name their folder"
    )
    assert said.count("\n") == 1
    assert not (tmp_path / "new" / "sequence.json").exists()


@pytest.mark.parametrize(
    ("seed", "said"), [("-5", "seed is -5, use 0 or more"), ("7000000", "belongs to test sets")]
)
def test_a_sequence_takes_no_seed_that_is_none_or_a_test_set_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: str, said: str
) -> None:
    line = ("synth", "sequence", "--assembly", "corner_clamp", "--out", str(tmp_path / "new"))
    assert exit_code(*line, "--seed", seed, "--width", "1") == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_a_sequence_of_too_few_frames_is_refused_before_it_is_begun(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asdfviz.synth.sequences.load_assets", lambda *_, **__: None)
    play = SimpleNamespace(moments=[None] * 51)
    monkeypatch.setattr("asdfviz.synth.sequences.plan_sequence", lambda *_, **__: play)
    line = ("synth", "sequence", "--assembly", "corner_clamp", "--frames", "1", "--out")
    for out in (tmp_path, tmp_path / "new"):  # what was there stays
        assert exit_code(*line, str(out)) == 2
        assert capsys.readouterr().err.startswith("error: frames is 1, use 51 or more: ")
        assert not list(tmp_path.iterdir())


def test_the_readme_s_own_method_runs_as_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = README.read_text()
    indented = re.search(r"^    # mine\.py\n.*?^    SPEC = .*?$", readme, re.M | re.S)
    assert indented is not None
    assert all(f"`{stage}`" in readme for stage in get_args(Stage))
    file = tmp_path / "mine.py"
    file.write_text(textwrap.dedent(indented.group()))
    out = tmp_path / "run"
    line = ("run", "--method", f"{file}:SPEC", "sample", "--distance", "0.6", "--out", str(out))
    assert exit_code(*line) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert exit_code("evaluate", str(out), "--json") == 0
    said = capsys.readouterr()
    report = json.loads(said.out)
    assert said.err == ""
    assert "warnings" not in report
    posed = [name for name, figures in report["parts"].items() if figures["n_poses"]]
    assert posed == [load_assembly("corner_clamp").base]
    assert report["state"]["accuracy"] is not None
    assert exit_code("agree", str(out), "--json", "--no-register") == 0
    pooled = json.loads(capsys.readouterr().out)["pooled"]
    assert pooled["frames"] == 95
    assert pooled["residual_mm_median"] < 100  # the base is put among the depth that was measured


def test_the_readme_s_script_runs_as_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    indented = re.search(r"^    # poses\.py\n.*?^    save_run.*?$", README.read_text(), re.M | re.S)
    assert indented is not None
    monkeypatch.chdir(tmp_path)
    exec(textwrap.dedent(indented.group()), {})
    said = capsys.readouterr().out.splitlines()
    assert "0 base" in said
    assert sum(line.startswith("jaw 0.") for line in said) == 3
    assert exit_code("evaluate", "my_run", "--json") == 0


FAILING = """
from dataclasses import dataclass
from asdfviz.datatypes import FramePrediction
from asdfviz.methods.spec import MethodSpec

@dataclass(frozen=True)
class Config:
    lasts: int = 3

class Tired:
    def __init__(self, config): self.left = config.lasts
    def reset(self, assembly, camera, initial): ...
    def step(self, frame):
        self.left -= 1
        if self.left < 0:
            raise ValueError("too tired\\nto go on")
        return FramePrediction(frame.index, poses={}, state=None)

SPEC = MethodSpec("tired", "Fails after a few frames.", Config, "tired:Tired")
"""


def test_a_failing_run_leaves_a_whole_one_in_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "tired.py", tmp_path / "run"
    file.write_text(FAILING)
    line = ("run", "--method", str(file), "sample", "--out", str(out))
    assert exit_code(*line, "--lasts", "1000") == 0
    whole = (out / "predictions.jsonl").read_text()
    assert exit_code(*line, "--lasts", "3") == 2
    assert "3 of 95 frames are saved in" in capsys.readouterr().err
    assert (out / "predictions.jsonl").read_text() == whole
    assert len((tmp_path / "run-partial" / "predictions.jsonl").read_text().splitlines()) == 3


def test_a_run_of_the_first_frames_is_whole_but_replaces_no_longer_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "tired.py", tmp_path / "run"
    file.write_text(FAILING)
    line = ("run", "--method", str(file), "sample", "--lasts", "1000", "--out", str(out))
    assert exit_code(*line, "--first", "0") == 2
    assert "ask for 1 or more" in capsys.readouterr().err
    assert not out.exists()
    for count, folder in (("4", "run"), ("2", "run-partial")):
        assert exit_code(*line, "--first", count) == 0
        assert capsys.readouterr().out == f"{tmp_path / folder}\n"
        assert len(load_run(tmp_path / folder).predictions) == int(count)


@pytest.mark.parametrize("option", ["--contours.turns.a-frame", "--names.every"])
def test_an_option_out_of_range_is_refused_before_anything_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    out = tmp_path / "run"
    line = ("run", "--method", "asdf_plus", "sample", "--out", str(out), option, "0")
    assert exit_code(*line) == 2
    assert option.split("-")[-1].split(".")[-1] in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("lasts", [0, 3])
def test_a_failing_method_keeps_the_frames_before(
    lasts: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "tired.py", tmp_path / "run"
    file.write_text(FAILING)
    line = ("run", "--method", f"{file}:SPEC", "sample", "--out", str(out))
    assert exit_code(*line, "--lasts", str(lasts)) == 2
    said = capsys.readouterr()
    assert said.out == ""
    error = said.err.splitlines()[-1]
    assert error.startswith(f"error: method 'tired' failed in frame {lasts}: ValueError: too tired")
    assert (out / "run.json").is_file() == bool(lasts)
    if lasts:
        assert error.endswith(f"3 of 95 frames are saved in {out}")
        assert len(load_run(out).predictions) == 3
    else:
        assert said.err.count("\n") == 1  # no bar that stands at nothing
        assert not out.exists()


@pytest.mark.parametrize("place", [".", "..", "rgb", "runs", "notes/asdf"])
def test_a_run_never_goes_among_the_images(
    place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "all" / "take"
    shutil.copytree(sample_folder(), scene)
    before = sorted(tmp_path.rglob("*"))
    assert exit_code("run", str(scene), "--method", "asdf", "--out", str(scene / place)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(scene) in error
    assert sorted(tmp_path.rglob("*")) == before
    check_run_folder(scene / "runs" / "asdf", scene)  # where the app puts them


@pytest.mark.parametrize("name", ["rgb", "depth", "camera.json", "scene_gt.json"])
def test_a_run_never_goes_into_another_recording(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).mkdir()
    assert exit_code("run", "sample", "--method", "asdf", "--out", str(tmp_path)) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"{tmp_path} is a recording itself (it has {name})" in said
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_every_error_of_ours_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_sequence: object, **_: object) -> None:
        raise RenderError("no EGL here:\ninstall libegl1")

    monkeypatch.setattr("asdfviz.evaluate.health.check_sequence", fail)
    assert exit_code("check", "sample") == 2
    assert capsys.readouterr().err == "error: no EGL here: install libegl1\n"


@pytest.mark.parametrize(
    ("kind", "severity", "code"),
    [("depth_unit", "warning", 0), ("depth_unit", "error", 0), ("broken_images", "error", 2)],
)
def test_findings_do_not_fail_a_check_but_images_that_cannot_be_read(
    kind: Kind,
    severity: Severity,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    finding = Finding(kind, severity, "a finding")
    report = HealthReport("sample", "/sample", 1, 1, (finding,))
    monkeypatch.setattr("asdfviz.evaluate.health.check_sequence", lambda *_, **__: report)
    assert exit_code("check", "sample") == code
    assert f"{severity:<8} a finding" in capsys.readouterr().out
    assert exit_code("check", "sample", "--json") == code
    assert json.loads(capsys.readouterr().out)["findings"][0]["severity"] == severity


def test_check_shows_how_far_it_is_and_stops(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code("check", "sample", "--json") == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["frames_looked_at"] == 12
    assert re.search(r"^check .*12/12", said.err)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("asdfviz.evaluate.health_shift._view", interrupted)
    assert exit_code("check", "sample") == 130
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines()[-1] == "stopped"


def test_check_looks_an_assembly_over_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code("check", "corner_clamp", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["assembly"], report["states"], report["findings"]) == ("corner_clamp", 4, [])
    text = (models_folder() / "corner_clamp" / "assembly.yaml").read_text()
    text = text.replace("t: [11.313708499, 11.313708499, 8.2]", "t: [113.1, 113.1, 8.2]")
    shutil.copytree(models_folder() / "corner_clamp" / "parts", tmp_path / "parts")
    file = tmp_path / "assembly.yaml"
    file.write_text(text)
    for given in (tmp_path, file):
        assert exit_code("check", str(given)) == 0
        *_, floating, last = capsys.readouterr().out.splitlines()
        assert re.match(r"warning  jaw is \d+\.\d mm away from every other part in jaw", floating)
        assert last == "looked at 3 parts in 4 states"
    assert exit_code("check", str(tmp_path / "other.yaml")) == 2
    assert "no assembly at" in capsys.readouterr().err
    (tmp_path / "rgb").mkdir()  # a recording that has its assembly beside it
    assert exit_code("check", str(tmp_path)) == 2
    assert "rgb holds no frames" in capsys.readouterr().err


def test_an_interrupt_while_modules_are_loaded_is_quiet(tmp_path: Path) -> None:
    interrupted = "import signal; signal.raise_signal(signal.SIGINT)"  # in this very thread
    (tmp_path / "tyro.py").write_text(interrupted)
    program = (
        # Whoever runs the tests in the background has Ctrl+C ignored, here too.
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "from asdfviz.cli import main\nmain(['methods'])"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "stopped\n")


def test_the_package_is_the_command_line_too() -> None:
    line = [sys.executable, "-m", "asdfviz", "check", "no/such/folder"]
    ended = subprocess.run(line, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith("error: no scene folder")


def test_methods_lists_the_paper_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("methods", "--json") == 0
    names = {row["name"] for row in json.loads(capsys.readouterr().out)}
    assert {"yolov8pose", "asdf"} <= names


@pytest.fixture
def smallest(tmp_path: Path) -> Assembly:
    """The README's smallest assembly, as written."""
    indented = re.search(r"^    name: my_model\n.*?\n\n", README.read_text(), re.M | re.S)
    assert indented is not None
    (tmp_path / "assembly.yaml").write_text(textwrap.dedent(indented.group()))
    trimesh.creation.box((40, 40, 10)).export(tmp_path / "plate.ply")
    trimesh.creation.cylinder(8, 15).export(tmp_path / "knob.ply")
    return load_assembly(str(tmp_path))


def test_the_readme_s_smallest_assembly_loads(smallest: Assembly) -> None:
    assert [state.name for state in smallest.states] == ["plate", "knob"]
    assert smallest.states[1].T_base_part["knob"][2, 3] == pytest.approx(0.0125)


def test_the_readme_s_csv_files_read_as_it_says(smallest: Assembly, tmp_path: Path) -> None:
    readme = README.read_text()
    found = re.search(r"^    (scene_id,.*\n)    (.*\n)\n    (.*\n)", readme, re.M)
    assert found is not None
    header, bop, gbot = found.groups()
    sequence = open_sequence(sample_folder(), assembly=smallest)
    file = tmp_path / "results.csv"
    for text, begins in ((header + bop, 0), (gbot, 3)):
        file.write_text(text)
        run = read_result_csv(file, sequence=sequence, assembly=smallest)
        assert run.predictions[0].frame_index == begins
        (said,) = (one for one in run.predictions if one.poses)
        assert (said.frame_index, *said.poses) == (3, "knob")
        assert said.poses["knob"].T_camera_part[:3, 3] == pytest.approx([0.0105, -0.02, 0.5])
        assert said.runtime == {"total": 0.25}


def test_every_command_of_the_readme_parses() -> None:
    lines = re.findall(r"^    (asdfviz [^#\n]+)", README.read_text(), flags=re.MULTILINE)
    assert len(lines) >= 8
    for line in lines:
        command = shlex.split(line)[1]
        assert command in COMMANDS, line


def test_recordings_of_one_name_keep_their_runs_and_longer_parts_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tired.py").write_text(FAILING)
    for place in ("one", "two"):
        shutil.copytree(sample_folder(), tmp_path / place / "take")
        (tmp_path / place / "take" / "gone.json").symlink_to("/nowhere")  # read by nobody
    line = ("run", "--method", "tired.py", "--lasts", "1000")
    for place, name in (("one", "take-tired"), ("two", "take-tired-2"), ("one", "take-tired")):
        assert exit_code(*line, f"{place}/take") == 0
        assert capsys.readouterr().out == f"runs/{name}\n"
    for lasts in ("5", "2"):
        assert exit_code("run", "--method", "tired.py", "one/take", "--lasts", lasts) == 2
    kept = [len(load_run(folder).predictions) for folder in sorted((tmp_path / "runs").iterdir())]
    assert sorted(kept) == [2, 5, 95, 95]


@pytest.fixture
def short(tmp_path: Path) -> tuple[FolderSequence, Assembly]:
    """The sample's first ten frames, in a folder of their own, and their assembly."""
    scene = tmp_path / "scene"
    shutil.copytree(sample_folder(), scene, ignore=shutil.ignore_patterns("0000[1-9]*"))
    sequence = open_sequence(scene)
    assert sequence.assembly is not None
    return sequence, sequence.assembly


def test_export_names_what_it_leaves_out(
    tmp_path: Path, short: tuple[FolderSequence, Assembly], capsys: pytest.CaptureFixture[str]
) -> None:
    (sequence, assembly), notes, out = short, tmp_path / "notes", tmp_path / "out"
    image = sequence.files.rgb[4]
    image.write_bytes(image.read_bytes()[:40])
    with open_annotation(sequence, assembly, folder=notes) as store:
        store.set_seed(Seed("truth"))
    line = ("export", sequence.path, "--annotations", str(notes))
    assert exit_code(*line, "--out", str(out)) == 0
    said = capsys.readouterr()
    assert said.out == f"{out}\n"
    warnings = [words for words in said.err.splitlines() if words.startswith("warning: ")]
    assert len(warnings) == 1
    assert "cannot be read: 4 (" in warnings[0]
    assert 4 not in open_sequence(out).frame_indices


def test_export_leaves_out_what_nobody_checked_of_a_run(
    tmp_path: Path, short: tuple[FolderSequence, Assembly], capsys: pytest.CaptureFixture[str]
) -> None:
    (sequence, assembly), notes, run = short, tmp_path / "notes", tmp_path / "run"
    pose = PoseEstimate("base", np.eye(4) + np.eye(4, k=4), 1.0, "pnp")
    said = tuple(FramePrediction(i, {"base": pose}, None) for i in sequence.frame_indices)
    save_run(Run("asdf", {}, sequence.path, assembly.path, "0", said), run)
    with open_annotation(sequence, assembly, folder=notes) as store:
        store.set_seed(Seed("run", str(run), "asdf"))
        store.set_pose(3, "base", pose.T_camera_part)
    line = ("export", sequence.path, "--annotations", str(notes), "--out", str(tmp_path / "out"))
    for more, frames in (((), 1), (("--unchecked",), len(sequence))):
        assert exit_code(*line, *more) == 0
        assert ("nobody checked a pose (--unchecked" in capsys.readouterr().err) == (not more)
        assert len(json.loads((tmp_path / "out" / "scene_gt.json").read_text())) == frames


def test_a_part_taken_away_beside_guesses_is_exported_and_judged(
    tmp_path: Path, short: tuple[FolderSequence, Assembly], capsys: pytest.CaptureFixture[str]
) -> None:
    (sequence, assembly), notes, run = short, tmp_path / "notes", tmp_path / "run"
    poses = {name: PoseEstimate(name, np.eye(4), 1.0, "pnp") for name in assembly.parts}
    said = tuple(FramePrediction(i, poses, None) for i in sequence.frame_indices)
    save_run(Run("asdf", {}, sequence.path, assembly.path, "0", said), run)
    with open_annotation(sequence, assembly, folder=notes) as store:
        store.set_seed(Seed("run", str(run), "asdf"))
        store.remove_pose(3, "jaw")
    out = tmp_path / "out"
    assert exit_code("export", sequence.path, "--annotations", str(notes), "--out", str(out)) == 0
    others = [name for name in assembly.parts if name != "jaw"]
    assert json.loads((out / "scene_gt.json").read_text()) == {"3": []}
    assert json.loads((out / "unchecked.json").read_text()) == {"3": others}
    capsys.readouterr()
    assert exit_code("evaluate", str(run), "--truth", str(out), "--json") == 0
    parts = json.loads(capsys.readouterr().out)["parts"]
    wrong = {name: figures["false_positives"] for name, figures in parts.items()}
    assert wrong == {name: int(name == "jaw") for name in assembly.parts}


def test_numbers_are_for_the_layout_that_has_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ("export", "sample", "--out", str(tmp_path / "out"), "--ids", "numbers")
    assert exit_code(*line, "--layout", "yolo") == 2
    assert "--ids numbers is for --layout bop" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
