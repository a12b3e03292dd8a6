"""YOLO-pose exports: format, round trip through the reader of ASDF's own layout, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from asdfviz.data.sequences import open_sequence, read_folder_truth
from asdfviz.datatypes import KEYPOINTS, Assembly, FrameTruth, Sequence
from asdfviz.errors import SequenceError
from asdfviz.export.bop import export_bop
from asdfviz.export.yolo import export_yolo
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, transform_from


@pytest.fixture
def classed(assembly: Assembly) -> Assembly:
    states = tuple(
        replace(s, detector_class="two_jaw_on" if s.index == 1 else None) for s in assembly.states
    )
    classes = (*assembly.detector_classes, "two_jaw_on")
    return replace(assembly, states=states, detector_classes=classes)


@pytest.fixture
def sequence(memory: Sequence, classed: Assembly) -> Sequence:
    return replace(memory, assembly=classed)  # pyright: ignore[reportArgumentType, reportCallIssue]


def truth() -> dict[int, FrameTruth]:
    poses = {
        "base <1>": transform_from(np.eye(3), np.array([-0.02, -0.01, 0.3])),
        "jaw": transform_from(np.eye(3), np.array([0.03, 0.0, 0.3])),
    }
    return {
        0: FrameTruth(0, poses, state=1, is_error=False, visible={"jaw": 0.9, "base <1>": 1.0}),
        5: FrameTruth(5, poses, state=1, is_error=True, visible={"jaw": 0.1}),
    }


def rows(file: Path) -> list[np.ndarray]:
    return [np.array(line.split(), float) for line in file.read_text().splitlines()]


def test_a_frame_of_which_only_the_state_is_known_is_no_background(
    tmp_path: Path, sequence: Sequence
) -> None:
    known = {**truth(), 5: FrameTruth(5, {}, state=1, is_error=False)}
    export_yolo(sequence, known, tmp_path)
    assert [file.name for file in (tmp_path / "images").iterdir()] == ["000000.png"]
    export_yolo(sequence, known, tmp_path, gone={(5, "jaw")})
    assert not (tmp_path / "labels" / "000005.txt").exists()  # where the others are, nobody said
    assert sequence.assembly is not None
    export_yolo(sequence, known, tmp_path, gone={(5, part) for part in sequence.assembly.parts})
    assert (tmp_path / "labels" / "000005.txt").read_text() == ""


def test_an_unchecked_part_is_no_background(tmp_path: Path, sequence: Sequence) -> None:
    known = truth()
    base_only = {"base <1>": known[5].T_camera_part["base <1>"]}
    known[5] = replace(known[5], T_camera_part=base_only, unchecked=("jaw",))
    export_yolo(sequence, known, tmp_path)
    assert [file.name for file in (tmp_path / "images").iterdir()] == ["000000.png"]
    export_yolo(sequence, known, tmp_path, unchecked=True)
    assert len(list((tmp_path / "images").iterdir())) == 2
    with pytest.raises(SequenceError, match="in 1 frame nobody said of all parts"):
        export_yolo(sequence, {5: known[5]}, tmp_path)


def test_labels_hold_what_the_truth_says(
    tmp_path: Path, sequence: Sequence, classed: Assembly
) -> None:
    told: list[tuple[int, int]] = []
    export_yolo(sequence, truth(), tmp_path, progress=lambda *now: told.append(now))
    assert told == [(1, 2), (2, 2)]
    base, jaw, state = rows(tmp_path / "labels" / "000000.txt")
    assert [row[0] for row in (base, jaw, state)] == [0, 1, 2]
    assert all(len(row) == 5 + 3 * KEYPOINTS for row in (base, jaw, state))
    part = classed.parts["base <1>"]
    expected = project(
        apply(truth()[0].T_camera_part["base <1>"], part.keypoints), sequence.camera.K
    )
    assert np.allclose(base[5:].reshape(-1, 3)[:, :2] * [64, 48] - 0.5, expected, atol=0.01)
    box = base[1:5] * [64, 48, 64, 48]
    assert np.allclose(box[:2] - box[2:] / 2, expected.min(axis=0) + 0.5, atol=0.01)
    assert (state[5:] == 0).all()
    # An error is no state, and what is hardly seen gets no row.
    assert [row[0] for row in rows(tmp_path / "labels" / "000005.txt")] == [0]
    assert yaml.safe_load((tmp_path / "data.yaml").read_text())["names"] == dict(
        enumerate(classed.detector_classes)
    )
    picture = cv2.imread(str(tmp_path / "images" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert np.array_equal(picture[..., ::-1], sequence[0].rgb)


def test_images_with_depth_come_back_through_the_reader(
    tmp_path: Path, sequence: Sequence, classed: Assembly
) -> None:
    export_yolo(sequence, truth(), tmp_path, with_depth=True)
    back = open_sequence(tmp_path, assembly=classed)
    assert back.frame_indices == (0, 5)
    for place, original in ((0, sequence[0]), (1, sequence[2])):
        frame = back[place]
        assert np.array_equal(frame.rgb, original.rgb)
        assert frame.depth is not None
        assert original.depth is not None
        assert np.abs(frame.depth - original.depth).max() <= 0.00051
    found = back.truth(0)
    assert found is not None
    assert found.state == 1


def test_a_part_behind_something_that_was_measured_gets_no_row(
    sequence: Sequence, classed: Assembly, tmp_path: Path
) -> None:
    """The truth says of no part how much of it is seen, as after corrections."""
    poses = {0: replace(truth()[0], visible={}), 5: replace(truth()[0], frame_index=5, visible={})}
    export_bop(sequence, poses, tmp_path / "scene")
    hand = np.zeros((48, 64), np.uint16)
    hand[:, 32:] = 2000  # 0.2 m, before the jaw
    for index, depth in ((0, hand), (5, np.zeros_like(hand))):
        cv2.imwrite(str(tmp_path / "scene" / "depth" / f"{index:06d}.png"), depth)
    source = open_sequence(tmp_path / "scene", assembly=classed)
    export_yolo(source, poses, tmp_path / "out")
    found = {i: [int(r[0]) for r in rows(tmp_path / "out/labels" / f"{i:06d}.txt")] for i in (0, 5)}
    jaw = list(classed.parts).index("jaw")
    assert {i: jaw in labels for i, labels in found.items()} == {0: False, 5: True}
    assert all(0 in labels for labels in found.values())


def test_states_that_no_row_tells_come_back(
    tmp_path: Path, sequence: Sequence, classed: Assembly
) -> None:
    seen, hidden = truth().values()
    hidden = replace(hidden, is_error=False, visible={"jaw": 0.05, "base <1>": 0.05})
    odd = replace(seen, frame_index=1, is_error=True, error="something else")
    unknown = replace(seen, frame_index=0, state=None, is_error=None)
    for with_depth in (False, True):
        known = {0: unknown, 1: odd, 5: hidden}
        export_yolo(sequence, known, tmp_path, with_depth=with_depth)
        assert (tmp_path / "labels" / "000005.txt").read_text() == ""
        found = read_folder_truth(tmp_path, classed)
        assert {i: (t.state, t.is_error, t.error) for i, t in found.items()} == {
            1: (1, True, "something else"),
            5: (1, False, None),
        }
    export_yolo(sequence, {0: seen}, tmp_path, with_depth=True)
    assert list(read_folder_truth(tmp_path, classed)) == [0]


def test_what_cannot_be_exported_is_refused(
    tmp_path: Path, sequence: Sequence, memory: Sequence
) -> None:
    nameless = replace(memory, assembly=None)  # pyright: ignore[reportArgumentType, reportCallIssue]
    with pytest.raises(SequenceError, match="names no assembly"):
        export_yolo(nameless, truth(), tmp_path)
    with pytest.raises(SequenceError, match="no frame of memory has truth"):
        export_yolo(sequence, {}, tmp_path)
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SequenceError, match="is not empty"):
        export_yolo(sequence, truth(), tmp_path)


def test_truth_that_was_taken_back_leaves_no_label(sequence: Sequence, tmp_path: Path) -> None:
    export_yolo(sequence, truth(), tmp_path / "out")
    assert sorted(f.stem for f in (tmp_path / "out" / "labels").iterdir()) == ["000000", "000005"]
    export_yolo(sequence, {0: truth()[0]}, tmp_path / "out")
    for room in ("labels", "images"):
        assert [f.stem for f in (tmp_path / "out" / room).iterdir()] == ["000000"]


def test_a_frame_that_cannot_be_read_is_left_out(
    sequence: Sequence, classed: Assembly, tmp_path: Path
) -> None:
    export_bop(sequence, truth(), tmp_path / "scene")
    source = open_sequence(tmp_path / "scene", assembly=classed)
    export_yolo(source, truth(), tmp_path / "out")
    (tmp_path / "scene" / "rgb" / "000000.png").write_bytes(b"")
    assert list(export_yolo(source, truth(), tmp_path / "out")) == [0]
    for room in ("labels", "images"):
        assert [f.stem for f in (tmp_path / "out" / room).iterdir()] == ["000005"]
    with pytest.raises(SequenceError, match="no frame of scene can be read"):
        export_yolo(source, {0: truth()[0]}, tmp_path / "other")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("errors", "said", "expected"),
    [
        (("lost", "gone"), "gone", [0, 4]),
        (("lost", "gone"), None, [0]),
        (("lost",), None, [0, 3]),
        (("lost",), "another one", [0]),
    ],
)
def test_an_error_has_its_own_class_where_it_is_known(
    tmp_path: Path,
    memory: Sequence,
    classed: Assembly,
    errors: tuple[str, ...],
    said: str | None,
    expected: list[int],
) -> None:
    alike = tuple(
        replace(classed.errors[0], index=2 + i, name=name, detector_class=f"two_{name}")
        for i, name in enumerate(errors)
    )
    classes = (*classed.detector_classes, *(f"two_{name}" for name in errors))
    known = replace(classed, states=(*classed.steps, *alike), detector_classes=classes)
    wrong = replace(truth()[5], attached=("base <1>",), error=said)
    sequence = replace(memory, assembly=known)  # pyright: ignore[reportArgumentType, reportCallIssue]
    export_yolo(sequence, {5: wrong}, tmp_path)
    assert [row[0] for row in rows(tmp_path / "labels" / "000005.txt")] == expected
