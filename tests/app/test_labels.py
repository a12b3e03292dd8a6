"""States of frames: set by keys one after the other, once more, and taken away."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hand_edits import JAW, RANGE, Do

from asdfviz.annotate.records import StateLabel, label_of
from asdfviz.app import actions as act
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError


def labels(workspace: Workspace) -> list[int | None]:
    found = [workspace.store.state(index) for index in workspace.indices]
    return [None if label is None or label.is_error else label.state for label in found]


def test_a_key_sets_the_state_beside_the_one_that_is_shown(with_run: Workspace, do: Do) -> None:
    done = do(act.NextState(1), RANGE)
    name = with_run.assembly.states[2].name
    assert (done.message, done.state) == (f"state of frames 102 to 104: {name}", 2)
    assert labels(with_run) == [None, None, 2, 2, 2, None, None, None]
    do(act.NextState(-1), replace(RANGE, marked=None), now=1.0)
    assert labels(with_run) == [None, None, 2, 1, 2, None, None, None]
    assert with_run.store.seed().kind == "run"
    do(act.Undo())
    assert labels(with_run) == [None, None, 2, 2, 2, None, None, None]


def test_an_error_lies_between_two_states(with_run: Workspace, do: Do) -> None:
    error = with_run.assembly.errors[0]
    for by, state in ((1, error.completed + 1), (-1, error.completed)):
        with_run.store.set_state(101, label_of(error))
        do(act.NextState(by), JAW, now=float(by))
        assert labels(with_run)[1] == state


def test_a_key_sets_the_errors_that_can_follow_one_after_the_other(
    with_run: Workspace, do: Do, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = with_run.assembly.errors[0]
    second = replace(first, index=first.index + 1, name="jaw_upside_down")
    states = (*with_run.assembly.states, second)
    monkeypatch.setattr(with_run, "assembly", replace(with_run.assembly, states=states))
    do(act.SetState(first.completed), RANGE)
    for now, error in enumerate((first, second, first), start=1):
        done = do(act.NextError(), RANGE, now=float(now))
        assert (done.message, done.state) == (
            f"state of frames 102 to 104: {error.name}",
            error.index,
        )
        assert [with_run.store.state(f) for f in (102, 104, 105)] == [*[label_of(error)] * 2, None]


def test_where_no_error_can_follow_it_is_said_after_what_one_can(
    with_run: Workspace, do: Do, monkeypatch: pytest.MonkeyPatch
) -> None:
    assembly = with_run.assembly
    step = assembly.states[assembly.errors[0].completed].name
    with pytest.raises(
        AnnotationError, match=f"follows the step of frame 107; errors follow {step}"
    ):
        do(act.NextError(), View(place=7, base="first"))
    monkeypatch.setattr(with_run, "assembly", replace(assembly, states=assembly.steps))
    with pytest.raises(AnnotationError, match=f"{assembly.name} has none"):
        do(act.NextError())
    with_run.drop_run("first")
    with_run.truths = (None,) * len(with_run.indices)
    with pytest.raises(AnnotationError, match="no state is known in frame 104: Shift N sets"):
        do(act.NextError(), View(place=4))
    assert with_run.store.version() == 0


def test_states_end(with_run: Workspace, do: Do) -> None:
    with pytest.raises(AnnotationError, match="frame 101 is in the first state already"):
        do(act.NextState(-1))
    with pytest.raises(
        AnnotationError, match="frame 107 is in the last state already; Shift X sets"
    ):
        do(act.NextState(1), View(place=7, base="first"))
    assert with_run.store.version() == 0


def test_where_no_state_is_known_the_first_comes_next(with_run: Workspace, do: Do) -> None:
    with_run.drop_run("first")
    with_run.truths = (None,) * len(with_run.indices)
    nowhere = View(place=4)
    with pytest.raises(AnnotationError, match="no state is known in frame 104"):
        do(act.NextState(-1), nowhere)
    do(act.NextState(1), View(place=4))
    assert with_run.store.state(104) == label_of(with_run.assembly.states[0])


def test_the_state_that_was_set_last_is_set_once_more(with_run: Workspace, do: Do) -> None:
    with pytest.raises(AnnotationError, match="no state was set yet"):
        do(act.RepeatState())
    error = with_run.assembly.errors[0]
    do(act.RepeatState(), replace(RANGE, state=error.index))
    kept = StateLabel(error.completed, True, error.name, error.attached)
    assert [with_run.store.state(frame) for frame in (102, 104, 105)] == [kept, kept, None]


def test_a_label_is_taken_away(with_run: Workspace, do: Do) -> None:
    do(act.SetState(1), RANGE)
    assert do(act.ClearState(), View(place=3, base="first")).message == (
        "state label taken from frame 103"
    )
    assert [m is not None for m in with_run.rows()[0].marks] == [i in (2, 4) for i in range(8)]
    with pytest.raises(AnnotationError, match="no state was set by hand in frame 103"):
        do(act.ClearState(), View(place=3, base="first"))
    do(act.ClearState(), RANGE, now=1.0)
    assert not any(with_run.rows()[0].marks)
    assert do(act.Undo()).message == "undid: state label taken from frames 102 to 104"
    assert [m is not None for m in with_run.rows()[0].marks] == [i in (2, 4) for i in range(8)]


def test_where_nothing_is_known_the_next_state_follows_from_the_last_that_is(
    with_run: Workspace, do: Do
) -> None:
    """The run says no state in frame 104, and the second one before it."""
    with_run.truths = (None,) * len(with_run.truths)
    with_run.put_run(with_run.runs[0].run, "first")
    assert with_run.mark(4, "first")[0] is None
    assert do(act.NextState(1), replace(JAW, place=4)).state == 2
    assert do(act.NextState(1), View(place=2, base=None)).state == 0
