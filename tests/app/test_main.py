"""Opening: what is found, what is refused, and where new runs go."""

from __future__ import annotations

import contextlib
import json
import shutil
import time
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from asdfviz.annotate.checked import annotated
from asdfviz.app import main
from asdfviz.app.jobs import start_export
from asdfviz.app.main import App, ViewConfig, open_app, open_workspace
from asdfviz.app.workspace import FIRST_METHOD, Workspace
from asdfviz.data.hashes import sequence_sha256
from asdfviz.data.run_files import save_run
from asdfviz.data.sequences import read_folder_truth
from asdfviz.datatypes import Assembly, Frame, FramePrediction, PoseEstimate, Run
from asdfviz.errors import AnnotationError, InputError, RunError
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.spec import MethodSpec


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    folder = tmp_path / "desk"
    (folder / "rgb").mkdir(parents=True)
    cv2.imwrite(str(folder / "rgb" / "000000.png"), np.full((48, 64, 3), 90, np.uint8))
    camera = {
        "fx": 60,
        "fy": 60,
        "cx": 31.5,
        "cy": 23.5,
        "width": 64,
        "height": 48,
        "depth_scale": 1,
    }
    (folder / "camera.json").write_text(json.dumps(camera))
    return folder


def run_of(scene: Path, assembly: Assembly, *, x: float) -> Run:
    """The jaw at x metres to the right of the middle."""
    T_camera_jaw = transform_from(np.eye(3), np.array([x, 0.0, 0.5]))
    pose = PoseEstimate("jaw", T_camera_jaw, 0.9, "refined")
    prediction = FramePrediction(0, {"jaw": pose}, None)
    return Run("mine", {}, str(scene), assembly.path, "0", (prediction,))


def config(scene: Path, **changes: object) -> ViewConfig:
    given = {
        "assembly": "corner_clamp",
        "annotations": scene.parent / "notes",
        "port": 0,
        **changes,
    }
    return ViewConfig(sequence=str(scene), **given)  # pyright: ignore[reportArgumentType]


def test_runs_go_beside_the_images(scene: Path) -> None:
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        assert workspace.runs_folder == scene / "runs"


def test_a_read_only_folder_stays_as_it_is(scene: Path) -> None:
    scene.chmod(0o555)
    try:
        with contextlib.closing(open_workspace(config(scene))) as workspace:
            assert workspace.runs_folder == scene.parent / "notes" / "runs" / "desk"
    finally:
        scene.chmod(0o755)


def test_nothing_is_written_into_the_bundled_sample(tmp_path: Path) -> None:
    with contextlib.closing(open_workspace(ViewConfig(annotations=tmp_path))) as workspace:
        assert workspace.runs_folder == tmp_path / "runs" / "sample"
        assert workspace.export_folder == tmp_path / "exports" / "sample"


def test_earlier_runs_are_there_and_a_broken_one_is_told(scene: Path, clamp: Assembly) -> None:
    save_run(Run("mine", {}, str(scene), clamp.path, "0", ()), scene / "runs" / "mine")
    (scene / "runs" / "bad").mkdir()
    (scene / "runs" / "bad" / "run.json").write_text("{")
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        assert [run.label for run in workspace.runs] == ["mine"]
        assert [m.is_problem for m in workspace.messages] == [True]
        assert "bad" in workspace.messages[0].body


def correct(workspace: Workspace, run_id: str) -> None:
    """Say that the base part lies elsewhere than the run has it."""
    workspace.store.set_seed(workspace.seed_of(run_id))
    T_camera_base = np.eye(4)
    T_camera_base[2, 3] = 0.4
    workspace.store.set_pose(0, "base", T_camera_base)


def test_a_restart_draws_and_exports_the_run_that_was_corrected(
    scene: Path, clamp: Assembly
) -> None:
    elsewhere = scene.parent / "elsewhere"
    save_run(run_of(scene, clamp, x=0.1), elsewhere)
    save_run(run_of(scene, clamp, x=0.2), scene / "runs" / "other")
    with contextlib.closing(open_workspace(config(scene, runs=(elsewhere,)))) as workspace:
        correct(workspace, str(elsewhere))
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        assert workspace.base_of_seed() == str(elsewhere)
        assert workspace.messages == ()
        start_export(workspace, str(scene / "runs" / "other"), guesses=True).join(60)
        written = read_folder_truth(workspace.export_folder, clamp)
        assert written[0].T_camera_part["jaw"][0, 3] == pytest.approx(0.1)


def test_results_in_a_csv_are_shown_and_corrected(scene: Path, clamp: Assembly) -> None:
    results = scene.parent / "results.csv"
    results.write_text("desk,0,jaw,-1,1 0 0 0 1 0 0 0 1,100 0 500,20\n")
    with contextlib.closing(open_workspace(config(scene, runs=(results,)))) as workspace:
        assert [run.label for run in workspace.runs] == ["results"]
        shown = workspace.poses(0, str(results))["jaw"].T_camera_part
        assert shown[:3, 3] == pytest.approx([0.1, 0.0, 0.5])
        correct(workspace, str(results))
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        assert workspace.base_of_seed() == str(results)
        source, notes = workspace.frames.source, scene.parent / "notes"
        assert set(annotated(source, annotations=notes).truth[0].T_camera_part) == {"base"}
        known = annotated(source, annotations=notes, guesses=True).truth
        assert set(known[0].T_camera_part) == {"base", "jaw"}


def test_a_restart_without_the_run_that_was_corrected_says_so(scene: Path, clamp: Assembly) -> None:
    elsewhere, other = scene.parent / "elsewhere", scene / "runs" / "other"
    for folder in (elsewhere, other):
        save_run(run_of(scene, clamp, x=0.1), folder)
    with contextlib.closing(open_workspace(config(scene, runs=(elsewhere,)))) as workspace:
        correct(workspace, str(elsewhere))
    (elsewhere / "run.json").unlink()
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        told = workspace.messages[0]
        assert told.is_problem
        assert str(elsewhere) in told.body
        assert "it has no run.json" in told.body
        start_export(workspace, str(other)).join(60)
        assert workspace.messages[1].title == "Could not export"
        assert not workspace.export_folder.exists()
        workspace.store.set_seed(workspace.seed_of(str(other)))
        start_export(workspace, str(other)).join(60)
        assert (workspace.export_folder / "scene_gt.json").is_file()


def test_a_restart_after_a_kill_says_that_the_run_was_never_saved(
    scene: Path, clamp: Assembly
) -> None:
    home = scene / "runs" / "mine"
    home.mkdir(parents=True)
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        workspace.put_run(run_of(scene, clamp, x=0.1), str(home), home=home)
        correct(workspace, str(home))
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        (told,) = workspace.messages
        assert "was never saved: run mine again, which takes its place, or press 'use'" in told.body
        source, notes = workspace.frames.source, scene.parent / "notes"
        with pytest.raises(AnnotationError, match=r"'mine' .* was not saved: run the method again"):
            annotated(source, annotations=notes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"assembly": None}, "--assembly PATH"),
        ({"assembly": "no_such"}, "no assembly at 'no_such'"),
        ({"format": "gbot", "sequence": "/no/such/folder"}, "no scene folder"),
        ({"runs": (Path("/no/such/run"),)}, "/no/such/run"),
        ({"runs": (Path("/no/such.csv"),)}, r"there is no file /no/such\.csv"),
    ],
)
def test_what_cannot_be_opened_says_why(
    scene: Path, changes: dict[str, object], words: str
) -> None:
    wanted = {"sequence": str(scene), **changes}
    sequence = Path(str(wanted.pop("sequence")))
    with pytest.raises(InputError, match=words):
        open_app(config(sequence, **wanted) if sequence == scene else config(sequence))


def test_a_run_of_other_frames_is_refused(scene: Path, clamp: Assembly) -> None:
    run, elsewhere = run_of(scene, clamp, x=0.1), scene.parent / "elsewhere"
    later = tuple(replace(one, frame_index=one.frame_index + 70) for one in run.predictions)
    save_run(replace(run, predictions=later), elsewhere)
    with pytest.raises(RunError, match=r"elsewhere holds frame 70, .* frame 0: they share none"):
        open_workspace(config(scene, runs=(elsewhere,)))
    assert not (scene.parent / "notes").exists()


def copy_of(scene: Path, name: str, *, grey: int = 90) -> Path:
    """The scene under another name, its picture in some grey."""
    copy = scene.parent / name
    shutil.copytree(scene, copy)
    cv2.imwrite(str(copy / "rgb" / "000000.png"), np.full((48, 64, 3), grey, np.uint8))
    return copy


def test_a_run_of_another_sequence_is_refused(scene: Path, clamp: Assembly) -> None:
    other, elsewhere = copy_of(scene, "bench", grey=30), scene.parent / "elsewhere"
    run = run_of(other, clamp, x=0.1)
    hashed = replace(run, hashes={"sequence": sequence_sha256(other)})
    for one in (run, hashed):
        save_run(one, elsewhere)
        said = rf"elsewhere is a run on another sequence, {other}, not on {scene}"
        with pytest.raises(RunError, match=said):
            open_workspace(config(scene, runs=(elsewhere,)))
    other.rename(scene.parent / "gone")  # its hash still tells
    with pytest.raises(RunError, match="a run on another sequence"):
        open_workspace(config(scene, runs=(elsewhere,)))
    assert not (scene.parent / "notes").exists()


def test_a_run_of_the_same_recording_elsewhere_is_shown(scene: Path, clamp: Assembly) -> None:
    elsewhere = scene.parent / "elsewhere"
    copy = copy_of(scene, "with_truth")
    (copy / "states.json").write_text('[{"frame": 0, "state": 0}]')
    hashed = {"sequence": sequence_sha256(copy)}
    moved, nothing_told = str(scene.parent / "before"), str(scene.parent / "nowhere")
    run = run_of(scene, clamp, x=0.1)
    for one in (
        replace(run, sequence=str(copy), hashes=hashed),
        replace(run, sequence=moved, hashes={"sequence": sequence_sha256(scene)}),
        replace(run, sequence=nothing_told),
    ):
        save_run(one, elsewhere)
        with contextlib.closing(open_workspace(config(scene, runs=(elsewhere,)))) as workspace:
            assert [run.label for run in workspace.runs] == ["mine"]
    home = scene / "runs" / "mine"
    save_run(replace(run, sequence=moved, hashes=hashed), home)
    with contextlib.closing(open_workspace(config(scene, runs=(home,)))) as workspace:
        assert [run.label for run in workspace.runs] == ["mine"]


def test_an_export_in_the_app_says_which_frames_it_lacks(scene: Path, clamp: Assembly) -> None:
    cv2.imwrite(str(scene / "rgb" / "000001.png"), np.full((48, 64, 3), 90, np.uint8))
    (scene / "rgb" / "000000.png").write_bytes(b"")
    with contextlib.closing(open_workspace(config(scene))) as workspace:
        start_export(workspace, None).join(60)
        done, missing, lacking = workspace.messages
        assert (done.title, done.is_problem) == ("Exported", False)
        assert missing.body == "no pose, and so no truth, in 2 of 2 frames"
        assert lacking.is_problem
        assert "cannot be read: 0 (" in lacking.body


@pytest.mark.parametrize("case", ["truth", "run"])
def test_a_start_that_fails_makes_no_annotation_file(
    scene: Path, clamp: Assembly, case: str
) -> None:
    save_run(run_of(scene, clamp, x=0.1), scene.parent / "run")
    if case == "truth":
        state = {"frame": 0, "state": 1, "attached": ["base", "jaw"]}
        (scene / "states.json").write_text(json.dumps([state]))
    runs = (scene.parent / "run",) if case == "run" else ()
    with pytest.raises(InputError, match=r"jaw|base"):
        open_workspace(config(scene, assembly="geared_caliper", runs=runs))
    assert not (scene.parent / "notes").exists()


def test_an_address_that_cannot_be_served_makes_no_annotation_file(scene: Path) -> None:
    with pytest.raises(InputError, match="there is no port -1"):
        open_app(config(scene, port=-1))
    assert not (scene.parent / "notes").exists()


def test_a_file_in_the_place_of_the_annotations_is_named(scene: Path) -> None:
    notes = scene.parent / "notes"
    notes.touch()
    with pytest.raises(InputError, match=r"notes is a file; results need a folder"):
        open_workspace(config(scene))


def test_what_a_page_that_has_gone_still_writes_is_waited_for(scene: Path) -> None:
    """An edit may still wait when its page goes and the app is closed right after."""

    class Tab:
        has_ended = False

        def close(self) -> None:
            assert not self.has_ended

        def wait(self, seconds: float) -> None:
            app.workspace.store.poses()  # is still open
            self.has_ended = True

    app = open_app(config(scene))
    gone, later = Tab(), Tab()
    for number, tab in enumerate((gone, later)):
        app._tabs[number] = tab  # pyright: ignore[reportPrivateUsage, reportArgumentType]
        app._close_tab(SimpleNamespace(client_id=number))  # pyright: ignore[reportPrivateUsage]
    assert app.tabs() == ()
    app.close()
    assert gone.has_ended
    assert later.has_ended


def test_a_token_is_in_the_address(scene: Path) -> None:
    with contextlib.closing(open_app(config(scene, token="open sesame"[:4]))) as app:
        assert app.url.endswith("?token=open")


@dataclass(frozen=True)
class SlowConfig:
    """Nothing to choose."""


OPENED: list[App] = []


class Slow:
    """Finds nothing, and does not get as far as its first frame before it is stopped."""

    def __init__(self, config: SlowConfig) -> None:
        del config

    def reset(self, assembly: object, camera: object, initial: object) -> None:
        end = time.monotonic() + 20
        while (job := OPENED[-1].workspace.job) is None or job.state != "stopping":
            assert time.monotonic() < end
            time.sleep(0.01)

    def step(self, frame: Frame) -> FramePrediction:
        return FramePrediction(frame.index, {}, None)


SLOW = MethodSpec(FIRST_METHOD, "Finds nothing.", SlowConfig, f"{__name__}:Slow")


@contextlib.contextmanager
def begun(config: ViewConfig) -> Generator[App]:
    """An app whose first picture is shown."""
    with contextlib.closing(open_app(config)) as app:
        OPENED.append(app)
        app._begin()
        yield app


def test_a_method_that_was_stopped_does_not_begin_by_itself_again(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(main, "find_method", lambda name: SLOW)
    given = config(scene)
    with begun(given) as app:
        assert app.workspace.job is not None
    # That the app was closed meanwhile is no wish of anybody's.
    with begun(given) as app:
        assert app.workspace.job is not None
        app.background.stop()
    with begun(given) as app:
        assert app.workspace.job is None
        app.background.run(SLOW)
    with begun(given) as app:
        assert app.workspace.job is not None
    assert not list((scene / "runs").iterdir())
