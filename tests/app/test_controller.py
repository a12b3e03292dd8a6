"""A tab's own thread: what it does when nothing is known any more, and when the tab goes."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from asdfviz.app import actions as act
from asdfviz.app.controller import Controller
from asdfviz.app.items import JobStatus
from asdfviz.app.jobs import Background
from asdfviz.app.view import TRUTH
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Camera


class Screen:
    """A display that is slow, and remembers what it was told."""

    is_dragging = False

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self.shown: list[Any] = []
        self.told: list[tuple[str, str]] = []
        self.colors: list[str] = []

    def frame(self, place: int) -> None:
        del place

    def show(self, snap: Any) -> bool:
        time.sleep(self._seconds)
        self.shown.append(snap)
        return True

    def tell(self, title: str, body: str, *, color: str) -> None:
        self.told.append((title, body))
        self.colors.append(color)


Open = Callable[..., tuple[Controller, Screen]]


@pytest.fixture
def opened(with_run: Workspace, monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    """Opens tabs, whose threads end before the workspace does."""
    tabs: list[Controller] = []

    def made(
        *, seconds: float = 0.0, on_shown: Callable[[], None] = lambda: None, **view: Any
    ) -> tuple[Controller, Screen]:
        screen = Screen(seconds)

        def build(tab: Controller) -> None:
            tab.view = replace(tab.view, selected="jaw", place=2, **view)
            vars(tab)["_display"] = screen

        monkeypatch.setattr(Controller, "_build", build)
        client = SimpleNamespace(camera=SimpleNamespace(aspect=1.5))
        tab = Controller(cast(Any, client), with_run, Background(with_run), {}, on_shown=on_shown)
        tab.start()
        tabs.append(tab)
        until(lambda: screen.shown)
        return tab, screen

    yield made
    for tab in tabs:
        tab.close()
        tab.wait(30.0)


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_edits_that_wait_when_the_tab_goes_are_kept(opened: Open, with_run: Workspace) -> None:
    tab, screen = opened(seconds=0.3, base="first")
    before = len(screen.shown)
    tab.emit(act.Step(1))
    until(lambda: tab.view.place == 3)  # the next frame is being shown
    tab.emit(act.Nudge(0, 1))
    tab.emit(act.SelectPart("bolt"))
    tab.emit(act.Nudge(1, -1))
    tab.close()
    tab.wait(30.0)
    assert len(screen.shown) <= before + 2
    assert {part for _, part in with_run.store.poses()} == {"jaw", "bolt"}


@pytest.mark.parametrize("card", [{"keys": True}, {"asking": "asdf"}])
def test_keys_do_nothing_behind_a_card_but_close_it(
    opened: Open, with_run: Workspace, card: dict[str, Any]
) -> None:
    tab, _ = opened(**card)
    for action in (act.Nudge(0, 1), act.Seek(5), act.Cancel(), act.Nudge(1, 1)):
        tab.emit(act.ByKey(action))
    until(lambda: with_run.store.poses())
    tab.close()
    tab.wait(10.0)
    assert (tab.view.keys, tab.view.asking, tab.view.place) == (False, None, 2)
    moved = with_run.store.poses()[with_run.indices[2], "jaw"].T_camera_part
    assert moved is not None
    by = 1000 * (moved - with_run.base_poses(2, "first")["jaw"].T_camera_part)
    assert by[:3, 3] == pytest.approx([0, 1, 0])


@pytest.mark.parametrize("card", [{}, {"keys": True}])
def test_the_key_that_cancels_stops_a_tracker_before_it_lets_go_of_the_part(
    opened: Open, with_run: Workspace, card: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(Background, "stop_tracking", lambda _: asked.append("stop"))
    with_run.carrying = JobStatus("jaw", "running", done=1, total=5, told="Tracking jaw")
    tab, _ = opened(**card)
    tab.emit(act.ByKey(act.Cancel()))
    until(lambda: bool(asked) or (bool(card) and not tab.view.keys))
    assert tab.view.selected == "jaw"
    assert asked == ([] if card else ["stop"])
    with_run.carrying = None
    tab.emit(act.ByKey(act.Cancel()))
    until(lambda: tab.view.selected is None)
    tab.close()


def test_the_sheet_is_closed_by_the_key_that_opens_it(opened: Open) -> None:
    tab, _ = opened(keys=True, asking=None)
    tab.emit(act.ByKey(act.ToggleKeys()))
    until(lambda: not tab.view.keys)
    tab.close()


def test_the_end_of_undo_is_a_hint(opened: Open) -> None:
    tab, screen = opened()
    tab.emit(act.Undo())
    tab.emit(act.RevertPart())
    until(lambda: len(screen.told) == 2)
    tab.close()
    assert screen.told[0][1] == "nothing left to undo"
    assert screen.colors == ["gray", "red"]


def test_a_tab_that_is_open_keeps_its_steps_to_itself(opened: Open, with_run: Workspace) -> None:
    (tab, _), (other, screen) = opened(base="first"), opened(base="first")
    tab.emit(act.Nudge(0, 1))
    until(with_run.store.poses)
    other.emit(act.Undo())
    until(lambda: screen.told)
    assert screen.told == [("Nothing left", "nothing left to undo in this tab")]
    tab.close()
    other.emit(act.Undo())
    until(lambda: not with_run.store.poses())
    other.close()


def test_what_a_page_did_before_it_lost_its_connection_stays_its_own(
    opened: Open, with_run: Workspace
) -> None:
    (tab, _), (other, screen) = opened(base="first"), opened(base="first")
    tab.emit(act.Nudge(0, 1))
    until(with_run.store.poses)
    tab.close()
    again, _ = opened(base="first")
    again.emit(act.Resume(2, "3d", tab.view.page))
    until(lambda: again.view.mode == "3d")
    other.emit(act.Undo())
    until(lambda: screen.told)
    assert screen.told == [("Nothing left", "nothing left to undo in this tab")]
    again.emit(act.Undo())
    until(lambda: not with_run.store.poses())


def test_beside_undo_stands_what_was_tracked_last(opened: Open, with_run: Workspace) -> None:
    tab, screen = opened()
    tab.emit(act.Nudge(0, 1))
    until(lambda: "moved" in screen.shown[-1].status)
    for done, said in ((5, "5 frames"), (1, "1 frame")):
        told = f"jaw tracked to {said}"
        with_run.carrying = JobStatus("jaw", "done", done=done, total=5, told=told)
        with_run.changed()
        until(lambda said=said: screen.shown[-1].status == f"jaw tracked to {said}, saved")
    tab.emit(act.Nudge(0, 1))
    until(lambda: "moved" in screen.shown[-1].status)
    tab.close()


def test_a_range_grows_while_it_plays(opened: Open) -> None:
    tab, _ = opened(base="first", speed=4.0)
    tab.emit(act.MarkRange())
    tab.emit(act.TogglePlay())
    until(lambda: tab.view.place > 3)
    tab.emit(act.TogglePlay())
    until(lambda: not tab.view.playing)
    assert tab.view.marked == (2, tab.view.place)
    tab.emit(act.MarkRange())
    until(lambda: tab.view.marking is None)
    assert tab.view.marked == (2, tab.view.place)
    tab.close()
    tab.wait(30.0)


def test_a_range_serves_for_one_state(opened: Open, with_run: Workspace) -> None:
    tab, _ = opened(base="first", marked=(1, 3))
    tab.emit(act.SetState(1))
    tab.emit(act.Seek(6))
    tab.emit(act.SetState(2))
    until(lambda: with_run.store.state(106))
    labels = [with_run.store.state(100 + place) for place in range(8)]
    assert [label and label.state for label in labels] == [None, 1, 1, 1, None, None, 2, None]
    assert tab.view.marked is None
    tab.close()
    tab.wait(30.0)


def test_keys_go_through_the_states_of_a_range(opened: Open, with_run: Workspace) -> None:
    tab, _ = opened(base="first", marked=(1, 3))
    for action in (act.NextState(1), act.NextState(1), act.Seek(6), act.RepeatState()):
        tab.emit(action)
    until(lambda: with_run.store.state(106))
    labels = [with_run.store.state(100 + place) for place in range(8)]
    assert [label and label.state for label in labels] == [None, 2, 2, 2, None, None, 2, None]
    tab.close()
    tab.wait(30.0)


def test_what_corrections_start_from_is_drawn_in_every_tab(
    opened: Open, with_run: Workspace
) -> None:
    """A run that comes later does not take its place: what is drawn is what is exported."""
    tab, _ = opened(base=TRUTH, chosen=True)
    other, _ = opened(base="first")
    tab.emit(act.Nudge(0, 1))
    until(with_run.store.poses)
    until(lambda: other.view.base == TRUTH)
    assert tab.view.base == TRUTH
    for one in (tab, other):
        one.close()
        one.wait(30.0)


def test_the_view_goes_by_the_shown_pictures_own_intrinsics(
    opened: Open, with_run: Workspace
) -> None:
    tab, screen = opened()
    frame = with_run.frames[2]
    K = frame.camera.K - np.array([[0.0, 0, 100], [0, 0, 0], [0, 0, 0]])
    vars(screen)["frame"] = lambda place: replace(frame, camera=Camera(K, 640, 480))
    tab.emit(act.Changed())
    until(lambda: screen.shown[-1].frame is not None)
    tab.emit(act.Zoom(2.0))
    until(lambda: tab.view.zoom > 1.5)
    assert tab.view.centre == pytest.approx((219.5, 239.5))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (PermissionError(13, "Permission denied", "runs/asdf"), "Permission denied: 'runs/asdf'"),
        (ZeroDivisionError("of nothing"), "a fault in the program, which the terminal tells"),
    ],
)
def test_a_tab_goes_on_after_whatever_goes_wrong(
    opened: Open,
    with_run: Workspace,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    words: str,
) -> None:
    def broken(*_given: object) -> None:
        raise error

    monkeypatch.setattr(Background, "stop", broken)
    tab, screen = opened(on_shown=lambda: broken(), base="first")
    until(lambda: screen.told)
    before = len(screen.shown)
    tab.emit(act.StopRun())
    until(lambda: len(screen.told) == 2)
    until(lambda: len(screen.shown) > before)  # or its own picture would be one that fails
    assert all(title == "That did not work" and words in said for title, said in screen.told)
    assert ("of nothing" in capsys.readouterr().err) == isinstance(error, ZeroDivisionError)
    monkeypatch.setattr(Screen, "show", broken)
    tab.emit(act.TogglePlay())
    until(lambda: len(screen.told) >= 3)
    until(lambda: not tab.view.playing)
    tab.emit(act.Nudge(0, 1))
    until(with_run.store.poses)
    tab.close()
    tab.wait(30.0)  # while the errors are still caught: each picture of the tab's is one


def test_a_tab_goes_on_when_the_terminal_is_gone(
    opened: Open, with_run: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_given: object) -> None:
        raise ZeroDivisionError

    terminal = io.StringIO()
    terminal.close()
    monkeypatch.setattr(Background, "stop", broken)
    tab, screen = opened(base="first")
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", terminal)
        tab.emit(act.StopRun())
        until(lambda: screen.told)
    tab.emit(act.Nudge(0, 1))
    until(with_run.store.poses)
