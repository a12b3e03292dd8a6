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
    poses = {"base": T, "lid": T}
    return {i: FrameTruth(i, poses, state=1, is_error=False, attached=("base",)) for i in frames}


def test_frames_that_nobody_touched_are_guesses(store: AnnotationStore, boxes: Assembly) -> None:
    store.set_pose(5, "lid", T)
    store.verify(6, "base", T, provenance="method:asdf")
    store.remove_pose(7, "lid")
    found = checked_truth(store, guessed(4, 5, 6, 7, 8), boxes)
    assert sorted(found.truth) == [5, 6, 7]
    assert all(set(frame.T_camera_part) == {"base", "lid"} for frame in found.truth.values())
    assert all(frame.state is frame.attached is None for frame in found.truth.values())
    assert (found.frames, found.poses) == (2, 3)
    assert found.told == (
        "2 frames left out in which nobody checked a pose; "
        "3 poses as the run has them, beside checked ones"
    )


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
