"""The lane of poses: what it says of each frame, where it has gaps, and its HTML."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_sequence import make_run

from asdfviz.annotate.records import BY_STATE, TRACKED
from asdfviz.app import lanes
from asdfviz.app.editing import NothingLeft, gap_beside
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.geometry.transforms import transform_from

T = transform_from(np.eye(3), np.array([0.0, 0.0, 0.6]))


def annotate(workspace: Workspace) -> None:
    """The jaw: tracked, by hand, by the state, verified, gone; then only the run, which lacks frame 100."""
    store = workspace.store
    store.set_pose(101, "jaw", T, provenance=TRACKED)
    store.set_pose(102, "jaw", T, provenance="gizmo")
    store.set_pose(103, "jaw", T, provenance=BY_STATE)
    store.verify(104, "jaw", T, provenance="gizmo")
    store.remove_pose(105, "jaw")
    store.set_pose(106, "jaw", T)
    store.drop_pose(106, "jaw")


def test_it_says_where_poses_are_from(with_run: Workspace) -> None:
    annotate(with_run)
    lane = with_run.lane("jaw", "first")
    kinds = [cell.kind for cell in lane.cells]
    assert kinds == ["none", "tracked", "hand", "state", "verified", "gone", "base", "base"]
    assert lane.cells[7].say == "from asdf"
    assert [place for place, cell in enumerate(lane.cells) if cell.is_gap] == [0]
    alone = with_run.lane("jaw", None).cells
    assert [place for place, cell in enumerate(alone) if cell.is_gap] == [0, 6, 7]


def test_a_pose_is_copied_from_before_or_else_from_after(with_run: Workspace) -> None:
    annotate(with_run)
    lane = with_run.lane("jaw", None)
    assert [lane.source(place) for place in range(8)] == [1, 2, 1, 2, 3, 4, 4, 4]
    assert with_run.lane("base", None).source(3) is None


def test_of_all_parts_it_says_how_many(with_run: Workspace) -> None:
    annotate(with_run)
    cells = with_run.lane(None, "first").cells
    assert [cell.say for cell in cells[4:6]] == [
        "3 of 3 parts have a pose",
        "2 of 2 parts have a pose",
    ]
    assert cells[0].say == "2 of 3 parts have a pose"
    assert cells[0].is_gap
    assert not cells[5].is_gap
    assert cells[0].share == pytest.approx(2 / 3)
    assert with_run.lane(None, None).cells[0].kind == "none"


def test_the_next_gap_is_found_both_ways(with_run: Workspace) -> None:
    annotate(with_run)
    view = View(place=3, base=None, selected="jaw")
    assert gap_beside(view, with_run, 1) == 6
    assert gap_beside(view, with_run, -1) == 0
    with pytest.raises(NothingLeft, match="jaw has a pose, or is said not to be there, in all"):
        gap_beside(View(place=3, base="first", selected="jaw"), with_run, 1)


def test_it_is_made_anew_only_when_something_changed(with_run: Workspace) -> None:
    lane, other = with_run.lane("jaw", "first"), with_run.lane(None, "first")  # of two tabs
    with_run.put_run(make_run(with_run.assembly), "second")
    assert with_run.lane("jaw", "first") is lane
    assert with_run.lane(None, "first") is other
    with_run.put_run(make_run(with_run.assembly), "first")
    assert with_run.lane("jaw", "first") is not lane
    lane = with_run.lane("jaw", "first")
    annotate(with_run)
    assert with_run.lane("jaw", "first") is not lane


def test_its_html_escapes_names(with_run: Workspace) -> None:
    lane = with_run.lane("jaw", "first")
    named = lanes.Lane("<b>", lane.cells, lane.color)
    html = lanes.build(named, "<b>", count=8, color=(1, 2, 3))
    assert "<b>" not in html.replace('<b class="tl-cursor">', "")
    assert html.count('class="tl-pose ') == 2  # frame 100, and all others alike
