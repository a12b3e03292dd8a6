"""Joined parts go where the state has them: in the frame, in a range, and in their joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_edits import JAW, RANGE, Do

from asdfviz.annotate.records import BY_STATE, TRACKED
from asdfviz.app import actions as act
from asdfviz.app.by_state import base_by_group, can_place
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
    assert done.message == "jaw placed by the state in frames 102 to 104"
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
    assert can_place(clamp, stuck, poses, "base")
    assert not can_place(clamp, stuck, poses, "bolt")
    assert not can_place(clamp, None, poses, "base")


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


@pytest.mark.parametrize(
    ("prepare", "why"),
    [
        ((), "the state of frame 101 is not known"),
        ((0,), "nothing is joined to base"),
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
