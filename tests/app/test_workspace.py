"""Runs, layers, rows and messages that tabs share; jobs and the judging behind them."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_sequence import TinySequence, make_run, pose_of

from asdfviz.annotate.records import Seed, label_of
from asdfviz.annotate.spoken import NOTHING, up_to_date
from asdfviz.annotate.store import AnnotationStore
from asdfviz.app import jobs, method_job
from asdfviz.app.items import ANNOTATION, Message
from asdfviz.app.jobs import Background, start_check, start_export, start_judging
from asdfviz.app.method_job import next_run_folder, pace_of
from asdfviz.app.snapshot import take
from asdfviz.app.strips import annotation_row
from asdfviz.app.timeline import Verdict
from asdfviz.app.truths import drawn_truth, exported_truth
from asdfviz.app.view import TRUTH, View, centre_of
from asdfviz.app.workspace import Workspace
from asdfviz.data.run_files import load_run, save_run
from asdfviz.data.sequences import read_folder_truth
from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, PoseEstimate, Run
from asdfviz.errors import MethodError, SequenceError
from asdfviz.evaluate.evaluate import evaluate_run
from asdfviz.evaluate.health import HealthReport
from asdfviz.methods.spec import MethodSpec


@dataclass(frozen=True)
class StillConfig:
    """Nothing to choose."""


GATE = threading.Event()
"""Lets the method go on."""
FAIL = threading.Event()
"""Makes it fail."""


class Still:
    """Says that the base lies at the origin's front; waits before its third frame."""

    def __init__(self, config: StillConfig) -> None:
        self._seen = 0

    def reset(self, assembly: object, camera: object, initial: object) -> None:
        self._seen = 0

    def step(self, frame: Frame) -> FramePrediction:
        self._seen += 1
        if self._seen == 3:
            assert GATE.wait(20)
            if FAIL.is_set():
                raise ValueError("no light")
        T = np.eye(4)
        T[2, 3] = 0.5
        pose = PoseEstimate("base", T, 1.0, "pnp")
        return FramePrediction(frame.index, {"base": pose}, None)


SPEC = MethodSpec("still", "Says the same of every frame.", StillConfig, f"{__name__}:Still")


@pytest.fixture
def background(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> Background:
    GATE.clear()
    FAIL.clear()
    monkeypatch.setattr(method_job, "PUBLISH_EVERY", 0.0)
    Path(workspace.frames.path, "rgb").mkdir(exist_ok=True)
    return Background(workspace)


def wait_for(workspace: Workspace, condition: Any) -> None:
    changed = threading.Event()
    end = workspace.subscribe(changed.set)
    try:
        while not condition():
            assert changed.wait(20), "nothing happened for 20 s"
            changed.clear()
    finally:
        end()


def test_a_run_is_shown_while_it_works_and_saved_at_the_end(
    workspace: Workspace, background: Background
) -> None:
    background.run(SPEC)
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.done == 2)
    assert [p is not None for p in workspace.runs[0].by_place] == [True, True, *[False] * 6]
    with pytest.raises(MethodError, match="still running"):
        background.run(SPEC)
    GATE.set()
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.state == "done")
    run = workspace.runs[0]
    assert run.folder is not None
    assert len(load_run(run.folder).predictions) == 8
    assert run.milliseconds is not None


def test_a_stopped_run_keeps_what_was_done(workspace: Workspace, background: Background) -> None:
    background.run(SPEC)
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.done == 2)
    background.stop()
    assert workspace.job is not None
    assert workspace.job.state == "stopping"
    GATE.set()
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.state == "stopped")
    folder = workspace.runs[0].folder
    assert folder is not None
    assert len(load_run(folder).predictions) == 3


def test_a_failed_run_says_where_and_keeps_the_frames_before(
    workspace: Workspace, background: Background
) -> None:
    FAIL.set()
    GATE.set()
    background.run(SPEC)
    wait_for(workspace, lambda: bool(workspace.messages))
    assert workspace.job is not None
    assert workspace.job.state == "failed"
    message = workspace.messages[0]
    assert message.is_problem
    assert "frame 102" in message.body
    assert "no light" in message.body
    run = workspace.runs[0]
    assert [p is not None for p in run.by_place] == [True, True, *[False] * 6]
    assert run.folder is not None
    assert f"2 of 8 frames are kept in {run.folder}" in message.body
    assert len(load_run(run.folder).predictions) == 2


def test_the_pace_of_a_run_leaves_its_first_frame_out() -> None:
    frames = [
        FramePrediction(k, {}, None, runtime={"total": seconds})
        for k, seconds in enumerate((14.2, 0.1, 0.3, 0.2))
    ]
    assert pace_of(frames[:1]) is None
    assert pace_of(frames[:2]) == pytest.approx(100.0)
    assert pace_of(frames) == pytest.approx(200.0)


def test_run_folders_never_meet(tmp_path: Path) -> None:
    assert next_run_folder(tmp_path, "asdf").name == "asdf"
    (tmp_path / "asdf").mkdir()
    assert next_run_folder(tmp_path, "asdf").name == "asdf-2"
    assert next_run_folder(tmp_path, "../x:y").parent == tmp_path


def test_a_folder_of_runs_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(
        MethodError, match=r"cannot be read \(File name too long\): ask whose it is"
    ):
        next_run_folder(tmp_path / ("x" * 300), "asdf")


def test_poses_are_the_runs_and_then_the_corrections(with_run: Workspace) -> None:
    shown = with_run.poses(1, "first")
    assert {name: s.source for name, s in shown.items()} == dict.fromkeys(shown, "first")
    assert with_run.poses(0, None) == {}
    assert with_run.poses(6, TRUTH).keys() == {"base", "jaw"}
    T = shown["base"].T_camera_part.copy()
    T[0, 3] += 1
    with_run.store.set_pose(101, "base", T)
    with_run.store.remove_pose(101, "jaw")
    again = with_run.poses(1, "first")
    assert again["base"].source == ANNOTATION
    assert np.array_equal(again["base"].T_camera_part, T)
    assert "jaw" not in again


def test_rows_and_boundaries(with_run: Workspace) -> None:
    assert [row.label for row in with_run.rows()] == ["annotation", "truth", "asdf"]
    run = with_run.rows()[2]
    assert run.marks[4] is None
    assert run.probabilities[4] is None
    assert run.probabilities[0] == pytest.approx(
        1.0 / (1.0 + 0.1 * (len(with_run.assembly.states) - 1))
    )
    assert with_run.facts().boundaries == (0, 3, 5, 6)


def test_runs_of_one_method_get_numbers(with_run: Workspace) -> None:
    with_run.put_run(with_run.runs[0].run, "second")
    assert [run.label for run in with_run.runs] == ["asdf", "asdf 2"]
    assert with_run.facts().preferred == "second"
    with_run.drop_run("second")
    assert len(with_run.runs) == 1


def test_judging(with_run: Workspace) -> None:
    start_judging(with_run).join(60)
    assert with_run.reports is not None
    assert not with_run.is_judging
    report = with_run.reports[0]
    assert report["run"] == "first"
    assert report["mean"]["e_t_mm"] == pytest.approx(2.0)
    worst = report["worst"]
    first, second = (one.record.frame_index for one in worst)
    assert abs(first - second) >= 5
    assert [one.add_s_mm for one in worst] == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize("beside", ["nothing", "a pose", "a state"])
def test_corrections_judge_alike_here_and_exported(
    clamp: Assembly, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, beside: str
) -> None:
    export_folder = tmp_path_factory.mktemp("exports") / "tiny"
    store = AnnotationStore(tmp_path / "a.db", sequence_name="tiny", assembly_name=clamp.name)
    sequence = TinySequence(clamp, tmp_path, with_truth=False)
    bare = Workspace(
        sequence, clamp, store=store, runs_folder=tmp_path / "runs", export_folder=export_folder
    )
    run = make_run(clamp)
    bare.put_run(run, "first")
    store.remove_pose(101, "bolt")
    if beside == "a pose":
        store.set_pose(101, "jaw", pose_of(1))
    if beside == "a state":
        store.set_state(101, label_of(clamp.states[0]))
    start_judging(bare).join(60)
    start_export(bare, None).join(60)
    bare.close()
    assert bare.reports is not None
    exported = read_folder_truth(export_folder, clamp)
    again = evaluate_run(run, assembly=clamp, truth=exported, camera=sequence.camera)
    for report in (*bare.reports, again):
        wrong = {name: part["false_positives"] for name, part in report["parts"].items()}
        assert wrong == {name: int(name == "bolt") for name in clamp.parts}


def test_the_annotation_row_tells_verdicts(with_run: Workspace) -> None:
    store, error = with_run.store, with_run.assembly.errors[0]
    store.verify(101, "jaw", pose_of(1), provenance="tracked")
    store.verify(102, "jaw", pose_of(1), provenance="tracked")
    store.set_pose(102, "jaw", pose_of(2))  # moved since: nobody has looked at that
    store.remove_pose(101, "bolt")
    store.remove_pose(103, "of another assembly")
    store.set_state(104, label_of(error))
    store.set_state(103, None, last_frame=105)
    store.set_state(106, label_of(error))
    store.set_state(106, None)
    store.set_state(106, label_of(error))
    said = {place: verdict for place, verdict in enumerate(with_run.rows()[0].verdicts) if verdict}
    assert said == {1: Verdict(("jaw",), ("bolt",)), 4: Verdict(unlabelled=True)}
    store.drop_pose(101, "jaw")
    assert with_run.rows()[0].verdicts[1] == Verdict(gone=("bolt",))


class Counted(Sequence[int]):
    """Frame numbers that count how often one of them is looked at."""

    def __init__(self, numbers: range) -> None:
        self._numbers = numbers
        self.looks = 0

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, place: Any) -> Any:
        self.looks += 1
        return self._numbers[place]


def test_a_label_costs_its_own_frames_only(with_run: Workspace) -> None:
    store, state = with_run.store, label_of(with_run.assembly.states[1])
    indices = Counted(range(0, 6000, 3))
    with store.transaction():
        for k in range(20):
            store.set_state(30 * k + 1, state, last_frame=30 * k + 13)  # between two frames
        store.set_state(9999, state)
    row = annotation_row(with_run.assembly, up_to_date(NOTHING, store), indices)
    labelled = [place for place, mark in enumerate(row.marks) if mark]
    assert labelled == [10 * k + j for k in range(20) for j in (1, 2, 3, 4)]
    assert indices.looks < 2 * len(indices)


def test_figures_are_stale_once_something_was_corrected(with_run: Workspace) -> None:
    store = with_run.store
    store.set_state(104, None)
    assert not with_run.is_stale
    start_judging(with_run).join(60)
    assert not with_run.is_stale
    store.set_seed(with_run.seed_of("first"))  # what is drawn, but not what judges
    store.undo()
    assert not with_run.is_stale
    for change in (
        lambda: store.set_pose(101, "jaw", pose_of(1), group="drag"),
        store.undo,
        lambda: store.set_state(104, None),
    ):
        change()
        assert with_run.is_stale
        start_judging(with_run).join(60)
        assert not with_run.is_stale


def test_what_is_drawn_is_what_is_exported(with_run: Workspace) -> None:
    T = np.eye(4)
    T[2, 3] = 0.4
    with_run.store.set_pose(101, "base", T)
    drawn = drawn_truth(with_run, "first")
    assert np.array_equal(drawn[101].T_camera_part["base"], T)
    run_pose = with_run.poses(2, "first")["base"].T_camera_part
    assert np.array_equal(drawn[102].T_camera_part["base"], run_pose)
    true = drawn_truth(with_run, TRUTH)[102].T_camera_part["base"]
    assert not np.array_equal(true, run_pose)


def test_a_run_s_guesses_are_exported_only_if_asked(
    with_run: Workspace, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with_run.export_folder = tmp_path_factory.mktemp("exports") / "tiny"
    start_export(with_run, "first").join(60)
    assert with_run.messages[-1].is_problem
    assert "nobody set, tracked or verified a pose" in with_run.messages[-1].body
    with_run.store.set_pose(101, "base", np.eye(4) + np.eye(4, k=4))
    for guesses, frames in ((False, {101}), (True, set(range(100, 108)))):
        said = len(with_run.messages)
        start_export(with_run, "first", guesses=guesses).join(60)
        gt = json.loads((with_run.export_folder / "scene_gt.json").read_text())
        assert {int(frame) for frame in gt} == frames
        told = [message.title for message in with_run.messages[said:]]
        assert ("Not everything was checked" in told) == (not guesses)


def test_listeners_hear_of_changes_until_they_leave(workspace: Workspace) -> None:
    heard: list[int] = []
    end = workspace.subscribe(lambda: heard.append(1))
    workspace.say(Message("a", "b"))
    end()
    workspace.changed()
    assert heard == [1]


def test_corrections_begun_while_a_run_works_start_from_the_saved_run(
    workspace: Workspace, background: Background
) -> None:
    background.run(SPEC)
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.done == 2)
    working = workspace.runs[0]
    workspace.store.set_seed(workspace.seed_of(working.id))
    assert workspace.base_of_seed() == working.id
    GATE.set()
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.state == "done")
    assert workspace.base_of_seed() == working.id
    assert workspace.store.seed().run == str(workspace.runs[0].folder)


def test_a_run_that_was_killed_is_run_again_in_its_place(
    workspace: Workspace, background: Background, clamp: Assembly
) -> None:
    # Begun and corrected, but the app was killed before it was saved; another began afterwards.
    begun = workspace.runs_folder / SPEC.name
    begun.mkdir(parents=True)
    workspace.store.set_seed(Seed("run", str(begun), SPEC.name))
    workspace.store.set_pose(101, "base", np.eye(4) + np.eye(4, k=4))
    GATE.set()
    background.run(replace(SPEC, name="other"))
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.state == "done")
    assert workspace.base_of_seed() is None
    start_export(workspace, workspace.runs[0].id).join(60)
    assert "was never saved: run still again, which takes its place" in workspace.messages[-1].body
    # What does not get as far as a frame leaves it to be tried again.
    job = method_job.MethodJob(workspace, SPEC, StillConfig())
    job.stop()
    job.start()
    job.wait(20.0)
    assert begun.is_dir()
    (begun / ".predictions.jsonl.0a1b").touch()  # killed while it was saved
    background.run(SPEC)
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.state == "done")
    assert workspace.messages[-1].title == "Corrections go on from this run"
    assert workspace.base_of_seed() == str(begun)
    assert len(load_run(begun).predictions) == 8
    assert set(exported_truth(workspace, None, guesses=False).truth) == {101}
    # The next one has a folder of its own.
    background.run(SPEC)
    wait_for(workspace, lambda: workspace.job is not None and workspace.job.state == "done")
    assert workspace.runs[-1].folder == begun.with_name("still-2")


def test_corrections_find_their_run_in_a_scene_that_was_moved(
    workspace: Workspace, clamp: Assembly
) -> None:
    folder = Path(workspace.frames.path) / "runs" / "asdf"
    save_run(make_run(clamp), folder)
    workspace.put_run(make_run(clamp), "here", folder=folder)
    workspace.store.set_seed(Seed("run", "/where/it/was/runs/asdf", "asdf"))
    assert workspace.base_of_seed() == "here"
    workspace.store.set_seed(Seed("run", "/where/it/was/runs/other", "asdf"))
    assert workspace.base_of_seed() is None


def test_parts_that_nobody_spoke_of_are_not_wrong(clamp: Assembly, tmp_path: Path) -> None:
    store = AnnotationStore(tmp_path / "t.db", sequence_name="tiny", assembly_name=clamp.name)
    sequence = TinySequence(clamp, tmp_path, with_truth=False)
    made = Workspace(
        sequence, clamp, store=store, runs_folder=tmp_path / "r", export_folder=tmp_path / "e"
    )
    with contextlib.closing(made):
        made.put_run(make_run(clamp), "first")
        for index in made.indices[:3]:
            store.set_pose(index, "base", pose_of(0, shift=0.002))
        start_judging(made).join(60)
        assert made.reports is not None
        parts = made.reports[0]["parts"]
        assert [parts[name]["false_positives"] for name in clamp.parts] == [0, 0, 0]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_in_the_program_ends_a_job(
    workspace: Workspace, background: Background, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_args: object, **_options: object) -> Run:
        raise ZeroDivisionError

    monkeypatch.setattr(method_job, "run", broken)
    background.run(SPEC)
    wait_for(workspace, lambda: workspace.job is not None and not workspace.job.is_active)
    background.close()  # the thread has told of its error by then
    assert "a fault in the program" in workspace.messages[-1].body
    assert not any(workspace.runs_folder.iterdir())


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize(
    ("error", "words"),
    [
        (SequenceError("no <camera>"), "no <camera>"),
        (ZeroDivisionError(), "a fault in the program"),
    ],
)
def test_a_check_that_fails_says_why(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def broken(_sequence: object) -> HealthReport:
        raise error

    monkeypatch.setattr(jobs, "check_sequence", broken)
    start_check(workspace).join(10)
    assert workspace.findings is not None
    assert f"It was not checked: {words}" in workspace.findings[0].message


def test_a_frame_is_shown_with_its_own_intrinsics(with_run: Workspace) -> None:
    """As in a BOP scene, whose pictures may be crops."""
    view, frame = View(place=2, selected="jaw"), with_run.frames[2]
    K = frame.camera.K - np.array([[0.0, 0, 100], [0, 0, 0], [0, 0, 0]])
    cropped = replace(frame, camera=Camera(K, 640, 480))
    snap = take(with_run, view, frame=cropped)
    assert snap.facts.K[0, 2] == pytest.approx(219.5)
    assert centre_of(view, snap.facts) == (219.5, 239.5)
    assert take(with_run, view, frame=None).facts.K[0, 2] == pytest.approx(319.5)
