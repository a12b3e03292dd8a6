"""Every rule of the view, without a browser."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from asdfviz.app import actions as act
from asdfviz.app.bridge import parse
from asdfviz.app.places import edited
from asdfviz.app.resuming import kept
from asdfviz.app.session import settled, update
from asdfviz.app.view import TRUTH, Facts, View

FACTS = Facts(
    count=10,
    parts=("base", "jaw", "bolt"),
    boundaries=(0, 3, 6),
    runs=("a", "b"),
    preferred="a",
    has_truth=True,
    is_corrected=False,
    K=np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]),
    size_wh=(640, 480),
)


def after(view: View, *actions: act.Action) -> View:
    for action in actions:
        view = update(view, action, FACTS)
    return view


@pytest.mark.parametrize(
    ("start", "action", "place"),
    [
        (0, act.Step(1), 1),
        (0, act.Step(-1), 0),
        (9, act.Step(10), 9),
        (4, act.Seek(10**8), 9),
        (4, act.Seek(-5), 0),
        (4, act.ToBoundary(1), 6),
        (4, act.ToBoundary(-1), 3),
        (3, act.ToBoundary(-1), 0),
        (6, act.ToBoundary(1), 9),
    ],
)
def test_going_to_frames(start: int, action: act.Action, place: int) -> None:
    assert after(View(place=start), action).place == place


def test_play_begins_anew_at_the_end_and_a_step_pauses() -> None:
    playing = after(View(place=9), act.TogglePlay())
    assert (playing.playing, playing.place) == (True, 0)
    assert not after(playing, act.Step(1)).playing
    assert not after(playing, act.TogglePlay()).playing


def test_one_frame_does_not_play() -> None:
    assert not update(View(), act.TogglePlay(), replace(FACTS, count=1)).playing


def test_an_edit_pauses() -> None:
    assert not after(View(playing=True), act.Nudge(0, 1)).playing


@pytest.mark.parametrize(("given", "kept"), [(0.0, 0.25), (2.0, 2.0), (99.0, 4.0)])
def test_speed_is_kept_in_bounds(given: float, kept: float) -> None:
    assert after(View(), act.SetSpeed(given)).speed == kept


def test_views_change_places_the_camera_anew() -> None:
    view = after(View(), act.ToggleView())
    assert (view.mode, view.turns) == ("3d", 1)
    assert after(view, act.ToggleView()).mode == "ar"
    # Zoom belongs to AR.
    assert after(view, act.Zoom(2.0)).zoom == 1.0


def test_a_page_that_comes_back_goes_on_where_it_was() -> None:
    view = after(View(), act.Resume(7, "3d"))
    assert (view.place, view.mode, view.turns) == (7, "3d", 1)
    again = after(view, act.Resume(99, "3d"))
    assert (again.place, again.turns) == (9, 1)


def test_a_page_that_comes_back_looks_as_it_did() -> None:
    view = View(
        page="0123abcd",
        place=7,
        mode="3d",
        tab="annotate",
        selected="jaw",
        base="a",
        chosen=True,
        zoom=2.5,
        centre=(100.0, 50.0),
        opacity=0.3,
        step=2,
        gizmo="off",
        speed=2.0,
        overlay=False,
        xray=True,
        together=True,
        hidden=frozenset({"bolt"}),
        layers=frozenset({"b"}),
    )
    told = parse(json.dumps({"kind": "Resume", **asdict(kept(view))}))
    assert told == kept(view)
    assert told is not None
    again = after(View(page="89ef4567"), told)
    assert again == replace(view, page="89ef4567", turns=1)
    # A part may be selected in any tab, and nobody thinks of a range any more.
    marked = after(View(), kept(replace(view, tab="results", marked=(1, 3))))
    assert (marked.tab, marked.selected, marked.marked) == ("results", "jaw", None)


def test_a_page_that_comes_back_gets_what_is_still_here() -> None:
    told = act.Resume(
        0, "ar", selected="gone", base="gone", zoom=1e9, centre=(-5.0, 1e9), opacity=-1.0, step=99
    )
    told = replace(told, hidden=("gone", "jaw"), layers=("gone", "a"), speed=1e9)
    view = after(View(), told)
    assert (view.selected, view.base, view.chosen) == (None, None, False)
    assert (view.zoom, view.centre, view.opacity, view.step) == (16.0, (0.0, 479.0), 0.05, 3)
    assert (view.hidden, view.layers, view.speed) == ({"jaw"}, {"a"}, 4.0)
    # Corrections have begun from another run meanwhile.
    begun = after(View(base="b", chosen=True), replace(told, base="a"))
    assert begun.base == "b"


def test_another_window_keeps_the_free_camera() -> None:
    assert after(View(), act.Resized(2.0)).turns == 1
    assert after(View(mode="3d"), act.Resized(2.0)).turns == 0
    assert after(View(), act.Drifted()).turns == 1
    assert after(View(mode="3d"), act.Drifted()).turns == 0


def test_zoom_and_fit() -> None:
    view = after(View(), act.Zoom(2.0, 0.5, 0.5))
    assert view.zoom == pytest.approx(2.0)
    assert view.centre is not None
    assert view.centre[0] > 320
    assert after(view, act.FitView()).centre is None
    assert after(view, act.Zoom(-1.0)) == view
    # There is nothing beyond the window's edge.
    assert after(View(), act.Zoom(2.0, 1e308, -1e308)) == after(View(), act.Zoom(2.0, 1.0, -1.0))


def test_looking_around_counts_only_when_magnified() -> None:
    assert after(View(), act.Look(10.0, 10.0)).centre is None
    assert after(View(zoom=2.0), act.Look(9999.0, -4.0)).centre == (639.0, 0.0)


def test_a_part_may_be_gone_to_without_leaving_the_tab() -> None:
    view = View(tab="results", hidden=frozenset({"jaw"}), selected="bolt")
    gone = after(view, act.Seek(3, "jaw"))
    assert (gone.place, gone.selected, gone.hidden) == (3, "jaw", frozenset())
    assert gone.tab == "results"
    for action in (act.Seek(3), act.Seek(3, "unheard-of")):
        assert after(view, action).selected == "bolt"


def test_parts_are_selected_in_a_circle() -> None:
    view = after(View(), act.NextPart(1))
    assert (view.selected, view.tab) == ("base", "annotate")
    assert after(view, act.NextPart(-1)).selected == "bolt"
    assert after(View(), act.NextPart(-1)).selected == "bolt"
    assert after(view, act.SelectPart("unheard-of")).selected is None


def test_selecting_a_hidden_part_shows_it() -> None:
    view = after(View(), act.TogglePart("jaw"))
    assert view.hidden == {"jaw"}
    assert after(view, act.SelectPart("jaw")).hidden == frozenset()


def test_layers() -> None:
    view = after(View(), act.ToggleLayerAt(2), act.ToggleLayerAt(3), act.ToggleLayerAt(4))
    assert view.layers == {"b", TRUTH}
    assert after(view, act.ToggleLayer("b")).layers == {TRUTH}
    assert after(view, act.ToggleLayer("gone")).layers == view.layers
    assert after(view, act.UseRun("b")).base == "b"
    assert after(view, act.UseRun("gone")).base is None


def test_toggles_and_opacity() -> None:
    view = after(View(), act.Toggle("overlay"), act.Toggle("xray"), act.SetOpacity(0.0))
    assert (view.overlay, view.xray, view.opacity) == (False, True, 0.05)


def test_step_sizes_go_round() -> None:
    view = View()
    seen = []
    for _ in range(4):
        view = after(view, act.CycleStep())
        seen.append(view.step)
    assert seen == [2, 3, 0, 1]


def test_the_gizmo_moves_turns_or_is_off() -> None:
    view = View()
    seen = []
    for _ in range(3):
        view = after(view, act.CycleGizmo())
        seen.append(view.gizmo)
    assert seen == ["turn", "off", "move"]
    assert after(view, act.SetGizmo("off")).gizmo == "off"


def test_a_range_follows_the_frame_until_it_is_ended() -> None:
    view = after(View(place=5), act.MarkRange(), act.Step(-3))
    assert view.frames == (2, 5)
    ended = after(view, act.MarkRange(), act.Seek(9))
    assert (ended.marked, ended.marking) == ((2, 5), None)
    assert ended.frames == (9, 9)  # a range counts only where one of its frames is shown
    back = after(ended, act.Seek(4))
    assert back.frames == (2, 5)
    assert after(back, act.Cancel()).frames == (4, 4)


def test_a_range_reaches_to_the_frame_where_it_is_ended() -> None:
    view = replace(after(View(place=5), act.MarkRange()), place=7)  # an undo went there
    assert after(view, act.MarkRange()).marked == (5, 7)
    again = after(View(place=9, marking=9, marked=(9, 9)), act.TogglePlay())
    assert again.marked == (0, 9)


def test_a_dragged_range_is_put_in_order_and_in_bounds() -> None:
    view = after(View(), act.SetRange(8, -3))
    assert view.frames == (0, 8)


def test_a_dragged_range_is_gone_to() -> None:
    assert [after(View(place=k), act.SetRange(3, 5)).place for k in (0, 4, 9)] == [3, 4, 5]
    # The hand that drags says which end is shown, whatever was shown on the way.
    dragged = after(View(place=9), act.SetRange(3, 3, 3), act.SetRange(3, 6, 6))
    assert (dragged.place, dragged.marked) == (6, (3, 6))
    assert after(View(), act.SetRange(3, 5, 8)).place == 5


def test_going_to_a_part_shows_the_truth_beside_it() -> None:
    worst = act.Seek(3, part="jaw")
    assert after(View(layers=frozenset({"a"})), worst).layers == {"a", TRUTH}
    assert after(View(), act.Seek(3)).layers == frozenset()
    assert update(View(), worst, replace(FACTS, has_truth=False)).layers == frozenset()


def test_a_statement_uses_its_range_up() -> None:
    view = View(place=4, marked=(3, 5))
    verdicts = (act.VerifyPart(), act.RemovePart(), act.RevertPart())
    for action in (act.SetState(1), act.ClearState(), *verdicts):
        assert edited(view, action, 4, FACTS).marked is None
    assert edited(view, act.Nudge(0, 1), 4, FACTS).marked == (3, 5)


@pytest.mark.parametrize("place", [0, 4, 7])
def test_undo_that_leads_elsewhere_leaves_a_range_as_it_was_marked(place: int) -> None:
    view = after(View(place=3), act.MarkRange(), act.Step(1), act.Step(1))
    for action in (act.Undo(), act.Redo()):
        led = edited(view, action, place, FACTS)
        assert (led.place, led.marked) == (place, (3, 5))
        assert after(led, act.Step(1)).marked == (3, 5)
    # What is undone in the frame shown leads nowhere.
    assert after(edited(view, act.Undo(), 5, FACTS), act.Step(1)).marked == (3, 6)


def test_keys_that_go_through_states_serve_one_range() -> None:
    view = edited(View(place=4, marked=(3, 5)), act.NextState(1), 4, FACTS, state=1)
    view = edited(view, act.NextState(1), 4, FACTS, state=2)
    assert (view.frames, view.state) == ((3, 5), 2)
    assert after(view, act.Step(1)).marked is None
    assert after(view, act.Step(1), act.Step(-1)).frames == (4, 4)
    assert edited(view, act.RepeatState(), 4, FACTS, state=2).marked is None
    for anew in (act.SetRange(2, 6), act.MarkRange()):
        assert after(view, anew, act.Step(1)).marked is not None


def test_states_that_were_set_are_remembered() -> None:
    view = edited(View(), act.SetState(3), 0, FACTS, state=3)
    assert edited(view, act.ClearState(), 0, FACTS).state == 3


def test_cancel_takes_one_thing_at_a_time() -> None:
    view = View(keys=True, marked=(1, 2), selected="jaw")
    view = after(view, act.Cancel())
    assert (view.keys, view.marked) == (False, (1, 2))
    view = after(view, act.Cancel())
    assert (view.marked, view.selected) == (None, "jaw")
    assert after(view, act.Cancel()).selected is None


def test_what_is_gone_is_no_longer_shown() -> None:
    view = View(place=20, base="gone", layers=frozenset({"gone", "b"}), selected="gone")
    kept = settled(view, FACTS)
    assert (kept.place, kept.base, kept.layers, kept.selected) == (9, "a", {"b"}, None)


def test_without_runs_the_truth_is_drawn_and_without_truth_nothing() -> None:
    bare = replace(FACTS, runs=(), preferred=None)
    assert settled(View(), bare).base == TRUTH
    assert settled(View(), replace(bare, has_truth=False)).base is None
    # The first run takes over, but not from somebody who chose the truth.
    assert settled(settled(View(), bare), FACTS).base == "a"
    assert settled(after(View(), act.UseRun(TRUTH)), FACTS).base == TRUTH


@pytest.mark.parametrize("pick", [act.SelectPart("jaw"), act.NextPart(1), act.Seek(3, part="jaw")])
def test_the_first_run_takes_nothing_out_of_hands(pick: act.Action) -> None:
    bare = replace(FACTS, runs=(), preferred=None)
    held = after(settled(View(), bare), pick)
    assert settled(held, FACTS).base == TRUTH
    assert settled(after(held, act.Cancel()), FACTS).base == TRUTH
    # Nothing was drawn without truth: the run's poses are news then, not a change.
    empty = replace(bare, has_truth=False)
    assert settled(after(settled(View(), empty), pick), FACTS).base == "a"


def test_the_first_run_changes_nothing_that_was_corrected() -> None:
    bare = replace(FACTS, runs=(), preferred=None)
    assert settled(settled(View(), bare), replace(FACTS, is_corrected=True)).base == TRUTH


@pytest.mark.parametrize("action", [act.Undo(), act.Export(), act.Changed(), act.StopRun()])
def test_what_is_no_matter_of_the_view_leaves_it(action: Any) -> None:
    assert update(View(), action, FACTS) == View()


def test_a_range_beyond_the_sequence_is_cut_to_it() -> None:
    assert after(View(), act.SetRange(5000, 6000)).marked == (9, 9)
    assert after(View(), act.SetRange(-8, -3)).marked == (0, 0)


def test_joined_parts_may_follow_a_state_that_was_set_for_a_range() -> None:
    view = edited(View(place=4, marked=(2, 6)), act.SetState(1), 4, FACTS, state=1)
    assert (view.marked, view.joined) == (None, (2, 6))
    assert after(view, act.Step(1)).joined == (5, 5)
    assert after(view, act.Step(1), act.Step(-1)).joined == (4, 4)
    again = edited(view, act.SetState(2), 4, FACTS, state=2)  # of this frame alone
    assert again.joined == (4, 4)
    moved = after(view, act.SetRange(7, 7))
    assert after(moved, act.Cancel()).joined == (7, 7)
    assert edited(view, act.Undo(), 4, FACTS).joined == (4, 4)
    assert edited(view, act.PlaceJoined(), 4, FACTS).joined == (2, 6)
