"""Edits: what a key, a drag, a copy or a state writes into the annotation, and how it is taken back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.app import actions as act
from asdfviz.app.desk import Burst, Done, NothingLeft
from asdfviz.app.editing import Edits, apply_edit, use_base
from asdfviz.app.items import ANNOTATION
from asdfviz.app.panels import annotate
from asdfviz.app.snapshot import take
from asdfviz.app.typed_pose import euler_deg
from asdfviz.app.view import TRUTH, View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError

JAW = View(place=1, base="first", selected="jaw")
Do = Callable[..., Done]


@pytest.fixture
def do(with_run: Workspace) -> Do:
    def run(
        action: Edits, view: View = JAW, *, burst: Burst | None = None, now: float = 0.0
    ) -> Done:
        return apply_edit(action, view, with_run, burst=burst or Burst(), now=now)

    return run


def jaw(workspace: Workspace, place: int = 1, *, base: str | None = "first") -> np.ndarray:
    return workspace.poses(place, base)["jaw"].T_camera_part


def test_a_nudge_moves_one_step_in_the_picture(with_run: Workspace, do: Do) -> None:
    before = jaw(with_run)
    do(act.Nudge(0, 1))
    moved = jaw(with_run)
    assert moved[:3, 3] - before[:3, 3] == pytest.approx([0.001, 0, 0], abs=1e-15)
    assert with_run.poses(1, "first")["jaw"].source == ANNOTATION
    assert jaw(with_run, 2) == pytest.approx(before)  # other frames stay


@pytest.mark.parametrize(("step", "metres"), [(0, 0.0002), (1, 0.001), (2, 0.005), (3, 0.02)])
def test_step_sizes(with_run: Workspace, do: Do, step: int, metres: float) -> None:
    before = jaw(with_run)
    do(act.Nudge(2, -1), View(place=1, base="first", selected="jaw", step=step))
    assert jaw(with_run)[2, 3] - before[2, 3] == pytest.approx(-metres)


def test_two_large_turns_are_a_quarter(with_run: Workspace, do: Do) -> None:
    before = jaw(with_run)
    view = View(place=1, base="first", selected="jaw", step=3)
    do(act.Turn(0, 1), view)
    do(act.Turn(0, 1), view)
    turned = jaw(with_run)[:3, :3] @ before[:3, :3].T
    assert turned == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), abs=1e-12)
    shown = annotate.content(take(with_run, view, frame=None))
    assert "large: 20 mm, 45°" in shown


def test_a_turn_keeps_the_middle_of_the_part(with_run: Workspace, do: Do) -> None:
    centre = with_run.assembly.parts["jaw"].middle
    before = jaw(with_run)
    do(act.Turn(2, 1))
    after = jaw(with_run)
    assert after[:3, :3] @ centre + after[:3, 3] == pytest.approx(
        before[:3, :3] @ centre + before[:3, 3]
    )
    turned = after[:3, :3] @ before[:3, :3].T
    assert np.degrees(np.arctan2(turned[1, 0], turned[0, 0])) == pytest.approx(1.0)


def test_nudges_in_a_row_are_one_step_of_undo(with_run: Workspace, do: Do) -> None:
    before = jaw(with_run)
    burst = do(act.Nudge(0, 1), now=10.0).burst
    burst = do(act.Nudge(0, 1), burst=burst, now=10.3).burst
    do(act.Nudge(1, 1), burst=burst, now=20.0)  # much later: a step of its own
    do(act.Undo())
    assert jaw(with_run)[:3, 3] - before[:3, 3] == pytest.approx([0.002, 0, 0], abs=1e-12)
    do(act.Undo())
    assert jaw(with_run) == pytest.approx(before)
    with pytest.raises(AnnotationError, match="nothing left to undo"):
        do(act.Undo())
    do(act.Redo())
    assert jaw(with_run)[:3, 3] - before[:3, 3] == pytest.approx([0.002, 0, 0], abs=1e-12)


def test_a_drag_is_kept_to_the_last_bit(with_run: Workspace, do: Do) -> None:
    T = jaw(with_run).copy()
    T[:3, 3] = [0.0123456789, -0.2, 0.7]
    done = do(act.MovePart("jaw", T, 1, done=True))
    assert np.array_equal(jaw(with_run), T)
    assert "jaw" in done.message
    assert "101" in done.message


def test_a_drag_belongs_to_the_frame_where_it_was_begun(with_run: Workspace, do: Do) -> None:
    T = jaw(with_run).copy()
    T[0, 3] += 0.04
    done = do(act.MovePart("jaw", T, 1, done=True), replace(JAW, place=3))
    assert np.array_equal(jaw(with_run, 1), T)
    assert with_run.store.pose(103, "jaw") is None
    assert (done.message, done.place) == ("jaw dragged in frame 101", 3)


def test_nudges_that_do_not_end_are_several_steps(with_run: Workspace, do: Do) -> None:
    before = jaw(with_run)
    burst = Burst()
    for k in range(12):
        burst = do(act.Nudge(0, 1), burst=burst, now=10 + 0.5 * k).burst
    do(act.Undo())
    assert jaw(with_run)[:3, 3] - before[:3, 3] == pytest.approx([0.009, 0, 0], abs=1e-12)


def test_undo_goes_to_the_frame_it_changes(do: Do) -> None:
    do(act.Nudge(0, 1))
    assert do(act.Undo(), View(place=6)).place == 1


@pytest.mark.parametrize(("place", "then"), [(1, 1), (3, 3), (5, 5), (7, 4), (0, 2)])
def test_undo_of_tracking_tells_it_and_stays_where_it_is_seen(
    with_run: Workspace, do: Do, place: int, then: int
) -> None:
    T = jaw(with_run)
    tracked = {102 + k: {"jaw": T} for k in range(3)}
    with_run.store.set_frames(tracked, provenance="tracked", group="track@1")
    undone = do(act.Undo(), View(place=place))
    assert (undone.message, undone.place) == ("undid: tracking of jaw in 3 frames", then)
    again = do(act.Redo(), View(place=place))
    assert (again.message, again.place) == ("redid: tracking of jaw in 3 frames", then)


def test_undo_takes_back_what_was_done_in_this_tab(with_run: Workspace, do: Do) -> None:
    pages = with_run.pages
    left, right = replace(JAW, page=pages.open()), replace(JAW, page=pages.open(), place=3)
    do(act.Nudge(0, 1), left)
    use_base(replace(right, base=TRUTH), with_run, now=0.5)
    do(act.Nudge(0, 1), right, now=1.0)
    undone = do(act.Undo(), left, now=2.0)
    assert (undone.message, undone.place) == ("undid: moved jaw in frame 101", 1)
    with pytest.raises(NothingLeft, match="nothing left to undo in this tab"):
        do(act.Undo(), left, now=3.0)
    do(act.Nudge(0, 1), replace(left, place=3), now=4.0)
    with pytest.raises(AnnotationError, match="another tab has changed jaw in frame 103 since"):
        do(act.Undo(), right, now=5.0)
    pages.close(left.page)
    assert do(act.Undo(), right, now=6.0).message == "undid: moved jaw in frame 103"
    assert do(act.Undo(), right, now=7.0).message == "undid: moved jaw in frame 103"
    assert do(act.Undo(), right, now=8.0).message == "undid: what corrections start from"


def test_undo_tells_a_whole_step(with_run: Workspace, do: Do) -> None:
    view = View(place=3, base="first", selected="jaw", together=True)
    do(act.Nudge(0, 1), view)
    assert do(act.Undo(), view).message == "undid: moved jaw and base in frame 103"
    do(act.SetState(1), replace(view, marked=(2, 4)), now=5.0)
    undone = do(act.Undo(), view)
    name = with_run.assembly.states[1].name
    assert (undone.message, undone.place) == (f"undid: state {name} in frames 102 to 104", 3)


def test_the_first_edit_notes_what_it_started_from(with_run: Workspace, do: Do) -> None:
    assert with_run.base_of_seed() is None
    do(act.Nudge(0, 1), View(place=1, base=TRUTH, selected="jaw"))
    assert with_run.base_of_seed() == TRUTH
    do(act.Undo())
    assert with_run.base_of_seed() is None


def test_copying_takes_the_nearest_pose_before(with_run: Workspace, do: Do) -> None:
    T = jaw(with_run).copy()
    T[0, 3] += 0.03
    do(act.MovePart("jaw", T, 2, done=True), View(place=2, base="first", selected="jaw"))
    done = do(act.CopyPrevious(), View(place=3, base="first", selected="jaw"))
    assert np.array_equal(jaw(with_run, 3), T)
    assert "frame 102" in done.message


def test_copying_fills_a_range_but_keeps_what_is_there(with_run: Workspace, do: Do) -> None:
    store = with_run.store
    view = View(place=4, base=None, selected="jaw", marked=(2, 6))
    with pytest.raises(AnnotationError, match="jaw has no pose in any other frame to copy"):
        do(act.CopyPrevious(), view)
    first, other = jaw(with_run).copy(), jaw(with_run).copy()
    other[0, 3] += 0.03
    store.set_pose(101, "jaw", first)
    store.set_pose(104, "jaw", other)
    store.remove_pose(105, "jaw")
    done = do(act.CopyPrevious(), view, now=1.0)
    assert done.message == "jaw copied into 3 frames of frames 102 to 106, from frames 101, 104"
    assert np.array_equal(jaw(with_run, 2, base=None), first)
    assert np.array_equal(jaw(with_run, 3, base=None), first)
    assert np.array_equal(jaw(with_run, 6, base=None), other)
    assert "jaw" not in with_run.poses(5, None)

    full = replace(view, place=2, marked=(2, 4))
    with pytest.raises(AnnotationError, match="in frames 102 to 104 no frame lacks a pose of jaw"):
        do(act.CopyPrevious(), full, now=2.0)


def test_copying_goes_back_from_a_frame_after_where_none_before_has_a_pose(
    with_run: Workspace, do: Do
) -> None:
    T = jaw(with_run).copy()
    with_run.store.set_pose(105, "jaw", T)
    view = View(place=4, base=None, selected="jaw")
    done = do(act.CopyPrevious(), view)
    assert done.message == "jaw copied from frame 105, as it has no pose in any before"
    assert np.array_equal(jaw(with_run, 4, base=None), T)
    with_run.store.remove_pose(102, "jaw")
    done = do(act.CopyPrevious(), replace(view, place=1, marked=(0, 2)), now=1.0)
    assert done.message == "jaw copied into 2 frames of frames 100 to 102, from frame 104"
    assert np.array_equal(jaw(with_run, 0, base=None), T)
    assert "jaw" not in with_run.poses(2, None)
    assert do(act.Undo(), view).message == "undid: copied jaw in 2 frames"


def test_a_part_is_placed_turned_as_in_a_frame_after(with_run: Workspace, do: Do) -> None:
    T = jaw(with_run).copy()
    T[:3, :3] = T[:3, :3] @ np.diag([-1.0, -1.0, 1.0])
    with_run.store.set_pose(105, "jaw", T)
    do(act.PlacePart(100.0, 300.0), View(place=4, base=None, selected="jaw"))
    assert np.array_equal(jaw(with_run, 4, base=None)[:3, :3], T[:3, :3])


def test_where_no_depth_is_it_says_how_far(with_run: Workspace, do: Do) -> None:
    frame = with_run.frames[0]
    assert frame.depth is not None
    frame.depth[:] = 0
    done = do(act.PlacePart(100.0, 300.0), View(place=0, base="first", selected="jaw"))
    assert done.message.endswith("0.5 m away, since no depth is measured there")


def test_placing_puts_the_middle_where_the_depth_is(with_run: Workspace, do: Do) -> None:
    view = View(place=0, base="first", selected="jaw")  # the run did not find it here
    assert "jaw" not in with_run.poses(0, "first")
    do(act.PlacePart(100.0, 300.0), view)
    T = jaw(with_run, 0)
    centre = T[:3, :3] @ with_run.assembly.parts["jaw"].middle + T[:3, 3]
    K = with_run.frames.camera.K
    seen = K @ (centre / centre[2])
    assert centre[2] == pytest.approx(0.6)
    assert seen[:2] == pytest.approx([100.0, 300.0])


def test_dropping_a_correction(with_run: Workspace, do: Do) -> None:
    before = jaw(with_run)
    do(act.Nudge(0, 1))
    do(act.RevertPart())
    assert jaw(with_run) == pytest.approx(before)
    placed = View(place=0, base="first", selected="jaw")
    do(act.PlacePart(), placed, now=1.0)
    assert do(act.Undo(), placed).message == "undid: placed jaw in frame 100"
    do(act.PlacePart(), placed, now=1.5)
    do(act.RevertPart(), placed, now=2.0)
    assert "jaw" not in with_run.poses(0, "first")
    # The run speaks again, also once it says something else: nothing of the correction is left.
    assert with_run.store.poses() == {}
    do(act.Undo())
    assert with_run.poses(0, "first")["jaw"].source == ANNOTATION


def test_what_is_joined_moves_along_if_it_is_to(with_run: Workspace, do: Do) -> None:
    view = View(place=3, base="first", selected="jaw")  # state 1: base and jaw
    assert set(with_run.attached(3, "first")) == {"base", "jaw"}

    def places() -> dict[str, np.ndarray]:
        return {n: p.T_camera_part[:3, 3] for n, p in with_run.poses(3, "first").items()}

    before = places()
    do(act.Nudge(0, 1), view)
    assert places()["base"] == pytest.approx(before["base"])
    done = do(act.Nudge(0, 1), replace(view, together=True), now=9.0)
    assert "jaw and 1 joined with it moved" in done.message
    shift = {name: place[0] - before[name][0] for name, place in places().items()}
    assert shift == pytest.approx({"base": 0.001, "jaw": 0.002, "bolt": 0.0}, abs=1e-12)
    do(act.Undo())
    assert places()["base"] == pytest.approx(before["base"])


def test_a_state_for_a_range(with_run: Workspace, do: Do) -> None:
    error = with_run.assembly.errors[0]
    do(act.SetState(error.index), View(place=3, marked=(2, 4), base="first"))
    marks = with_run.rows()[0].marks
    assert [mark is not None for mark in marks] == [i in (2, 3, 4) for i in range(8)]
    mark = marks[3]
    assert mark is not None
    assert (mark.state, mark.is_error, mark.name) == (error.completed, True, error.name)
    do(act.Undo())
    assert not any(with_run.rows()[0].marks)


def test_a_range_is_left_alone_from_a_frame_outside_of_it(with_run: Workspace, do: Do) -> None:
    do(act.SetState(1), View(place=6, marked=(2, 4), base="first"))
    assert [mark is not None for mark in with_run.rows()[0].marks] == [i == 6 for i in range(8)]


@pytest.mark.parametrize("pixel", [(-3.0, 200.0), (200.0, -0.6), (640.0, 200.0), (200.0, 480.0)])
def test_a_click_beside_the_picture_places_nothing(
    with_run: Workspace, do: Do, pixel: tuple[float, float]
) -> None:
    with pytest.raises(AnnotationError, match="beside the picture"):
        do(act.PlacePart(*pixel))
    assert with_run.store.poses() == {}


@pytest.mark.parametrize(
    ("action", "view", "words"),
    [
        (act.Nudge(0, 1), View(base="first"), "no part is selected"),
        (act.Nudge(0, 1), View(base="first", selected="jaw"), "jaw has no pose in frame 100"),
        (
            act.CopyPrevious(),
            View(selected="jaw"),
            "jaw has no pose in any other frame to copy: place",
        ),
        (act.RevertPart(), JAW, "was not corrected"),
        (act.SetState(99), JAW, "there is no state 99"),
        (act.Redo(), JAW, "nothing left to redo"),
    ],
)
def test_what_cannot_be_done_says_why(do: Do, action: Edits, view: View, words: str) -> None:
    with pytest.raises(AnnotationError, match=words):
        do(action, view)


def test_a_typed_figure_changes_that_one_alone(with_run: Workspace, do: Do) -> None:
    before = jaw(with_run)
    said = do(act.TypePose("jaw", 1, {"x": "12,5"}), View(place=0, base="first", selected="base"))
    assert said.place == 0
    after = jaw(with_run).copy()
    assert after[0, 3] == pytest.approx(0.0125)
    after[0, 3] = before[0, 3]
    assert np.array_equal(after, before)
    do(act.TypePose("jaw", 1, {"turn z": "\u221230"}))
    turned = jaw(with_run)
    assert euler_deg(turned[:3, :3])[2] == pytest.approx(-30.0)
    assert turned[0, 3] == pytest.approx(0.0125)


def test_figures_of_no_frame_change_nothing(with_run: Workspace, do: Do) -> None:
    for place in (-1, 10**6):
        with pytest.raises(AnnotationError, match="there is no frame at"):
            do(act.TypePose("jaw", place, {"x": "1"}))
    assert not with_run.store.history()


@pytest.mark.parametrize(
    ("figure", "said", "told"),
    [
        ("x", "a lot", "'a lot' is no x in millimetres; type a number"),
        ("x", "nan", "type a number"),
        ("turn y", "1e9", "no turn y in degrees"),
        ("z", "-3", "z is -3 mm, behind the camera"),
        ("w", "1", "no w"),
    ],
)
def test_figures_that_cannot_be_change_nothing(
    with_run: Workspace, do: Do, figure: str, said: str, told: str
) -> None:
    before = jaw(with_run)
    with pytest.raises(AnnotationError, match=told):
        do(act.TypePose("jaw", 1, {figure: said}))
    assert np.array_equal(jaw(with_run), before)
