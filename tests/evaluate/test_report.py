"""The report page: read back with an HTML parser, its pictures decoded, its curves counted again."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from asdfviz.cli.report import Report
from asdfviz.data.assembly import load_assembly
from asdfviz.data.run_files import load_run, save_run
from asdfviz.data.sequences import read_folder_truth
from asdfviz.datatypes import (
    Assembly,
    FramePrediction,
    FrameTruth,
    PoseEstimate,
    Run,
    StateEstimate,
)
from asdfviz.errors import InputError
from asdfviz.evaluate.inputs import run_names
from asdfviz.evaluate.judgement import judge
from asdfviz.evaluate.report import write_report
from asdfviz.evaluate.report_charts import confusion_table, error_line, recall_curve, state_strip
from asdfviz.evaluate.worst import SHOWN, TOLD, worst_frames
from asdfviz.geometry.transforms import transform_from

HOSTILE = "<script>alert(\"1\")</script> & 'co'"
VOID = {"meta", "img", "br", "line", "polyline"}
COUNT = 8
K = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
MakeTruth = Callable[..., FrameTruth]
MakePrediction = Callable[..., FramePrediction]
MakeRun = Callable[..., Run]


class Page(HTMLParser):
    """Checks that every tag is closed, and collects what a reader sees and what would be loaded."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.words: list[str] = []
        self.cells: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [
            str(v) for k, v in attrs if k in ("src", "href", "srcset", "data", "action")
        ]
        assert not any(k.startswith("on") for k, _ in attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if self.open and self.open[-1] == "td":
            self.cells.append(data)


def T_camera_part(clamp: Assembly, part: str, place: int) -> np.ndarray:
    """The part's middle beside the others', 0.6 m away."""
    vertices = clamp.parts[part].mesh.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return transform_from(np.eye(3), np.array([0.12 * (place - 1), 0, 0.6]) - middle)


@pytest.fixture(scope="module")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


@pytest.fixture(scope="module")
def scene(clamp: Assembly, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes") / "a & <b>"
    (folder / "rgb").mkdir(parents=True)
    truth = [
        {
            "obj_id": part,
            "cam_R_m2c": np.eye(3).ravel().tolist(),
            "cam_t_m2c": (1000 * T_camera_part(clamp, part, k)[:3, 3]).tolist(),
        }
        for k, part in enumerate(clamp.parts)
    ]
    files = {
        "scene_gt": {str(i): truth for i in range(COUNT)},
        "scene_gt_info": {str(i): [{"visib_fract": 1.0}] * len(truth) for i in range(COUNT)},
        "scene_camera": {str(i): {"cam_K": K.ravel().tolist()} for i in range(COUNT)},
        "states": [{"frame": i, "state": i // 4, "is_error": i == 3} for i in range(COUNT)],
        "sequence": {"assembly": "corner_clamp"},
    }
    for name, content in files.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
    for i in range(COUNT):
        cv2.imwrite(str(folder / "rgb" / f"{i:06d}.png"), np.full((120, 160, 3), 90, np.uint8))
    return folder


def make_run_of(clamp: Assembly, scene: Path, method: str, off: float) -> Run:
    """Every part is `off` metres too far right, in frame 5 three times as far; the base is missed once."""
    predictions: list[FramePrediction] = []
    for i in range(COUNT):
        shift = transform_from(np.eye(3), np.array([off * (3 if i == 5 else 1), 0, 0]))
        poses = {
            part: PoseEstimate(part, shift @ T_camera_part(clamp, part, k), 0.9, "refined")
            for k, part in enumerate(clamp.parts)
            if not (part == clamp.base and i == 2)
        }
        state = StateEstimate(np.eye(len(clamp.states))[(i + 1) // 4])
        predictions.append(FramePrediction(i, poses, state, runtime={"pnp": 0.002, "total": 0.04}))
    config = {"note": HOSTILE}
    return Run(method, config, str(scene), clamp.path, HOSTILE, tuple(predictions))


@pytest.fixture(scope="module")
def runs(clamp: Assembly, scene: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    for name, method, off in (
        ("one", "asdf", 0.004),
        ("two", HOSTILE, 0.03),
        ("three", "asdf", 0.01),
    ):
        save_run(make_run_of(clamp, scene, method, off), folder / name)
    return [folder / name for name in ("one", "two", "three")]


@pytest.fixture(scope="module")
def text(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("out") / "report.html"
    write_report(runs, out, pictures=2)
    return out.read_text(encoding="utf-8")


def test_the_page_is_whole_and_loads_nothing(text: str) -> None:
    page = Page(text)
    assert page.open == []
    assert "script" not in page.tags
    assert all(source.startswith(("#", "data:image/jpeg;base64,")) for source in page.sources)
    assert "url(" not in text
    assert "@import" not in text
    anchors = [source[1:] for source in page.sources if source.startswith("#")]
    assert anchors
    assert all(f'id="{anchor}"' in text for anchor in anchors)
    assert len(text) < 3_000_000
    assert "prefers-color-scheme:dark" in text
    assert "nan" not in "".join(page.cells).lower()


def test_names_are_shown_to_the_letter_and_never_obeyed(text: str) -> None:
    words = "\n".join(Page(text).words)
    assert HOSTILE in words
    assert "a & <b>" in words
    assert "asdf (one)" in words
    assert "asdf (three)" in words
    assert "<script" not in text
    assert "<b> " not in text


def test_the_tables_hold_the_figures(text: str, clamp: Assembly) -> None:
    cells = Page(text).cells
    # e_t of run one: 4 mm in 7 frames, 12 mm in one; the base is missed in one of the 7.
    base, other = (6 * 4 + 12) / 7, (7 * 4 + 12) / 8
    parts = len(clamp.parts)
    assert f"{(base + (parts - 1) * other) / parts:.1f}" in cells
    assert f"{100 * (7 / 8 + parts - 1) / parts:.1f}" in cells  # found
    assert cells.count(f"{100 * 7 / 8:.1f}") >= 3  # the state is early by a frame


def test_the_pictures_show_run_and_truth(text: str) -> None:
    pictures = [s for s in Page(text).sources if s.startswith("data:")]
    assert len(pictures) == 3 * 2
    for picture in pictures:
        data = base64.b64decode(picture.removeprefix("data:image/jpeg;base64,"))
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape == (360, 480, 3)
        white = (image.min(axis=2) > 225).mean()
        colored = (np.ptp(image.astype(int), axis=2) > 60).mean()
        grey = (np.abs(image.astype(int) - 90).max(axis=2) < 8).mean()
        assert white > 0.002
        assert colored > 0.01
        assert grey > 0.3


def test_the_worst_frames_are_those_that_the_app_lists(
    text: str, runs: list[Path], clamp: Assembly
) -> None:
    assert Report(()).pictures == SHOWN
    page = Page(text)
    assert TOLD in page.words
    loaded = load_run(runs[0])
    truth = read_folder_truth(Path(loaded.sequence), clamp)
    worst = worst_frames(judge(loaded, assembly=clamp, truth=truth).comparison.records)
    assert [one.record.frame_index for one in worst] == [5, 0]
    for one in worst:
        index = page.words.index(f", frame {one.record.frame_index}")
        assert page.words[index - 1] == one.record.part
        assert page.words[index + 1].startswith(f"ADD(S) {one.add_s_mm:.1f} mm, e")


def test_runs_whose_folders_have_one_name_are_told_apart(clamp: Assembly, scene: Path) -> None:
    here, there = (make_run_of(clamp, at, "asdf", 0.0) for at in (scene, scene / "other"))
    given = [(Path(place), here) for place in ("a/new", "b/new", "a/old", "a/../a/old")]
    names = run_names([*given, (Path("c/new"), there)])
    assert names == ["asdf (a/new)", "asdf (b/new)", "asdf (a/old)", "asdf (a/old)", "asdf"]
    assert run_names([(Path("c/new"), there)], taken=["asdf"]) == ["asdf (new)"]


def test_pictures_are_left_out_where_the_frames_are_gone(
    runs: list[Path], scene: Path, tmp_path: Path
) -> None:
    away = scene.with_name("away")
    out = tmp_path / "report.html"
    (scene / "rgb").rename(away)
    try:
        write_report(runs[:1], out, pictures=2)
    finally:
        away.rename(scene / "rgb")
    words = " ".join(Page(out.read_text()).words)
    assert "no pictures: " in words
    assert "No pose to show." in words


def test_a_csv_and_two_sequences(
    runs: list[Path], scene: Path, clamp: Assembly, tmp_path: Path
) -> None:
    twin = tmp_path / "twin" / scene.name
    twin.mkdir(parents=True)
    for file in scene.glob("*.json"):
        (twin / file.name).write_text(file.read_text())
    save_run(make_run_of(clamp, twin, "asdf", 0.02), tmp_path / "run")
    T = T_camera_part(clamp, clamp.base, 0)
    R, t = (" ".join(map(str, x)) for x in (T[:3, :3].ravel(), 1000 * T[:3, 3]))
    csv = tmp_path / "theirs.csv"
    csv.write_text("".join(f"{scene.name},{i:06d},{clamp.base},-1,{R},{t},5\n" for i in (1, 2)))
    out = tmp_path / "report.html"
    write_report([*runs[:1], csv, tmp_path / "run"], out, pictures=0, sequence=str(scene))
    words = "\n".join(Page(out.read_text()).words)
    assert f"theirs on {scene.parent.name}/{scene.name}" in words
    assert f"asdf on twin/{scene.name}" in words
    assert "Means over sequences" in words
    # 4 mm (12 once) on one, 20 mm (60 once) on the other.
    assert "all, plain" in words


def test_a_run_that_lacks_frames_or_is_in_another_unit_never_stands_out(
    scene: Path, clamp: Assembly, tmp_path: Path
) -> None:
    whole = make_run_of(clamp, scene, "whole", 0.01)
    worse = make_run_of(clamp, scene, "worse", 0.02)
    short = make_run_of(clamp, scene, "short", 0.001)
    short = replace(short, predictions=short.predictions[:5])
    T = T_camera_part(clamp, clamp.base, 0)
    R, t = (" ".join(map(str, x)) for x in (T[:3, :3].ravel(), T[:3, 3]))  # in metres
    csv = tmp_path / "metres.csv"
    header = "scene_id,im_id,obj_id,score,R,t,time\n"
    csv.write_text(header + "".join(f"1,{i},{clamp.base},1,{R},{t},0\n" for i in range(COUNT)))
    for run in (whole, worse, short):
        save_run(run, tmp_path / run.method)
    out = tmp_path / "report.html"

    def best_of(*names: str) -> set[str]:
        paths = [tmp_path / name for name in names]
        write_report(paths, out, pictures=0, sequence=str(scene) if csv in paths else None)
        rows = re.findall(r"<tr><td.*?</tr>", out.read_text())
        return {
            m[1] for row in rows if 'class="best"' in row and (m := re.search("</i>(.*?)<", row))
        }

    assert best_of("whole", "worse", "short", "metres.csv") == {"whole"}
    page = out.read_text()
    assert page.count(f'<td class="part">5/{COUNT}</td>') == 3
    assert f"short on {html.escape(scene.name)}, metres on" in page
    assert "Never marked as best" in page
    assert best_of("whole", "short") == set()
    assert best_of("whole", "worse") == {"whole"}
    assert "Never marked as best" not in out.read_text()


def test_the_page_says_what_was_given_the_first_frames_truth(
    clamp: Assembly, scene: Path, text: str, tmp_path: Path
) -> None:
    runs = (
        replace(make_run_of(clamp, scene, "icg", 0.004), initial="first_frame_truth"),
        make_run_of(clamp, scene, "asdf", 0.004),
    )
    for run in runs:
        save_run(run, tmp_path / run.method)
    out = tmp_path / "report.html"
    write_report([tmp_path / run.method for run in runs], out, pictures=0)
    page = out.read_text(encoding="utf-8")
    assert page.count('<th class="t">Start</th>') == 3, "poses, states and the authors' rules"
    assert page.count('title="truth">truth</td>') == page.count('title="none">none</td>') == 3
    assert "were handed the true poses of the first frame" in page
    assert '<th class="t">Start</th>' not in text
    assert "were handed" not in text


def test_frames_are_those_of_all_runs_whichever_comes_first(
    clamp: Assembly, scene: Path, tmp_path: Path
) -> None:
    given = replace(make_run_of(clamp, scene, "icg", 0.004), initial="first_frame_truth")
    for run in (given, make_run_of(clamp, scene, "asdf", 0.004)):
        save_run(run, tmp_path / run.method)
    out = tmp_path / "report.html"
    for order in (("icg", "asdf"), ("asdf", "icg")):
        write_report([tmp_path / name for name in order], out, pictures=0)
        page = out.read_text(encoding="utf-8")
        assert f"{COUNT} frames with truth" in page
        truth, *_ = re.findall(r'<b title="truth">.*?</div>', page)
        assert "frames 0 to" in truth
    write_report([tmp_path / "icg"], out, pictures=0)
    assert f"{COUNT - 1} frames with truth" in out.read_text(encoding="utf-8")


def test_truth_of_states_alone(runs: list[Path], tmp_path: Path) -> None:
    truth = tmp_path / "truth"
    truth.mkdir()
    (truth / "states.json").write_text(json.dumps([{"frame": i, "state": 0} for i in range(3)]))
    out = tmp_path / "report.html"
    write_report(runs[:1], out, truth_folder=truth)
    words = " ".join(Page(out.read_text()).words)
    assert words.count("The truth has no poses to compare with.") == 3
    assert "Below each run" not in words


def test_no_run_and_a_wrong_run(tmp_path: Path) -> None:
    for paths in ([], [tmp_path / "nowhere"]):
        with pytest.raises(InputError):
            write_report(paths, tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_recall_curve_by_counting() -> None:
    rng = np.random.default_rng(3)
    errors = {
        "a": [*rng.uniform(0, 120, 13).tolist(), np.inf],
        "b": rng.uniform(0, 60, 7).tolist(),
        "never there": [],
    }
    x, y = recall_curve(errors, limit=100.0, points=11)
    assert x == pytest.approx([10.0 * i for i in range(11)])
    for threshold, recall in zip(x, y, strict=True):
        shares = [sum(e < threshold for e in errors[name]) / len(errors[name]) for name in "ab"]
        assert recall == pytest.approx(100 * sum(shares) / 2)
    assert recall_curve({"never there": []}, limit=100.0) == ([], [])


def test_strips(assembly: Assembly) -> None:
    states = [(0, False), (0, False), (0, True), (None, False), (2, False)]
    strip = state_strip(HOSTILE, states, [4, 5, 6, 8, 9], assembly)
    assert strip.count("<i ") == 4
    assert 'class="error" style="flex-grow:1;' in strip
    assert "bare, frames 4 to 5" in strip
    assert "done, frames 9 to 9" in strip
    assert "<script" not in strip
    line = error_line([1.0, None, 80.0, 2.0], [0.5, 1.0, 0.0, 0.0], color="red", limit_mm=50.0)
    assert line.count('class="missed"') == 2
    assert 'x="166.7" y="1.0" width="333.3" height="22.0"' in line  # all of the second frame's
    assert line.count("<polyline") == 2
    assert "666.7,1.0 1000.0," in line  # 80 mm is cut off at the top


def test_confusion_leaves_empty_extras_out() -> None:
    frames = [[3, 1, 0, 0], [0, 2, 0, 0], [0, 0, 0, 0]]
    names = {"true": ["x<", "y", "error"], "predicted": ["x<", "y", "error", "none"]}
    table = Page(confusion_table({**names, "frames": frames}))
    assert table.tags.count("tr") == 3
    assert table.tags.count("td") == 4
    assert [cell for cell in table.cells if cell.strip()] == ["3", "1", "2"]


@pytest.mark.parametrize("numbers", [range(10), [round(100 * i / 3) for i in range(10)]])
def test_worst_frames_are_not_neighbours(
    assembly: Assembly,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
    numbers: Sequence[int],
) -> None:
    """Also where the frames' numbers are times, in milliseconds."""
    at = transform_from(np.eye(3), np.array([0.0, 0, 0.5]))
    offs = [0.0, 0.09, 0.1, 0.05, 0, 0, 0, 0.03, 0, 0.2]
    truth = {i: make_truth(i, {"plate": at, "rod": at}) for i in numbers}
    last = numbers[9]
    truth[last] = make_truth(last, {"plate": at, "rod": at}, visible=0.05)
    said = [
        make_prediction(i, {"plate": transform_from(np.eye(3), np.array([off, 0, 0.5])), "rod": at})
        for i, off in zip(numbers, offs, strict=True)
    ]
    found = judge(make_run(said), assembly=assembly, truth=truth)
    worst = worst_frames(found.comparison.records, count=2)
    expected = [(numbers[2], "plate"), (numbers[7], "plate")]
    assert [(w.record.frame_index, w.record.part) for w in worst] == expected
    assert [w.add_s_mm for w in worst] == pytest.approx([100.0, 30.0])
