"""Verdicts: what is not in a frame, and what was looked at."""

from __future__ import annotations

import numpy as np
import pytest
from hand_edits import RANGE, Do

from asdfviz.app import actions as act
from asdfviz.app.editing import Edits
from asdfviz.app.view import TRUTH, View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError


def has_jaw(workspace: Workspace) -> list[bool]:
    return ["jaw" in workspace.poses(place, TRUTH) for place in range(8)]


def test_a_part_that_is_not_in_the_frame(with_run: Workspace, do: Do) -> None:
    done = do(act.RemovePart())
    assert (done.message, done.place) == ("jaw is not in frame 101", 1)
    assert has_jaw(with_run) == [place != 1 for place in range(8)]
    assert with_run.store.seed().kind == "run"
    with pytest.raises(AnnotationError, match="said not to be in frame 101 already"):
        do(act.RemovePart())
    assert do(act.Undo()).message == "undid: removed jaw in frame 101"
    assert all(has_jaw(with_run))
    assert with_run.store.seed().kind == "none"


def test_a_part_is_taken_out_of_a_range_in_one_step(with_run: Workspace, do: Do) -> None:
    assert do(act.RemovePart(), RANGE).message == "jaw is not in frames 102 to 104"
    assert has_jaw(with_run) == [place not in (2, 3, 4) for place in range(8)]
    assert do(act.Undo(), RANGE).message == "undid: removed jaw in 3 frames"
    assert all(has_jaw(with_run))


def test_what_was_said_is_dropped_along_a_range_in_one_step(with_run: Workspace, do: Do) -> None:
    do(act.RemovePart(), RANGE)
    do(act.RemovePart(), View(place=6, base="first", selected="jaw"), now=1.0)
    with_run.store.remove_pose(103, "base")
    done = do(act.RevertPart(), RANGE, now=2.0)
    assert done.message == "dropped the correction of jaw in frames 102 to 104"
    assert has_jaw(with_run) == [place != 6 for place in range(8)]
    assert "base" not in with_run.poses(3, TRUTH)
    with pytest.raises(AnnotationError, match="jaw was not corrected in frames 102 to 104"):
        do(act.RevertPart(), RANGE, now=3.0)
    said = do(act.Undo(), RANGE).message
    assert said == "undid: drop of the correction of jaw in 3 frames"
    assert has_jaw(with_run) == [place not in (2, 3, 4, 6) for place in range(8)]


def test_what_is_joined_goes_along_if_it_is_to(with_run: Workspace, do: Do) -> None:
    together = View(place=3, base="first", selected="jaw", together=True)  # base and jaw
    assert (
        do(act.VerifyPart(), together).message == "jaw and 1 joined with it verified in frame 103"
    )
    assert set(with_run.store.poses()) == {(103, "base"), (103, "jaw")}
    do(act.RemovePart(), together, now=1.0)
    assert set(with_run.poses(3, "first")) == {"bolt"}


def test_a_verified_pose_is_kept_as_it_came(with_run: Workspace, do: Do) -> None:
    before = with_run.poses(1, "first")["jaw"].T_camera_part
    assert do(act.VerifyPart()).message == "jaw verified in frame 101"
    said = with_run.store.pose(101, "jaw")
    assert said is not None
    assert said.T_camera_part is not None
    assert np.array_equal(said.T_camera_part, before)
    assert (said.verified, said.provenance) == (True, "method:asdf")
    do(act.Nudge(0, 1), now=1.0)  # moved since: nobody has looked at that
    do(act.VerifyPart(), now=2.0)
    said = with_run.store.pose(101, "jaw")
    assert said is not None
    assert (said.verified, said.provenance) == (True, "keys")


def test_verifying_again_takes_it_back_and_keeps_the_pose(with_run: Workspace, do: Do) -> None:
    store, said = with_run.store, with_run.said()
    do(act.VerifyPart())
    assert do(act.VerifyPart(), now=1.0).message == "jaw no longer verified in frame 101"
    # The run speaks again: nobody answers for its guess.
    assert with_run.said() == said == {}
    assert do(act.Undo()).message == "undid: unverified jaw in frame 101"
    assert with_run.said()[101, "jaw"] == ("verify", "method:asdf")
    do(act.Nudge(0, 1), now=2.0)
    moved = with_run.poses(1, "first")["jaw"].T_camera_part
    do(act.VerifyPart(), now=3.0)
    do(act.VerifyPart(), now=4.0)
    assert with_run.said()[101, "jaw"] == ("pose", "keys")
    assert np.array_equal(with_run.poses(1, "first")["jaw"].T_camera_part, moved)
    assert store.undo()[0].payload["unverified"]


def test_a_range_is_verified_and_no_longer_in_one_step_each(with_run: Workspace, do: Do) -> None:
    together = View(place=3, base="first", selected="jaw", marked=(2, 4), together=True)
    with_run.store.set_pose(102, "jaw", np.eye(4), provenance="tracked")
    do(act.VerifyPart(), View(place=4, base="first", selected="jaw"))
    assert do(act.VerifyPart(), RANGE, now=1.0).message == "jaw verified in frames 102 to 104"
    verified = with_run.said()
    assert [kind for kind, _ in verified.values()] == ["verify"] * 3
    do(act.VerifyPart(), together, now=2.0)  # the base beside it was not: that is
    said = with_run.said()
    assert {key for key in said if key not in verified} == {(103, "base"), (104, "base")}
    do(act.Undo(), RANGE)
    done = do(act.VerifyPart(), RANGE, now=3.0)
    assert done.message == "jaw no longer verified in frames 102 to 104"
    assert with_run.said() == {(102, "jaw"): ("pose", "tracked")}
    assert do(act.Undo(), RANGE).message == "undid: unverified jaw in 3 frames"
    assert with_run.said() == verified


def test_verifying_a_range_passes_over_frames_without_the_part(with_run: Workspace, do: Do) -> None:
    do(act.VerifyPart(), View(place=1, base="first", selected="jaw", marked=(0, 2)))
    assert set(with_run.store.poses()) == {(101, "jaw"), (102, "jaw")}
    with pytest.raises(AnnotationError, match="no pose in frame 100 that could be right"):
        do(act.VerifyPart(), View(place=0, base="first", selected="jaw"))


@pytest.mark.parametrize("action", [act.RemovePart(), act.VerifyPart(), act.RevertPart()])
def test_a_verdict_needs_a_part(do: Do, action: Edits) -> None:
    with pytest.raises(AnnotationError, match="no part is selected"):
        do(action, View(base="first"))
