"""What is exported of corrections that started from a run: what somebody answers for."""

from __future__ import annotations

import numpy as np

from asdfviz.annotate.checked import Checked, checked_truth
from asdfviz.annotate.records import StateLabel
from asdfviz.annotate.store import AnnotationStore
from asdfviz.datatypes import Assembly, FrameTruth

T = np.eye(4)


def guessed(*frames: int) -> dict[int, FrameTruth]:
    """A run's: both parts, and a state, in every frame."""
    return {
        i: FrameTruth(i, {"base": T, "lid": T}, state=1, is_error=False, attached=("base",))
        for i in frames
    }


def test_poses_that_nobody_touched_are_guesses(store: AnnotationStore, boxes: Assembly) -> None:
    store.set_pose(5, "lid", T)
    store.verify(6, "base", T, provenance="method:asdf")
    truth = guessed(4, 5, 6, 8)
    found = checked_truth(store, truth, boxes)
    told = {frame: set(found.truth[frame].T_camera_part) for frame in found.truth}
    assert told == {5: {"lid"}, 6: {"base"}}
    assert all(frame.state is frame.attached is None for frame in found.truth.values())
    assert {i: frame.unchecked for i, frame in found.truth.items()} == {
        5: ("base", "pin"),
        6: ("lid", "pin"),
    }
    assert (found.frames, found.poses) == (2, 2)
    assert found.told == (
        "2 frames left out in which nobody checked a pose; "
        "2 poses left out that nobody checked, beside checked parts"
    )


def test_a_part_that_was_taken_away_beside_guesses_is_known_not_to_be_there(
    store: AnnotationStore, boxes: Assembly
) -> None:
    store.remove_pose(7, "lid")
    found = checked_truth(store, {7: FrameTruth(7, {"base": T}, state=1, is_error=False)}, boxes)
    frame = found.truth[7]
    assert (dict(frame.T_camera_part), frame.lists_parts, frame.state) == ({}, True, None)
    assert frame.unchecked == ("base", "pin")
    assert found.told == "1 pose left out that nobody checked, beside checked parts"


def test_a_frame_whose_parts_are_all_taken_away_says_so(
    store: AnnotationStore, boxes: Assembly
) -> None:
    for part in ("base", "lid"):
        store.remove_pose(5, part)
    found = checked_truth(store, {5: FrameTruth(5, {}, None)}, boxes)
    assert found == Checked({5: found.truth[5]})
    assert found.truth[5].T_camera_part == {}
    assert found.truth[5].unchecked == ("pin",)


def test_a_state_that_was_set_brings_no_poses(store: AnnotationStore, boxes: Assembly) -> None:
    store.set_state(5, StateLabel(0), last_frame=6)
    store.set_state(6, None)
    found = checked_truth(store, guessed(5, 6), boxes)
    assert sorted(found.truth) == [5]
    assert found.truth[5].T_camera_part == {}
    assert found.truth[5].state == 1  # as it came: the label is in the truth that is given
    assert found.frames == 2


def test_where_all_is_checked_nothing_is_told(store: AnnotationStore, boxes: Assembly) -> None:
    for part in ("base", "lid"):
        store.set_pose(5, part, T)
    assert checked_truth(store, guessed(5), boxes).told == ""
    assert Checked(guessed(5)).told == ""
