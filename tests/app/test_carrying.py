"""Tracking a part from an annotated frame: what is started from, what is kept, what stays."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asdfviz.annotate.records import TRACKED
from asdfviz.annotate.store import AnnotationStore
from asdfviz.app import carrying, fitting
from asdfviz.app.carrying import Carry, plan
from asdfviz.app.editing import gap_beside
from asdfviz.app.fitting import FITTED, plan_fit
from asdfviz.app.history import in_words
from asdfviz.app.jobs import Background
from asdfviz.app.panels import tracking
from asdfviz.app.snapshot import take
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, PoseEstimate, Run
from asdfviz.errors import AnnotationError, MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.turned_fits import HandFit
from asdfviz.track import raster

COUNT = 8
FIRST = 40
"""Number of the first frame."""
CAMERA = Camera(np.array([[420.0, 0.0, 159.5], [0.0, 420.0, 119.5], [0.0, 0.0, 1.0]]), 320, 240)


class Moving:
    """The jaw, turning and going right before a wall; nobody knows where it is."""

    def __init__(
        self,
        assembly: Assembly,
        folder: Path,
        *,
        with_depth: bool = True,
        without_depth: tuple[int, ...] = (),
        gone_from: int = COUNT,
    ) -> None:
        self._gone_from = gone_from
        self.assembly = assembly
        self.name = "moving"
        self.path = str(folder)
        self.camera = CAMERA
        self.frame_indices = tuple(range(FIRST, FIRST + COUNT))
        self.fps = 10.0
        self._places_with_depth = set(range(COUNT if with_depth else 0)) - set(without_depth)

    def __len__(self) -> int:
        return COUNT

    def truth(self, place: int) -> None:
        return None

    def __getitem__(self, place: int) -> Frame:
        part = self.assembly.parts["jaw"]
        rng = np.random.default_rng(place)
        inverse_depth, ids = raster.new_buffers(CAMERA.width, CAMERA.height)
        T = pose_of(self.assembly, place)
        if place < self._gone_from:
            raster.draw(part.mesh, T, K=CAMERA.K, inverse_depth=inverse_depth, ids=ids, number=0)
        rgb = rng.integers(90, 170, (240, 320, 3)).astype(np.float64)
        rgb[ids == 0] = np.array([210, 60, 30]) + rng.normal(0, 6, ((ids == 0).sum(), 3))
        depth = np.where(inverse_depth > 0, 1 / np.maximum(inverse_depth, 1e-6), 0.7)
        return Frame(
            self.frame_indices[place],
            place / 10,
            np.clip(rgb, 0, 255).astype(np.uint8),
            depth.astype(np.float32) if place in self._places_with_depth else None,
            CAMERA,
        )


def pose_of(assembly: Assembly, place: int) -> Transform:
    R = rotation_about(np.array([0.2, 1.0, 0.3]), 0.8 + 0.03 * place)
    vertices = assembly.parts["jaw"].mesh.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return transform_from(R, np.array([-0.02 + 0.004 * place, 0.0, 0.4]) - R @ middle)


def off_mm(workspace: Workspace, place: int) -> float:
    found = workspace.poses(place, None)["jaw"].T_camera_part
    gap = found - pose_of(workspace.assembly, place)
    vertices = workspace.assembly.parts["jaw"].mesh.vertices
    return 1e3 * float(np.linalg.norm(vertices @ gap[:3, :3].T + gap[:3, 3], axis=1).mean())


Open = Callable[..., Workspace]


@pytest.fixture
def opened(clamp: Assembly, tmp_path: Path) -> Iterator[Open]:
    spaces: list[Workspace] = []

    def made(**options: Any) -> Workspace:
        store = AnnotationStore(
            tmp_path / "moving.db", sequence_name="moving", assembly_name=clamp.name
        )
        space = Workspace(
            Moving(clamp, tmp_path, **options),
            clamp,
            store=store,
            runs_folder=tmp_path / "runs",
            export_folder=tmp_path / "out",
        )
        spaces.append(space)
        return space

    yield made
    for space in spaces:
        space.close()


def ended(workspace: Workspace) -> Any:
    """Wait for the tracker's end; how it ended."""
    changed = threading.Event()
    end = workspace.subscribe(changed.set)
    try:
        while workspace.carrying is None or workspace.carrying.is_active:
            assert changed.wait(60), "nothing happened for 60 s"
            changed.clear()
    finally:
        end()
    return workspace.carrying


def tracked(workspace: Workspace, carry: Carry) -> Any:
    """Track to the end; how it ended."""
    Background(workspace).track(carry)
    return ended(workspace)


def annotate(workspace: Workspace, place: int, provenance: str = "keys") -> None:
    T = pose_of(workspace.assembly, place)
    workspace.store.set_pose(FIRST + place, "jaw", T, provenance=provenance)


@pytest.mark.parametrize("with_depth", [True, False])
def test_a_part_is_tracked_both_ways_and_undone_in_one_step(
    opened: Open, *, with_depth: bool
) -> None:
    workspace = opened(with_depth=with_depth)
    annotate(workspace, 3)
    view = View(page="left", place=3, selected="jaw")
    status = tracked(workspace, plan(workspace, view, "both"))
    assert (status.state, status.done, status.total) == ("done", COUNT - 1, COUNT - 1)
    shown = [workspace.poses(place, None)["jaw"] for place in range(COUNT)]
    assert [s.stage for s in shown] == [
        "annotated" if place == 3 else "tracked" for place in range(COUNT)
    ]
    assert max(off_mm(workspace, place) for place in range(COUNT)) < (3 if with_depth else 10)
    assert workspace.store.pose(FIRST + 5, "jaw").provenance == TRACKED  # pyright: ignore[reportOptionalMemberAccess]
    (by_hand,) = workspace.store.undo(others=["left"])  # as in a tab that did not track
    assert by_hand.frame == FIRST + 3
    workspace.store.redo()
    workspace.store.undo()
    assert list(workspace.store.poses()) == [(FIRST + 3, "jaw")]


@pytest.mark.parametrize("without_depth", [(4,), (3, 7)])
def test_frames_without_depth_among_others_are_tracked_too(
    opened: Open, without_depth: tuple[int, ...]
) -> None:
    workspace = opened(without_depth=without_depth)
    annotate(workspace, 3)
    status = tracked(workspace, plan(workspace, View(place=3, selected="jaw"), "forward"))
    assert (status.state, status.done) == ("done", COUNT - 4)
    assert max(off_mm(workspace, place) for place in range(3, COUNT)) < 5


@pytest.mark.parametrize("otherwise", ["nothing", "tracked before"])
def test_where_a_part_was_lost_is_told(opened: Open, otherwise: str) -> None:
    workspace = opened(gone_from=5)
    annotate(workspace, 2)
    if otherwise == "tracked before":
        annotate(workspace, 6, provenance=TRACKED)
    view = View(place=2, selected="jaw", tab="annotate")
    status = tracked(workspace, plan(workspace, view, "both"))
    assert (status.state, status.done) == ("done", 4)
    assert status.message == f"lost in 3 of 7 frames: frames {FIRST + 5} to {FIRST + 7}"
    html = tracking.content(take(workspace, view, frame=None))
    assert f"tracked to 4 frames, {status.message}; Shift Page ↓ goes to frames without" in html
    # What was tracked there earlier is not left as if it were found; what is told goes with the next edit.
    assert "jaw" not in workspace.poses(6, None)
    other = take(workspace, View(place=2, selected="bolt"), frame=None)
    assert "tracked to" not in tracking.content(other)
    workspace.store.undo()
    assert ("jaw" in workspace.poses(6, None)) == (otherwise == "tracked before")
    assert "tracked to" not in tracking.content(take(workspace, view, frame=None))
    workspace.store.redo()
    assert gap_beside(view, workspace, 1) == 5


@pytest.mark.parametrize(
    ("seen_by_run", "place", "told", "way"),
    [
        (range(COUNT), 2, ", where its pose is from asdf. Undo", 5),
        (range(COUNT), 5, ", where its pose is from asdf. Undo", None),
        (range(COUNT), 7, ", where its pose is from asdf. Undo", 5),
        (range(7), 2, "; Shift Page ↓ goes to frames without a pose. Undo", 5),
        (range(6), 7, "; Shift Page ↑ goes to frames without a pose. Undo", 5),
        (range(7), 7, f"{FIRST + 7}. Undo", 5),
    ],
)
def test_where_a_part_was_lost_can_be_gone_to(
    opened: Open, seen_by_run: range, place: int, told: str, way: int | None
) -> None:
    workspace = opened(gone_from=5)
    assembly = workspace.assembly
    said = tuple(
        FramePrediction(
            FIRST + at, {"jaw": PoseEstimate("jaw", pose_of(assembly, at), 1.0, "pnp")}, None
        )
        for at in seen_by_run
    )
    workspace.put_run(Run("asdf", {}, "moving", assembly.path, "0", said), "first")
    view = View(place=2, selected="jaw", tab="annotate", base="first")
    status = tracked(workspace, plan(workspace, view, "forward"))
    assert status.lost == (5, 6, 7)
    html = tracking.content(take(workspace, replace(view, place=place), frame=None))
    assert told in html
    shown = re.search(r"Seek.{,30}?place.{,10}?(\d+)", html)
    assert (None if shown is None else int(shown[1])) == way
    assert ("to-lost" in html) == (way is not None)


@pytest.mark.parametrize("with_depth", [True, False])
def test_a_rough_pose_is_fitted_to_the_picture_and_undone_in_one_step(
    opened: Open, with_depth: bool
) -> None:
    workspace, view = opened(with_depth=with_depth), View(place=2, selected="jaw")
    rough = pose_of(workspace.assembly, 2) @ transform_from(
        rotation_about(np.array([1.0, 0, 0]), 0.05), np.array([0.003, -0.002, 0])
    )
    workspace.store.set_pose(FIRST + 2, "jaw", rough, provenance="placed")
    before = off_mm(workspace, 2)
    Background(workspace).fit(plan_fit(workspace, view))
    status = ended(workspace)
    assert (status.state, status.part) == ("done", "jaw")
    assert status.told.startswith("jaw fitted to the picture, moved by ")
    assert off_mm(workspace, 2) < min(2.5, 0.6 * before)
    assert workspace.store.poses(FIRST + 2)[FIRST + 2, "jaw"].provenance == FITTED
    html = tracking.content(take(workspace, view, frame=None))
    sign = "✓" if with_depth else "!"  # contours alone tell no turn from another
    assert status.told.endswith("no other turn was tried: check it") == (not with_depth)
    assert f"{sign} {status.told}. Undo takes it back." in html
    (undone,) = workspace.store.undo()
    assert in_words([undone]) == f"fitted jaw in frame {FIRST + 2}"
    assert off_mm(workspace, 2) == pytest.approx(before)


def test_what_cannot_be_fitted_is_said_and_stays(opened: Open) -> None:
    workspace = opened(gone_from=0)
    with pytest.raises(AnnotationError, match="no part is selected"):
        plan_fit(workspace, View(place=2))
    with pytest.raises(AnnotationError, match=rf"jaw has no pose in frame {FIRST + 2} to begin"):
        plan_fit(workspace, View(place=2, selected="jaw"))
    annotate(workspace, 2)
    edits = len(workspace.store.history())
    Background(workspace).fit(plan_fit(workspace, View(place=2, selected="jaw")))
    status = ended(workspace)
    assert status.state == "failed"
    assert "agree with no place near" in status.message
    assert workspace.messages[-1].title == "jaw could not be fitted"
    assert len(workspace.store.history()) == edits


@pytest.mark.parametrize("meanwhile", ["moved", "verified", "removed"])
def test_what_a_person_says_while_a_part_is_fitted_stays(
    opened: Open, monkeypatch: pytest.MonkeyPatch, meanwhile: str
) -> None:
    workspace = opened()
    annotate(workspace, 2)
    fit, store = plan_fit(workspace, View(place=2, selected="jaw")), workspace.store
    T = pose_of(workspace.assembly, 2)

    def found(_job: object) -> HandFit:
        if meanwhile == "moved":
            store.set_pose(FIRST + 2, "jaw", pose_of(workspace.assembly, 3), provenance="keys")
        elif meanwhile == "verified":
            store.verify(FIRST + 2, "jaw", T, provenance="keys")
        else:
            store.remove_pose(FIRST + 2, "jaw")
        return HandFit(pose_of(workspace.assembly, 4))

    monkeypatch.setattr(fitting.FitJob, "_found", found)
    Background(workspace).fit(fit)
    status = ended(workspace)
    assert status.state == "failed"
    assert f"in frame {FIRST + 2} it was changed meanwhile" in status.message
    assert len(store.history()) == 2


def test_a_tracked_pose_that_is_tracked_on_from_stays(opened: Open) -> None:
    workspace = opened()
    annotate(workspace, 3, provenance=TRACKED)
    status = tracked(workspace, plan(workspace, View(place=3, selected="jaw"), "forward"))
    assert (status.done, status.message) == (COUNT - 4, "")
    assert "jaw" in workspace.poses(3, None)


def test_what_a_person_set_stays_and_is_started_from(opened: Open) -> None:
    workspace = opened()
    annotate(workspace, 0)
    wrong = transform_from(np.eye(3), np.array([0.1, 0.1, 0.5]))
    workspace.store.set_pose(FIRST + 4, "jaw", wrong, provenance="gizmo")
    workspace.store.remove_pose(FIRST + 2, "jaw")
    workspace.store.set_pose(FIRST + 1, "jaw", wrong, provenance=TRACKED)
    carry = plan(workspace, View(place=0, selected="jaw", marked=(0, 3)), "forward")
    assert (carry.first, carry.last) == (0, 3)
    assert list(carry.keyframes["jaw"]) == [0]
    far = plan(workspace, View(place=0, selected="jaw"), "forward")
    assert sorted(far.keyframes["jaw"]) == [0, 4]
    assert tracked(workspace, carry).done == 2
    assert off_mm(workspace, 1) < 3  # an earlier tracked pose is replaced
    assert workspace.store.pose(FIRST + 2, "jaw").T_camera_part is None  # pyright: ignore[reportOptionalMemberAccess]
    np.testing.assert_array_equal(workspace.poses(4, None)["jaw"].T_camera_part, wrong)
    assert workspace.store.pose(FIRST + 5, "jaw") is None


@pytest.mark.parametrize(
    ("view", "message"),
    [
        (View(place=3), "no part is selected"),
        (View(place=2, selected="jaw"), "no pose in frame 42"),
        (View(place=3, selected="jaw", marked=(3, 3)), "no frame that way"),
    ],
)
def test_what_cannot_be_tracked_is_said(opened: Open, view: View, message: str) -> None:
    workspace = opened()
    annotate(workspace, 3)
    with pytest.raises(AnnotationError, match=message):
        plan(workspace, view, "both")


def test_a_pose_that_fits_nothing_is_lost_at_once(opened: Open) -> None:
    workspace = opened()
    T = transform_from(np.eye(3), np.array([0.06, 0.05, 0.35]))
    workspace.store.set_pose(FIRST, "jaw", T)
    Background(workspace).track(plan(workspace, View(selected="jaw"), "forward"))
    status = ended(workspace)
    assert status.state == "failed"
    assert "lost at once" in status.message
    assert workspace.messages[-1].is_problem
    assert list(workspace.store.poses()) == [(FIRST, "jaw")]


def test_cancelling_changes_nothing(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = opened()
    annotate(workspace, 0)
    gate, reached = threading.Event(), threading.Event()
    real = carrying.carry_parts

    def slow(frame_at: Callable[[int], Frame], *args: Any, **options: Any) -> Any:
        def late(place: int) -> Frame:
            if place == 3:
                reached.set()
                assert gate.wait(60)
            return frame_at(place)

        return real(late, *args, **options)

    monkeypatch.setattr(carrying, "carry_parts", slow)
    background = Background(workspace)
    background.track(plan(workspace, View(selected="jaw"), "forward"))
    assert reached.wait(60)
    with pytest.raises(MethodError, match="Tracking jaw still goes on: cancel it or wait"):
        background.track(plan(workspace, View(selected="jaw"), "forward"))
    background.stop_tracking()
    snap = take(workspace, View(selected="jaw", tab="annotate"), frame=None)
    assert "Cancelling jaw" in tracking.content(snap)
    gate.set()
    assert ended(workspace).state == "stopped"
    assert list(workspace.store.poses()) == [(FIRST, "jaw")]
    assert "nothing was changed" in tracking.content(snap)
