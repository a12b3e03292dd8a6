"""The truth that corrections make, over nothing, over truth, over a run, over a sequence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asdfviz.annotate.checked import annotated
from asdfviz.annotate.corrected import (
    corrected_truth,
    truth_from_run,
)
from asdfviz.annotate.paths import annotation_file
from asdfviz.annotate.records import Seed, StateLabel, label_of
from asdfviz.annotate.store import AnnotationStore
from asdfviz.data.run_files import save_run
from asdfviz.datatypes import (
    Assembly,
    Camera,
    Frame,
    FramePrediction,
    FrameTruth,
    PoseEstimate,
    Run,
    StateEstimate,
)
from asdfviz.errors import AnnotationError
from asdfviz.geometry.transforms import rotation_about, transform_from

OpenStore = Callable[..., AnnotationStore]


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return transform_from(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.normal(size=3))


def make_run(poses: dict[int, dict[str, np.ndarray]], states: dict[int, int], **fields: Any) -> Run:
    predictions = tuple(
        FramePrediction(
            index,
            {name: PoseEstimate(name, T, 0.8, "pnp") for name, T in found.items()},
            StateEstimate(np.eye(4)[states[index]]) if index in states else None,
        )
        for index, found in poses.items()
    )
    return Run("asdf", {}, "/clip", "/b.yaml", "0", predictions, **fields)


class Clip:
    """A sequence of three frames with truth in two of them."""

    name = "clip"
    path = "/clip"
    frame_indices = (0, 5, 10)

    def __init__(self, assembly: Assembly | None, *, with_truth: bool = True) -> None:
        self.assembly = assembly
        self._with_truth = with_truth
        self.camera = Camera(np.eye(3), 10, 10)

    def __len__(self) -> int:
        return 3

    def __getitem__(self, place: int) -> Frame:
        raise NotImplementedError

    def truth(self, place: int) -> FrameTruth | None:
        if place == 2 or not self._with_truth:
            return None
        return FrameTruth(5 * place, {"base": pose(place)}, place)


def test_without_edits_the_base_stands(store: AnnotationStore, boxes: Assembly) -> None:
    truth = {4: FrameTruth(4, {"lid": pose(0)}, 1, False, ("base",), {"lid": 0.7}, "odd")}
    found = corrected_truth(store, truth, assembly=boxes)
    assert set(found) == {4}
    assert found[4].visible == {"lid": 0.7}
    assert (found[4].state, found[4].is_error, found[4].attached) == (1, False, ("base",))
    assert found[4].error == "odd"
    np.testing.assert_array_equal(found[4].T_camera_part["lid"], pose(0))
    assert corrected_truth(store, {}, assembly=boxes) == {}


def test_edits_go_over_truth(store: AnnotationStore, boxes: Assembly) -> None:
    truth = {
        i: FrameTruth(i, {"base": pose(i), "lid": pose(i + 9)}, 0, visible={"base": 1.0, "lid": 1})
        for i in range(4)
    }
    store.set_pose(1, "lid", pose(100))
    store.set_pose(1, "lid", pose(101))
    store.remove_pose(2, "lid")
    store.set_pose(2, "pin", pose(102))
    store.verify(3, "lid", pose(12), provenance="truth")
    found = corrected_truth(store, truth, assembly=boxes)
    np.testing.assert_array_equal(found[1].T_camera_part["lid"], pose(101))
    np.testing.assert_array_equal(found[1].T_camera_part["base"], pose(1))
    assert list(found[2].T_camera_part) == ["base", "pin"]
    assert [found[i].visible != {} for i in range(4)] == [True, False, False, True]
    store.undo()
    store.undo()
    store.undo()
    assert list(corrected_truth(store, truth, assembly=boxes)[2].T_camera_part) == ["base", "lid"]


@pytest.mark.parametrize(
    ("moved_to", "kept"),
    [
        pytest.param((-0.3, 0.0, 0.5), {"lid", "pin"}, id="away from what it hid nothing of"),
        pytest.param((0.11, 0.0, 0.25), {"lid"}, id="before the pin"),
        pytest.param((-0.2, 0.0, 0.5), {"lid", "pin"}, id="nowhere"),
        pytest.param((0.0, 0.0, -0.5), set[str](), id="behind the camera"),
        pytest.param(None, {"lid", "pin"}, id="taken away"),
    ],
)
def test_shares_stay_of_parts_that_no_edit_can_hide(
    store: AnnotationStore,
    boxes: Assembly,
    moved_to: tuple[float, ...] | None,
    kept: set[str],
) -> None:
    places = {"base": (-0.2, 0.0, 0.5), "lid": (0.0, 0.0, 0.5), "pin": (0.22, 0.0, 0.5)}
    poses = {name: transform_from(np.eye(3), np.array(place)) for name, place in places.items()}
    shares = {"base": 0.9, "lid": 0.02, "pin": 0.8}
    truth = {0: FrameTruth(0, poses, 0, visible=shares)}
    if moved_to is None:
        store.remove_pose(0, "base")
    else:
        store.set_pose(0, "base", transform_from(np.eye(3), np.array(moved_to)))
    found = corrected_truth(store, truth, assembly=boxes)[0].visible
    stays = {"base"} if moved_to == places["base"] else set[str]()
    assert found == {name: shares[name] for name in shares if name in kept | stays}


def test_what_a_moved_part_hid_has_no_share_any_more(
    store: AnnotationStore, boxes: Assembly
) -> None:
    poses = {
        "base": transform_from(np.eye(3), np.array([0.0, 0.0, 0.3])),
        "lid": transform_from(np.eye(3), np.array([0.0, 0.0, 0.5])),
    }
    truth = {0: FrameTruth(0, poses, 0, visible={"base": 1.0, "lid": 0.1})}
    store.set_pose(0, "base", transform_from(np.eye(3), np.array([0.3, 0.0, 0.3])))
    assert corrected_truth(store, truth, assembly=boxes)[0].visible == {}


def test_state_labels_go_over_truth(store: AnnotationStore, boxes: Assembly) -> None:
    truth = {i: FrameTruth(i, {}, 0, False, ("base",)) for i in range(5)}
    store.set_state(1, label_of(boxes.states[3]), last_frame=3)
    store.set_state(2, StateLabel(2))
    found = corrected_truth(store, truth, assembly=boxes)
    assert [(t.state, t.is_error) for t in found.values()] == [
        *((0, False), (0, True), (2, False), (0, True), (0, False))
    ]
    assert [t.error for t in found.values()] == [None, "lid wrong", None, "lid wrong", None]
    assert found[1].attached == ("base", "lid")
    assert found[2].attached == ("base", "lid", "pin")
    assert found[4].attached == ("base",)


def test_edits_over_nothing(store: AnnotationStore, boxes: Assembly) -> None:
    store.set_pose(7, "lid", pose(1))
    store.set_state(2, StateLabel(1), last_frame=4)
    assert set(corrected_truth(store, {}, assembly=boxes)) == {2, 3, 4, 7}
    found = corrected_truth(store, {}, assembly=boxes, frames=(0, 2, 4, 6, 8))
    assert set(found) == {2, 4}
    assert found[2].state == 1
    assert found[2].T_camera_part == {}


def test_a_run_as_base(store: AnnotationStore, boxes: Assembly) -> None:
    run = make_run({0: {"base": pose(0)}, 1: {"lid": pose(1)}}, {0: 2, 1: 3})
    store.set_pose(1, "base", pose(5), provenance="gizmo")
    found = corrected_truth(store, run, assembly=boxes)
    assert [(t.state, t.is_error) for t in found.values()] == [(2, False), (0, True)]
    assert [t.error for t in found.values()] == [None, "lid wrong"]
    assert list(found[1].T_camera_part) == ["base", "lid"]
    np.testing.assert_array_equal(found[0].T_camera_part["base"], pose(0))
    with pytest.raises(AnnotationError, match="assembly"):
        corrected_truth(store, run)


@pytest.mark.parametrize(
    ("base", "unchecked"),
    [
        pytest.param(None, ("base",), id="nothing"),
        pytest.param(FrameTruth(1, {}, 2), ("base",), id="a state alone"),
        pytest.param(FrameTruth(1, {}, None, lists_parts=True), (), id="none is there"),
        pytest.param(FrameTruth(1, {"base": pose(0)}, 2), (), id="poses"),
        pytest.param(
            FrameTruth(1, {"pin": pose(0)}, 2, unchecked=("base", "lid")), ("base",), id="some"
        ),
        pytest.param(make_run({1: {"pin": pose(0)}}, {}), ("base",), id="a run"),
    ],
)
def test_what_neither_the_base_nor_an_edit_tells_is_unchecked(
    store: AnnotationStore,
    boxes: Assembly,
    base: FrameTruth | Run | None,
    unchecked: tuple[str, ...],
) -> None:
    store.set_pose(1, "lid", pose(1))
    store.remove_pose(1, "pin")
    truth = {} if base is None else {1: base} if isinstance(base, FrameTruth) else base
    found = corrected_truth(store, truth, assembly=boxes)
    assert found[1].unchecked == unchecked


def test_a_run_of_another_assembly(boxes: Assembly) -> None:
    run = Run("asdf", {}, "/c", "/b", "0", (FramePrediction(0, {}, StateEstimate(np.ones(2) / 2)),))
    with pytest.raises(AnnotationError, match="2 states, boxes has 4"):
        truth_from_run(run, boxes)


def test_a_sequence_as_base(store: AnnotationStore, boxes: Assembly) -> None:
    store.set_pose(10, "lid", pose(3))
    store.set_pose(3, "lid", pose(3))  # no frame of the sequence
    found = corrected_truth(store, Clip(boxes))
    assert list(found) == [0, 5, 10]
    assert list(found[10].T_camera_part) == ["lid"]
    assert found[5].state == 1


def test_unknown_parts_and_states_are_told(store: AnnotationStore, boxes: Assembly) -> None:
    store.set_pose(3, "wheel", pose(0))
    with pytest.raises(AnnotationError, match="frame 3: part 'wheel' is not in boxes"):
        corrected_truth(store, {}, assembly=boxes)
    store.undo()
    store.set_state(3, StateLabel(7))
    with pytest.raises(AnnotationError, match="state 7 is not in boxes"):
        corrected_truth(store, {}, assembly=boxes)


def test_the_annotation_of_a_sequence(tmp_path: Path, boxes: Assembly) -> None:
    clip = Clip(boxes)
    with pytest.raises(AnnotationError, match="nothing is annotated in 'clip'"):
        annotated(clip, annotations=tmp_path)
    assert list(tmp_path.iterdir()) == []
    file = annotation_file("clip", folder=tmp_path)
    with AnnotationStore(file, sequence_name="clip", assembly_name="boxes") as store:
        store.set_pose(10, "lid", pose(1))
        assert list(annotated(clip, annotations=tmp_path).truth) == [10]
        store.set_seed(Seed("truth"))
        assert list(annotated(clip, annotations=tmp_path).truth) == [0, 5, 10]
        save_run(make_run({5: {"pin": pose(4)}}, {}), tmp_path / "run")
        store.set_seed(Seed("run", str(tmp_path / "run"), "asdf"))
        found = annotated(clip, annotations=tmp_path, guesses=True)
        checked = annotated(clip, annotations=tmp_path)
        store.set_seed(Seed("run", None, "asdf"))
        with pytest.raises(AnnotationError, match=r"'asdf' .* was not saved"):
            annotated(clip, annotations=tmp_path)
    assert {index: list(truth.T_camera_part) for index, truth in found.truth.items()} == {
        5: ["pin"],
        10: ["lid"],
    }
    assert list(checked.truth) == [10]
    assert (found.unchecked, checked.unchecked[:16]) == ("", "1 frame left out")
    with pytest.raises(AnnotationError, match="assembly"):
        annotated(Clip(None), annotations=tmp_path)


def test_a_file_that_nobody_corrected_anything_in(tmp_path: Path, boxes: Assembly) -> None:
    clip = Clip(boxes)
    file = annotation_file("clip", folder=tmp_path)
    with AnnotationStore(file, sequence_name="clip", assembly_name="boxes") as store:
        with pytest.raises(AnnotationError, match="nothing is annotated in 'clip'"):
            annotated(clip, annotations=tmp_path)
        with pytest.raises(AnnotationError, match=r"clip\.db has neither poses nor states"):
            annotated(clip, annotations=tmp_path)
        store.remove_pose(0, "lid")
        only_gone = annotated(clip, annotations=tmp_path)
        store.set_state(0, StateLabel(0))
        found = annotated(clip, annotations=tmp_path)
    for one in (only_gone, found):
        assert (list(one.truth), one.gone) == ([0], {(0, "lid")})
        assert one.truth[0].unchecked == ("base", "pin")


def test_truth_that_corrections_started_from_and_is_gone(tmp_path: Path, boxes: Assembly) -> None:
    clip = Clip(boxes, with_truth=False)
    file = annotation_file("clip", folder=tmp_path)
    with AnnotationStore(file, sequence_name="clip", assembly_name="boxes") as store:
        store.set_seed(Seed("truth"))
        store.set_pose(0, "lid", pose(0))
    with pytest.raises(AnnotationError, match="its own truth, which is no longer there"):
        annotated(clip, annotations=tmp_path)
