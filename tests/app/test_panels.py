"""The panel's tabs and the bars as HTML: complete, escaped, never NaN, whatever is missing."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from tiny_sequence import COUNT, FIRST, make_run

from asdfviz.annotate.records import Seed, StateLabel
from asdfviz.app import actions as act
from asdfviz.app import chrome, hotkeys, theme, welcome
from asdfviz.app.bridge import parse
from asdfviz.app.items import JobStatus
from asdfviz.app.jobs import start_judging
from asdfviz.app.markup import EYE, button, number
from asdfviz.app.panels import annotate, methods, options, reasons, results, sequence
from asdfviz.app.session import settled
from asdfviz.app.snapshot import Snapshot, take
from asdfviz.app.typed_pose import euler_deg
from asdfviz.app.view import TRUTH, View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Assembly, Run, Stage, StateEstimate
from asdfviz.evaluate.health_report import Finding
from asdfviz.evaluate.worst import TOLD
from asdfviz.geometry.transforms import rotation_about
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.icg import IcgConfig
from asdfviz.methods.spec import BrokenMethod, MethodSpec
from asdfviz.state.fusion import FusionConfig

METHODS = {
    "asdf": MethodSpec("asdf", "All <of> it.", AsdfConfig, "x:Y"),
    "mine": BrokenMethod("mine", "<b>boom</b>"),
}
TABS: dict[str, Callable[[Snapshot], str]] = {
    "sequence": sequence.content,
    "methods": lambda snap: methods.content(snap, METHODS),
    "annotate": annotate.content,
    "results": results.content,
    "top": chrome.top_bar,
    "controls": chrome.controls,
    "timeline": chrome.timeline_rows,
}


class Balance(HTMLParser):
    """Checks that tags are closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in ("path", "img", "input", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag != "path":
            assert self.open.pop() == tag


class Pressed(HTMLParser):
    """What the page would send for each element that can be pressed."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.messages += [value or "" for name, value in attrs if name == "data-act"]


def snapshot(workspace: Workspace, view: View | None = None, **changes: object) -> Snapshot:
    view = settled(replace(view or View(), **changes), workspace.facts())  # pyright: ignore[reportArgumentType]
    return take(workspace, view, frame=workspace.frames[view.place])


@pytest.mark.parametrize("tab", TABS)
@pytest.mark.parametrize("selected", [None, "jaw"])
@pytest.mark.parametrize("place", [0, 4, 7])
def test_every_tab_in_every_state(
    with_run: Workspace, tab: str, selected: str | None, place: int
) -> None:
    with_run.findings = (Finding("depth_unit", "error", "<script>alert(1)</script>", float("nan")),)
    html = TABS[tab](snapshot(with_run, place=place, selected=selected))
    balance = Balance()
    balance.feed(html)
    assert balance.open == []
    assert "nan" not in html.lower().replace("nanovise", "")
    assert "<script" not in html
    assert "<b>boom" not in html
    assert "<of>" not in html
    pressed = Pressed()
    pressed.feed(html)
    assert None not in [parse(message) for message in pressed.messages]


@pytest.mark.parametrize("tab", TABS)
def test_every_tab_without_runs_and_without_a_frame(workspace: Workspace, tab: str) -> None:
    snap = replace(snapshot(workspace), frame=None)
    assert TABS[tab](snap)


def test_the_parts_say_where_they_are_from(with_run: Workspace) -> None:
    html = annotate.content(snapshot(with_run, place=0, selected="jaw"))
    assert "has no pose in this frame" in html
    own = theme.css(tuple(int(v) for v in with_run.assembly.parts["jaw"].color))  # pyright: ignore[reportArgumentType]
    assert f"{theme.css(with_run.colors['jaw'])} 50%,{own} 50%" in html
    assert "Place here" in html
    assert "refined by depth" in html
    assert "90<small> %" in html


def test_lists_leave_out_what_all_names_begin_with(with_run: Workspace) -> None:
    clamp = with_run.assembly
    parts = {f"Corner_Clamp_{name}": part for name, part in clamp.parts.items()}
    states = tuple(
        replace(
            state,
            name=state.name if state.is_error else f"Clamp_State_{state.index}",
            T_base_part={f"Corner_Clamp_{name}": T for name, T in state.T_base_part.items()},
            joints={},
        )
        for state in clamp.states
    )
    with_run.assembly = replace(clamp, parts=parts, states=states, base="Corner_Clamp_base")
    with_run.colors = theme.part_colors(parts)
    snap = snapshot(with_run, selected="Corner_Clamp_jaw")
    html = annotate.content(snap)
    for short, tooltip in (
        ("jaw", "Corner_Clamp_jaw: drawn"),
        ("State_1", "Clamp_State_1, "),
        ("jaw_reversed", "jaw_reversed, "),
    ):
        assert f"<b>{short}</b>" in html
        assert f'title="{tooltip}' in html
    lane = chrome.timeline_rows(snap)
    assert "<span>jaw</span>" in lane
    assert 'title="Corner_Clamp_jaw. ' in lane


def test_figures_by_part_have_short_names(with_run: Workspace) -> None:
    start_judging(with_run).join(60)
    assert with_run.reports is not None
    (report,) = with_run.reports
    parts = {f"Corner_Clamp_{name}": figures for name, figures in report["parts"].items()}
    with_run.reports = ({**report, "parts": parts},)
    html = results.content(snapshot(with_run))
    assert '<span title="Corner_Clamp_jaw">jaw</span>' in html


def test_results_say_how_much_truth_they_rest_on(with_run: Workspace) -> None:
    start_judging(with_run).join(60)
    # The bolt is seen in five of the eight frames, the others in all.
    assert "<td>true poses</td><td>21<small> of 3 parts</small></td>" in results.content(
        snapshot(with_run)
    )
    with_run.truths = (None,) * COUNT
    for place in (1, 2):
        with_run.store.set_pose(
            FIRST + place, "jaw", with_run.poses(place, "first")["jaw"].T_camera_part
        )
    with_run.store.set_state(FIRST + 1, StateLabel(0))
    start_judging(with_run).join(60)
    html = results.content(snapshot(with_run))
    assert "<td>true poses</td><td>2<small> of 1 part</small></td>" in html
    assert "<td>true states</td><td>1</td>" in html


def test_states_are_counted_by_the_truth_where_a_run_says_none(with_run: Workspace) -> None:
    run = with_run.runs[0].run
    silent = replace(run, predictions=tuple(replace(p, state=None) for p in run.predictions))
    with_run.put_run(silent, "first")
    start_judging(with_run).join(60)
    assert f"<td>true states</td><td>{COUNT}</td>" in results.content(snapshot(with_run))


@pytest.mark.parametrize("selected", [None, "bolt"])
def test_a_tracker_at_work_is_shown_whatever_is_selected(
    with_run: Workspace, selected: str | None
) -> None:
    with_run.carrying = JobStatus("jaw", "running", done=1, total=5, told="Tracking jaw")
    html = annotate.content(snapshot(with_run, place=0, selected=selected))
    assert "cancel-tracking" in html


def test_a_frame_has_one_number_everywhere(with_run: Workspace) -> None:
    snap = snapshot(with_run, place=1)
    assert ">101</b><span> / 107</span>" in chrome.controls(snap)
    assert f'data-numbers="{list(range(100, 108))}"' in chrome.timeline_rows(snap)
    assert "for <em>frame 101</em>" in annotate.content(snap)


def test_verdicts_are_shown_and_offered(with_run: Workspace) -> None:
    html = annotate.content(snapshot(with_run, place=1, selected="jaw"))
    assert ">Verified<" in html
    assert ">Not in this frame<" in html
    assert "Drop correction" not in html
    assert ">Clear<" not in html
    pose = with_run.poses(1, "first")["jaw"].T_camera_part
    with_run.store.verify(101, "jaw", pose, provenance="tracked")
    with_run.store.remove_pose(102, "jaw")
    with_run.store.set_state(103, StateLabel(1), last_frame=104)
    html = annotate.content(snapshot(with_run, place=1, selected="jaw"))
    assert "verified<i>, tracked</i>" in html
    assert "Drop correction" in html
    html = annotate.content(snapshot(with_run, place=2, selected="jaw", marked=(2, 3)))
    assert "not in this frame<i>, by hand</i>" in html
    assert "jaw is marked as not in this frame." in html
    assert ">Verified<" not in html
    assert "Drop correction" in html
    assert ">Clear<" in html
    html = annotate.content(snapshot(with_run, place=1, selected="jaw", marked=(1, 3)))
    assert ">Not in these frames<" in html
    assert "Its pose in these frames was looked at" in html
    html = annotate.content(snapshot(with_run, place=1, selected="jaw", marked=(0, 1)))
    assert "Take back that its pose in these frames was looked at" in html
    html = annotate.content(snapshot(with_run, place=3, selected="jaw", marked=(2, 3)))
    assert "Back to what it started from in these frames" in html
    html = annotate.content(snapshot(with_run, place=3, selected="jaw", marked=(3, 4)))
    assert "Drop correction" not in html


def test_a_pose_where_there_was_none_is_placed_and_no_correction(with_run: Workspace) -> None:
    """The run has no pose of the jaw in its first frame."""
    for place, words in ((0, "placed by hand"), (1, "corrected")):
        with_run.store.set_pose(FIRST + place, "jaw", np.eye(4))
        snap = snapshot(with_run, place=place, selected="jaw")
        assert f"</i>{words}</small>" in annotate.content(snap)
        assert f'data-say="{words}"' in chrome.timeline_rows(snap)


def test_turns_tell_their_order(with_run: Workspace) -> None:
    html = annotate.content(snapshot(with_run, place=1, selected="jaw"))
    assert unescape(html).count("then y, then z axis (R = Rz Ry Rx)") == 3


@pytest.mark.parametrize(
    ("label", "title", "name"),
    [
        ("Judge", "Against the truth", "Judge: Against the truth"),
        ("Play", "Play on", "Play on"),
        (EYE, "Hide jaw", "Hide jaw"),
    ],
)
def test_a_button_is_named_as_it_reads(label: str, title: str, name: str) -> None:
    assert f'aria-label="{name}"' in button(label, "", title=title)


def test_poses_are_in_millimetres_and_degrees(with_run: Workspace) -> None:
    html = annotate.content(snapshot(with_run, place=1, selected="jaw"))
    for value, unit in ((52.0, "mm"), (500.0, "mm"), (180.0, "°")):
        assert f'value="{value}"><small> {unit}' in html


@pytest.mark.parametrize("seed", range(20))
def test_euler_angles_give_the_rotation_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R = rotation_about(rng.normal(size=3), rng.uniform(0, np.pi))
    x, y, z = np.radians(euler_deg(R))
    axes = np.eye(3)
    again = rotation_about(axes[2], z) @ rotation_about(axes[1], y) @ rotation_about(axes[0], x)
    assert again == pytest.approx(R, abs=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_euler_angles_at_the_pole(sign: int) -> None:
    R = rotation_about(np.array([0.0, 1.0, 0.0]), sign * np.pi / 2) @ rotation_about(
        np.array([1.0, 0.0, 0.0]), 0.3
    )
    x, y, z = np.radians(euler_deg(R))
    axes = np.eye(3)
    again = rotation_about(axes[2], z) @ rotation_about(axes[1], y) @ rotation_about(axes[0], x)
    assert again == pytest.approx(R, abs=1e-6)


def test_a_running_method_can_be_stopped_and_no_other_started(workspace: Workspace) -> None:
    workspace.job = JobStatus("asdf", "running", 12, 64, 38.4)
    html = methods.content(snapshot(workspace), METHODS)
    assert "Running asdf: 12/64, 38 ms a frame" in html
    assert "Stop" in html
    assert "ax-disabled" in html
    assert "12/64" in chrome.top_bar(snapshot(workspace))


def test_views_that_are_made_first_are_not_called_frames(workspace: Workspace) -> None:
    workspace.job = JobStatus("icg", "running", 300, 642, preparing=True)
    assert "views of its parts, made once: 300/642" in methods.content(snapshot(workspace), METHODS)


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (JobStatus("asdf", "done", 64, 64), "is done: 64 frames"),
        (JobStatus("asdf", "stopped", 3, 64), "stopped after 3 of 64"),
        (JobStatus("asdf", "failed", 3, 64, message="no weights"), "failed: no weights"),
    ],
)
def test_how_a_method_ended(workspace: Workspace, status: JobStatus, words: str) -> None:
    workspace.job = status
    assert words in methods.content(snapshot(workspace), METHODS)
    assert status.method not in chrome.top_bar(snapshot(workspace))


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "\u2013"),
        (float("nan"), "\u2013"),
        (-0.04, "0.0"),
        (-1.26, "\u22121.3"),
        (1234.5, "1234.5"),
    ],
)
def test_numbers(value: float | None, shown: str) -> None:
    assert number(value, decimals=1) == shown


def test_no_key_means_two_things() -> None:
    keys = [(h.key, h.modifier) for h in hotkeys.HOTKEYS if h.key]
    assert len(keys) == len(set(keys))


def test_the_sheet_names_every_key_that_is_not_shared() -> None:
    shown = {key for lines in hotkeys.sheet().values() for key, _ in lines}
    single = {hotkeys.key_name(h) for h in hotkeys.HOTKEYS if h.key and h.on_sheet}
    assert single <= shown
    assert {"Space", "Ctrl Z", "I K J L U O", "Shift + same", "Ctrl K"} <= shown


def test_the_sheet_tells_of_the_mouse() -> None:
    sheet = hotkeys.sheet()
    assert {"Wheel", "Drag", "Shift click", "Shift drag"} <= {what for what, _ in sheet["Mouse"]}
    assert ("? or Shift H", "This sheet") in sheet["Panel"]


def test_the_sheet_has_keys_for_states() -> None:
    keys = {key for key, _ in hotkeys.sheet()["State"]}
    assert {"Shift N", "Shift P", "Shift X", "Shift C", "M", "Shift Del"} == keys


def test_cards_are_whole() -> None:
    for html in (welcome.card(), chrome.keys_sheet()):
        balance = Balance()
        balance.feed(html)
        assert balance.open == []


def test_the_options_of_a_method_are_a_form(workspace: Workspace) -> None:
    spec = MethodSpec("asdf", "All of it.", AsdfConfig, "x:Y")
    html = options.card("asdf", spec, workspace.assembly, {"detector.image_size": "<960>"})
    balance = Balance()
    balance.feed(html)
    assert balance.open == []
    assert 'data-option="detector.image_size"' in html
    assert 'value="&lt;960&gt;"' in html
    assert "1 changed" in html
    assert "weights.safetensors" in html  # what is taken where none are named
    assert "pixels in an image 1280 wide" in html  # a field's docstring
    chosen = '<option value="" selected>default</option><option value="keypoints">'
    assert f'data-option="first_pose" data-default="">{chosen}' in html


def test_a_run_with_other_options_says_which(workspace: Workspace, clamp: Assembly) -> None:
    as_given = {"w_f": FusionConfig().w_f}
    config = {"detector": {"image_size": 960, "confidence": 0.1}, "fusion": as_given}
    run = Run("asdf", config, "tiny", clamp.path, "0", ())
    workspace.put_run(run, "first")
    assert "; image size 960<" in methods.content(snapshot(workspace), METHODS)


def test_nothing_can_be_judged_where_nothing_is_known(with_run: Workspace) -> None:
    with_run.truths = (None,) * len(with_run.indices)
    html = results.content(snapshot(with_run))
    assert "correct some frames" in html
    assert "Evaluate" not in html
    with_run.store.set_pose(100, "jaw", np.eye(4))
    assert "Evaluate" in results.content(snapshot(with_run))


def test_figures_that_are_stale_say_so(with_run: Workspace) -> None:
    start_judging(with_run).join(60)
    assert "judge again" not in results.content(snapshot(with_run))
    with_run.store.remove_pose(103, "jaw")
    html = results.content(snapshot(with_run))
    assert html.index("Corrections were made since: judge again") < html.index(
        'data-testid="report"'
    )


def test_what_makes_figures_doubtful_stands_beside_them(with_run: Workspace) -> None:
    start_judging(with_run).join(60)
    assert 'data-testid="doubt"' not in results.content(snapshot(with_run))
    assert with_run.reports is not None
    doubtful = {**with_run.reports[0], "warnings": ["in <another> unit?"]}
    with_run.reports = (doubtful, *with_run.reports[1:])
    assert "in &lt;another&gt; unit?" in results.content(snapshot(with_run))


def test_a_run_that_was_given_the_first_frames_truth_says_so(
    with_run: Workspace, clamp: Assembly
) -> None:
    start_judging(with_run).join(60)
    assert "were handed" not in results.content(snapshot(with_run))
    with_run.put_run(replace(make_run(clamp, method="b"), initial="first_frame_truth"), "second")
    start_judging(with_run).join(60)
    html = results.content(snapshot(with_run))
    assert re.findall(r"<td>start</td>(.*?)</tr>", html) == ["<td>none</td><td>truth</td>"]
    assert "were handed the true poses of the first frame" in html


def test_a_run_that_lacks_frames_never_stands_out(with_run: Workspace, clamp: Assembly) -> None:
    worse, better = (
        make_run(clamp, method=name, shift=off) for name, off in (("b", 0.004), ("c", 0.001))
    )
    with_run.put_run(worse, "second")
    start_judging(with_run).join(60)
    html = results.content(snapshot(with_run))
    assert "Never marked as best" not in html
    assert f"<tr><td>frames</td><td>{COUNT}</td><td>{COUNT}</td></tr>" in html
    assert '<b class="ax-good">2.0<small> mm</small></b>' in html
    assert '<b class="ax-good">4.0' not in html
    with_run.put_run(replace(better, predictions=better.predictions[:3]), "third")
    start_judging(with_run).join(60)
    html = results.content(snapshot(with_run))
    assert f'<td><span class="ax-bad">3/{COUNT}</span></td>' in html
    assert "<td>1.0<small> mm</small></td>" in html
    assert '<b class="ax-good">2.0<small> mm</small></b>' in html
    assert "the unit is in doubt: c." in html


def test_no_run_is_in_use_while_corrections_have_lost_theirs(with_run: Workspace) -> None:
    html = methods.content(snapshot(with_run, base="first"), METHODS)
    assert "in use</span>" in html
    with_run.store.set_seed(Seed("run", "/no/such/run", "gone"))
    html = methods.content(snapshot(with_run, base="first"), METHODS)
    assert "in use</span>" not in html
    assert "the run /no/such/run, which cannot be read" in html
    with_run.store.set_seed(with_run.seed_of(TRUTH))
    html = methods.content(snapshot(with_run, base=TRUTH, chosen=True), METHODS)
    assert "in use</span>" in html
    assert "cannot be read" not in html


def test_a_worst_frame_is_gone_to_with_its_part(with_run: Workspace) -> None:
    assert "Worst frames" not in results.content(snapshot(with_run))
    start_judging(with_run).join(60)
    html = results.content(snapshot(with_run, base="first", chosen=True))
    assert "Worst frames of asdf" in html
    assert TOLD in unescape(html)
    assert "<small>ADD(S) </small>2.0<small> mm</small>" in html
    pressed = Pressed()
    pressed.feed(html)
    assert with_run.reports is not None
    first = with_run.reports[0]["worst"][0].record
    gone_to = act.Seek(first.frame_index - FIRST, first.part)
    assert gone_to in [parse(message) for message in pressed.messages]
    assert "Worst frames" not in results.content(snapshot(with_run, base=TRUTH, chosen=True))


def test_results_open_where_nothing_is_known_to_be_right_any_more(with_run: Workspace) -> None:
    start_judging(with_run).join(60)
    with_run.truths = (None,) * len(with_run.indices)
    html = results.content(snapshot(with_run, base="first", chosen=True))
    assert "correct some frames" in html
    assert "Worst frames" not in html


def test_a_method_that_needs_truth_cannot_be_run_without(with_run: Workspace) -> None:
    given = {"icg": MethodSpec("icg", "Tracks", IcgConfig, "x:Y", initial="first_frame_truth")}
    assert "ax-disabled" not in methods.content(snapshot(with_run), given)
    with_run.truths = (None, *with_run.truths[1:])
    html = methods.content(snapshot(with_run), given)
    assert html.count("ax-disabled") == 1
    assert "Tracks. Not here: it starts from the truth of the first frame" in html


def test_a_method_without_weights_cannot_be_run_but_they_can_be_named(
    with_run: Workspace, tmp_path: Path
) -> None:
    given = {"asdf": MethodSpec("asdf", "Finds", AsdfConfig, "x:Y")}
    own = tmp_path / "own" / "assembly.yaml"
    with_run.assembly = replace(with_run.assembly, path=str(own))
    html = methods.content(snapshot(with_run), given)
    assert html.count("ax-disabled") == 1
    assert "Finds. Not here: no weights lie beside the assembly" in html
    named = {"asdf": {"detector.weights": "w.safetensors"}}
    assert "Not here" not in methods.content(snapshot(with_run, options=named), given)
    (tmp_path / "weights.safetensors").touch()
    assert "ax-disabled" not in methods.content(snapshot(with_run), given)


def test_every_stage_of_a_pose_has_words() -> None:
    assert set(annotate.STAGES) == set(get_args(Stage))


def test_the_terms_say_why_a_state_is_told(with_run: Workspace) -> None:
    run = with_run.runs[0]
    states = len(run.run.predictions[0].state.probabilities)  # pyright: ignore[reportOptionalMemberAccess]
    looks, odd = np.full(states, 0.01), np.full(states, 1.0)
    looks[1] = 0.7
    said = StateEstimate(np.eye(states)[1], {"appearance": looks, "<own> term": odd})
    snap = snapshot(with_run, place=3)
    assert snap.prediction is not None
    html = reasons.section(replace(snap, prediction=replace(snap.prediction, state=said)))
    rows = [re.sub(r"<[^>]+>", " ", row).split() for row in html.split("<tr>")]
    looks_row = next(row for row in rows if row[:1] == ["looks"])
    share = round(100 * looks[1] / looks.sum())
    assert looks_row[1 + 2 * rows[1].index("1")] == str(share)
    assert f"<b>{share}<small> %</small></b>" in html
    assert "&lt;own&gt; term" in html
    assert f"Why {with_run.assembly.states[1].name}" in unescape(html)


def test_a_state_without_terms_has_no_reasons(with_run: Workspace) -> None:
    assert reasons.section(snapshot(with_run, place=3)) == ""
    assert reasons.section(snapshot(with_run, place=4)) == ""
