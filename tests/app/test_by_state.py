"""Joined parts go where the state has them: in the frame, in a range, and in their joints."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hand_edits import JAW, RANGE, Do

from asdfviz.annotate.records import BY_STATE, TRACKED
from asdfviz.app import actions as act
from asdfviz.app.by_state import told_off, told_parts
from asdfviz.app.desk import NothingLeft
from asdfviz.app.joined import Joined, base_by_group
from asdfviz.app.panels import placing
from asdfviz.app.snapshot import take
from asdfviz.app.truths import drawn_truth
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Assembly
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, transform_from, turn_about

NOTHING = View(place=1, base=None)
"""Nothing is drawn but what was corrected."""
T_CAMERA_BASE = transform_from(np.diag([1.0, -1.0, -1.0]), np.array([0.02, 0.01, 0.5]))


def T_of(workspace: Workspace, part: str, place: int, base: str | None = None) -> Transform:
    return workspace.poses(place, base)[part].T_camera_part


def put_base(workspace: Workspace, *places: int, by: str = "manual") -> None:
    for place in places:
        T = T_CAMERA_BASE.copy()
        T[0, 3] += 0.001 * place
        workspace.store.set_pose(workspace.indices[place], "base", T, provenance=by)


def test_all_joined_parts_go_where_the_state_has_them(with_run: Workspace, do: Do) -> None:
    put_base(with_run, 1)
    do(act.SetState(2), NOTHING)
    done = do(act.PlaceJoined(), NOTHING, now=1.0)
    assert done.message == "jaw and bolt placed by the state in frame 101"
    state = with_run.assembly.states[2]
    T_base = T_of(with_run, "base", 1)
    assert T_of(with_run, "jaw", 1) == pytest.approx(T_base @ state.T_base_part["jaw"])
    shown = with_run.poses(1, None)
    assert {name: pose.stage for name, pose in shown.items()} == {
        "base": "annotated",
        "jaw": "group",
        "bolt": "group",
    }
    undone = do(act.Undo(), NOTHING)
    assert undone.message == "undid: placing by the state of jaw and bolt in frame 101"
    assert set(with_run.poses(1, None)) == {"base"}


def test_a_range_is_filled_where_the_base_stands(with_run: Workspace, do: Do) -> None:
    view = replace(RANGE, base=None)
    do(act.SetState(1), view)
    put_base(with_run, 2, 4)
    with_run.store.remove_pose(with_run.indices[4], "jaw")
    done = do(act.PlaceJoined(), view)
    lack = "nothing tells where the group is in 1 of them"
    assert done.message == f"jaw placed by the state in 1 of frames 102 to 104; {lack}"
    assert "jaw" in with_run.poses(2, None)
    # The base has no pose in one, and somebody said that the jaw is not in the other.
    assert "jaw" not in with_run.poses(3, None)
    assert "jaw" not in with_run.poses(4, None)


def test_what_was_set_stays_and_what_followed_follows_again(with_run: Workspace, do: Do) -> None:
    view = replace(RANGE, base=None)
    do(act.SetState(1), view)
    put_base(with_run, 2, 3)
    by_hand = transform_from(np.eye(3), np.array([0.0, 0.0, 0.7]))
    with_run.store.set_pose(with_run.indices[3], "jaw", by_hand)
    do(act.PlaceJoined(), view)
    before = T_of(with_run, "jaw", 2)
    moved = T_of(with_run, "base", 2).copy()
    moved[1, 3] += 0.05
    with_run.store.set_pose(with_run.indices[2], "base", moved, provenance=TRACKED)
    do(act.PlaceJoined(), view)
    assert T_of(with_run, "jaw", 2)[1, 3] - before[1, 3] == pytest.approx(0.05)
    assert np.array_equal(T_of(with_run, "jaw", 3), by_hand)


def test_the_base_is_told_by_a_part_that_cannot_move(clamp: Assembly) -> None:
    state = clamp.states[1]
    poses = {"jaw": T_CAMERA_BASE @ state.T_base_part["jaw"]}
    assert base_by_group(clamp, state, poses) is None  # it slides
    stuck = replace(state, joints={})
    assert base_by_group(clamp, stuck, poses) == pytest.approx(T_CAMERA_BASE)


def test_a_part_in_a_joint_goes_where_it_was_last_seen_in_it(with_run: Workspace, do: Do) -> None:
    state = with_run.assembly.states[2]
    joint = state.joints["bolt"]
    put_base(with_run, 1, 3)
    do(act.SetState(2), replace(NOTHING, marked=(1, 3)))
    slid = np.eye(4)
    slid[:3, 3] = joint.axis * (0.7 * joint.slide[1] + 0.3 * joint.slide[0])
    T_base_bolt = slid @ turn_about(joint.axis, joint.origin, 0.4) @ state.T_base_part["bolt"]
    with_run.store.set_pose(with_run.indices[1], "bolt", T_of(with_run, "base", 1) @ T_base_bolt)
    do(act.PlaceJoined(), replace(NOTHING, place=3))
    found = inverse(T_of(with_run, "base", 3)) @ T_of(with_run, "bolt", 3)
    middle = with_run.assembly.parts["bolt"].middle
    expected = T_base_bolt[:3, :3] @ middle + T_base_bolt[:3, 3]
    assert found[:3, :3] @ middle + found[:3, 3] == pytest.approx(expected, abs=1e-6)


def test_placing_the_selected_part_asks_the_state_first(with_run: Workspace, do: Do) -> None:
    put_base(with_run, 1)
    do(act.SetState(1), NOTHING)
    view = replace(JAW, base=None)
    done = do(act.PlacePart(), view)
    assert done.message == "jaw placed by the state in frame 101"
    kept = with_run.store.pose(101, "jaw")
    assert kept is not None
    assert kept.provenance == BY_STATE
    # A pixel is a person's own word, and the bolt is not joined yet.
    assert do(act.PlacePart(100.0, 100.0), view).message == "jaw placed in frame 101"
    loose = do(act.PlacePart(), replace(view, selected="bolt"))
    assert loose.message == "bolt placed in frame 101"


def test_a_part_that_has_a_pose_is_not_put_into_the_middle(with_run: Workspace, do: Do) -> None:
    """The run has poses of all parts in frame 101, whose state joins none of them."""
    before = T_of(with_run, "jaw", 1, "first")
    do(act.SetState(0), JAW)
    with pytest.raises(AnnotationError, match="jaw keeps its pose in frame 101, since it is not"):
        do(act.PlacePart(), JAW)
    assert with_run.store.pose(101, "jaw") is None
    assert T_of(with_run, "jaw", 1, "first") == pytest.approx(before)
    do(act.RemovePart(), JAW, now=1.0)
    assert do(act.PlacePart(), JAW, now=2.0).message == "jaw placed in frame 101"


@pytest.mark.parametrize(
    ("prepare", "why"),
    [
        ((), "the state of frame 101 is not known"),
        ((0,), "nothing is joined to base in the state of frame 101"),
        ((1,), "place base first"),
    ],
)
def test_what_is_missing_is_said(
    with_run: Workspace, do: Do, prepare: tuple[int, ...], why: str
) -> None:
    for state in prepare:
        do(act.SetState(state), NOTHING)
    view = NOTHING
    if not prepare:  # the tiny sequence's own truth knows every state
        with_run.truths = (None,) * len(with_run.truths)
        with_run.put_run(with_run.runs[0].run, "first")
    with pytest.raises(AnnotationError, match=why):
        do(act.PlaceJoined(), view)


def slid(workspace: Workspace, place: int, part: str, share: float) -> Transform:
    """T_camera_part in its joint of state 2, so far along its slide."""
    state = workspace.assembly.states[2]
    joint = state.joints[part]
    T_slide = np.eye(4)
    T_slide[:3, 3] = joint.axis * (share * joint.slide[1] + (1 - share) * joint.slide[0])
    return T_of(workspace, "base", place) @ T_slide @ state.T_base_part[part]


def at(workspace: Workspace, place: int) -> Transform:
    """T_base_jaw."""
    return inverse(T_of(workspace, "base", place)) @ T_of(workspace, "jaw", place)


@pytest.mark.parametrize("seen", [0, 3, 7])
def test_joints_are_looked_up_before_within_and_after(
    with_run: Workspace, do: Do, seen: int
) -> None:
    put_base(with_run, *range(8))
    do(act.SetState(2), replace(NOTHING, marked=(0, 7)))
    with_run.store.set_pose(with_run.indices[seen], "jaw", slid(with_run, seen, "jaw", 0.9))
    do(act.PlaceJoined(), replace(NOTHING, place=2, marked=(1, 4)))
    for place in {1, 2, 4} - {seen}:
        assert at(with_run, place)[:3, 3] == pytest.approx(at(with_run, seen)[:3, 3], abs=1e-6)


def test_a_pose_out_of_the_joint_tells_nothing_of_it(with_run: Workspace, do: Do) -> None:
    put_base(with_run, 0, 2, 3)
    do(act.SetState(2), replace(NOTHING, marked=(0, 7)))
    with_run.store.set_pose(with_run.indices[0], "jaw", slid(with_run, 0, "jaw", 0.9))
    with_run.store.set_pose(with_run.indices[2], "jaw", T_CAMERA_BASE + 0.2 * np.eye(4, k=3))
    do(act.PlaceJoined(), replace(NOTHING, place=3))
    assert at(with_run, 3)[:3, 3] == pytest.approx(at(with_run, 0)[:3, 3], abs=1e-6)


def test_a_fixed_part_does_not_tell_where_it_is_itself(
    with_run: Workspace, do: Do, clamp: Assembly
) -> None:
    fixed = replace(clamp.states[1], joints={})
    with_run.assembly = replace(clamp, states=(clamp.states[0], fixed, *clamp.states[2:]))
    do(act.SetState(1), NOTHING)
    view = replace(JAW, base=None)
    wrong = T_CAMERA_BASE + 0.2 * np.eye(4, k=3)
    with_run.store.set_pose(101, "jaw", wrong)
    assert told_parts(with_run, 1, None) == {"base"}
    with pytest.raises(AnnotationError, match="no other part tells where"):
        do(act.PlacePart(), view)
    put_base(with_run, 1)
    do(act.PlacePart(), view)
    assert T_of(with_run, "jaw", 1) == pytest.approx(
        T_of(with_run, "base", 1) @ fixed.T_base_part["jaw"]
    )
    # It was a person's, and stays one: tracking begins at it.
    kept = with_run.store.pose(101, "jaw")
    assert kept is not None
    assert kept.provenance == "placed"


def test_what_followed_from_a_state_that_is_no_more_is_taken_away(
    with_run: Workspace, do: Do
) -> None:
    put_base(with_run, 1)
    do(act.SetState(2), NOTHING)
    do(act.PlaceJoined(), NOTHING, now=1.0)
    with pytest.raises(NothingLeft, match="every joined part is where the state has it already"):
        do(act.PlaceJoined(), NOTHING, now=2.0)
    do(act.SetState(1), NOTHING, now=3.0)
    done = do(act.PlaceJoined(), NOTHING, now=4.0)
    assert done.message == "bolt taken away, since the state does not join it in frame 101"
    assert set(with_run.poses(1, None)) == {"base", "jaw"}


def test_what_others_set_meanwhile_stays(
    with_run: Workspace, do: Do, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_base(with_run, 1)
    do(act.SetState(2), NOTHING)
    store = with_run.store
    placed = Joined.placed

    def slow(self: Joined, *args: Any) -> Any:
        found = placed(self, *args)
        store.remove_pose(101, "jaw")
        return found

    monkeypatch.setattr(Joined, "placed", slow)
    assert do(act.PlaceJoined(), NOTHING).message == "bolt placed by the state in frame 101"
    assert set(with_run.poses(1, None)) == {"base", "bolt"}


def test_of_a_range_it_is_said_how_much_of_it(with_run: Workspace, do: Do) -> None:
    everywhere = replace(NOTHING, place=3, marked=(0, 7))
    do(act.SetState(1), everywhere)
    put_base(with_run, 2, 3)
    done = do(act.PlaceJoined(), everywhere)
    assert done.message.startswith("jaw placed by the state in 2 of frames 100 to 107; nothing")
    with pytest.raises(AnnotationError, match="where the others are in 6: place base"):
        do(act.PlaceJoined(), everywhere)


def test_an_edit_in_one_tab_waits_for_no_other(with_run: Workspace, do: Do) -> None:
    """Edits hold the store's lock and ask for runs; refreshes ask the store. Both at once went dead."""
    end = threading.Event()

    def refresh() -> None:
        while not end.is_set():
            with_run.facts()
            with_run.lane("jaw", "first")

    other = threading.Thread(target=refresh, daemon=True)
    other.start()
    try:
        for i in range(30):
            edit = threading.Thread(
                target=do, args=(act.VerifyPart(), RANGE), kwargs={"now": float(i)}, daemon=True
            )
            edit.start()
            edit.join(20)
            assert not edit.is_alive()
            do(act.Undo(), RANGE, now=i + 0.5)
    finally:
        end.set()
        other.join(20)


def test_what_no_longer_fits_its_base_is_told(with_run: Workspace, do: Do) -> None:
    put_base(with_run, 1, 2)
    view = replace(NOTHING, marked=(1, 2))
    do(act.SetState(2), view)
    do(act.PlaceJoined(), view, now=1.0)
    assert told_off(with_run, None, drawn_truth(with_run, None)) == ""
    snap = take(with_run, NOTHING, frame=None)
    assert "2 by the state</span>" in placing.joined(snap)
    moved = T_of(with_run, "base", 1).copy()
    moved[0, 3] += 0.015
    with_run.store.set_pose(101, "base", moved, provenance=TRACKED)
    assert "in 1 frame: mark" in told_off(with_run, None, drawn_truth(with_run, None))
    snap = take(with_run, NOTHING, frame=None)
    assert "2 by the state no longer fit" in placing.joined(snap)
    do(act.PlaceJoined(), view, now=2.0)
    assert told_off(with_run, None, drawn_truth(with_run, None)) == ""
