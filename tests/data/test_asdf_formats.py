"""The ASDF authors' own files, written here in their layout: raw renderings and the 16-bit export."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from asdfviz.data.sequences import open_sequence, read_folder_truth
from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError
from asdfviz.export.bop import export_bop

WriteScene = Callable[..., Any]

SIZE = (48, 64)
CAMERA = {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
FRAMES = (0, 2, 10)


def picture(index: int) -> np.ndarray:
    """A colour image (blue, green, red) that differs in every frame and channel."""
    return np.random.default_rng(index).integers(0, 256, (*SIZE, 3), dtype=np.uint8)


def millimetres(index: int) -> np.ndarray:
    return np.random.default_rng(100 + index).integers(0, 1500, SIZE, dtype=np.uint16)


def box(label: str) -> dict[str, object]:
    sides = dict.fromkeys(("middle_x_norm", "middle_y_norm", "width_norm", "height_norm"), 0.5)
    return {"label": label, **sides}


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    """bproc_output/<Assembly>/scene_0/Camera_1, camera.json above all scenes."""
    folder = tmp_path / "Tiny_new" / "scene_0" / "Camera_1"
    for room in ("Images", "depth_images", "state_seg_maps"):
        (folder / room).mkdir(parents=True)
    (tmp_path / "Tiny_new" / "camera.json").write_text(json.dumps(CAMERA))
    # Depth is written last frame first: what pairs them is the name, not the order on disk.
    for index in FRAMES:
        cv2.imwrite(str(folder / "Images" / f"{index:06d}.png"), picture(index))
    for index in reversed(FRAMES):
        depth = millimetres(index)
        stored = depth if index else np.stack([depth, depth, depth], axis=2)
        cv2.imwrite(str(folder / "depth_images" / f"{index:06d}.png"), stored)
    boxes: list[object] = [{} for _ in range(11)]
    boxes[2], boxes[10] = box("Tiny_State_1"), box("tiny:jaw lost")
    (folder / "state_seg_maps" / "state_bounding_boxes.json").write_text(json.dumps(boxes))
    return folder


def label_row(number: int, *, visible: int = 2) -> str:
    keypoints = " ".join([f"0.4 0.6 {visible}" if visible else "0 0 0"] * 17)
    return f"{number} 0.5 0.5 0.2 0.3 {keypoints}"


@pytest.fixture
def rgbd(tmp_path: Path) -> Path:
    """datasets/rgbd_pose/Tiny/train with the classes in a yaml above."""
    folder = tmp_path / "rgbd_pose" / "Tiny" / "train"
    for room in ("images", "labels"):
        (folder / room).mkdir(parents=True)
    (folder.parent / "camera.json").write_text(json.dumps(CAMERA))
    names = "{0: base, 1: jaw, 2: cup, 3: Tiny_State_1}"
    (tmp_path / "rgbd_pose" / "Tiny.yaml").write_text(f"kpt_shape: [17, 3]\nnames: {names}\n")
    (tmp_path / "rgbd_pose" / "Other.yaml").write_text("names: [x, y]\n")
    for index in FRAMES:
        image = np.dstack([picture(index).astype(np.uint16) * 256, millimetres(index)])
        cv2.imwrite(str(folder / "images" / f"{index:06d}.png"), image)
        rows = [label_row(0), label_row(2)] + [label_row(3, visible=0)] * (index == 2)
        (folder / "labels" / f"{index:06d}.txt").write_text("\n".join(rows) + "\n")
    return folder


def check_images(folder: Path, format: str) -> None:
    sequence = open_sequence(folder)
    assert sequence.format == format
    assert sequence.frame_indices == FRAMES
    for place, index in enumerate(FRAMES):
        frame = sequence[place]
        np.testing.assert_array_equal(frame.rgb, picture(index)[..., ::-1])
        assert frame.depth is not None
        np.testing.assert_allclose(frame.depth, millimetres(index) * 1e-3, atol=1e-6)
        assert frame.camera.K[0, 0] == 60.0


def test_raw_renderings_are_recognised_and_paired_by_name(raw: Path) -> None:
    check_images(raw, "asdf")
    assert open_sequence(raw, format="asdf").format == "asdf"


def test_raw_states(raw: Path, tiny: Assembly) -> None:
    sequence = open_sequence(raw, assembly=tiny)
    found = [sequence.truth(place) for place in range(3)]
    assert [(t.state, t.is_error, dict(t.T_camera_part)) for t in found if t is not None] == [
        (0, None, {}),  # no box: state 0, which has no class
        (1, False, {}),
        (1, True, {}),  # an error's own class names what it follows
    ]
    assert list(read_folder_truth(raw, tiny)) == list(FRAMES)


def test_raw_poses_come_from_scene_gt(raw: Path, tiny: Assembly) -> None:
    entry = {"obj_id": "base", "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [1, 2, 500]}
    (raw / "scene_gt.json").write_text(json.dumps({"2": [entry]}))
    truth = read_folder_truth(raw, tiny)
    np.testing.assert_allclose(truth[2].T_camera_part["base"][:3, 3], [0.001, 0.002, 0.5])
    assert truth[2].state == 1
    assert not truth[0].T_camera_part


def test_the_export_is_recognised_and_split(rgbd: Path) -> None:
    check_images(rgbd, "asdf-rgbd")


def test_export_states(rgbd: Path, tiny: Assembly) -> None:
    truth = read_folder_truth(rgbd, tiny)
    assert [(t.state, t.is_error) for t in truth.values()] == [(0, None), (1, False), (0, None)]
    assert not any(t.T_camera_part for t in truth.values())


def test_states_json_goes_before_the_rows(rgbd: Path, tiny: Assembly) -> None:
    (rgbd / "states.json").write_text(json.dumps([{"frame": 2, "state": 1, "is_error": True}]))
    truth = read_folder_truth(rgbd, tiny)
    assert {i: (t.state, t.is_error) for i, t in truth.items()} == {2: (1, True)}


def test_export_classes_are_the_assembly_s_without_a_yaml(rgbd: Path, tiny: Assembly) -> None:
    (rgbd.parents[1] / "Tiny.yaml").unlink()
    (rgbd.parents[1] / "Other.yaml").unlink()
    truth = read_folder_truth(rgbd, tiny)
    assert tiny.detector_classes[3] == "tiny:jaw on"
    assert [t.state for t in truth.values()] == [0, 1, 0]


def test_both_export_as_bop(raw: Path, rgbd: Path, tiny: Assembly, tmp_path: Path) -> None:
    for folder in (raw, rgbd):
        sequence = open_sequence(folder, assembly=tiny)
        out = tmp_path / f"bop_{sequence.format}"
        export_bop(sequence, read_folder_truth(folder, tiny), out)
        again = open_sequence(out, assembly=tiny)
        assert sequence[1].depth is not None
        assert again[1].depth is not None
        np.testing.assert_array_equal(again[1].rgb, sequence[1].rgb)
        np.testing.assert_allclose(again[1].depth, sequence[1].depth, atol=1e-6)
        state = again.truth(1)
        assert state is not None
        assert state.state == 1


def test_a_folder_of_cameras_says_which_to_open(raw: Path) -> None:
    with pytest.raises(SequenceError, match=r"scene_0/Camera_1"):
        open_sequence(raw.parents[1])


def broken_raw(folder: Path, kind: str) -> None:
    boxes = folder / "state_seg_maps" / "state_bounding_boxes.json"
    if kind == "no depth":
        (folder / "depth_images" / "000002.png").unlink()
    elif kind == "no colour":
        (folder / "Images" / "000010.png").unlink()
    elif kind == "8-bit depth":
        cv2.imwrite(str(folder / "depth_images" / "000000.png"), picture(0)[..., 0])
    elif kind == "16-bit colour":
        cv2.imwrite(str(folder / "Images" / "000000.png"), millimetres(0))
    elif kind == "no JSON":
        boxes.write_text("[{}, {")
    elif kind == "short list":
        boxes.write_text("[{}, {}, {}]")
    elif kind == "unknown state":
        boxes.write_text(json.dumps([box("Tiny_State_7")] * 11))
    elif kind == "no camera":
        (folder.parents[1] / "camera.json").unlink()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("no depth", r"Images/000002\.png has no depth image: expected .*depth_images/000002\.png"),
        ("no colour", r"depth_images/000010\.png has no colour image"),
        ("8-bit depth", r"depth_images/000000\.png is 8 bit with 1 channel"),
        ("16-bit colour", r"Images/000000\.png is 16 bit with 1 channel"),
        ("no JSON", r"state_bounding_boxes\.json is not valid JSON"),
        ("short list", r"has 3 entries, so none for 000010\.png"),
        ("unknown state", r"\[0\]: 'label': state 'Tiny_State_7' is unknown; tiny has .* 0 to 1"),
        ("no camera", r"no camera\.json and .*above"),
    ],
)
def test_broken_raw_renderings(kind: str, said: str, raw: Path, tiny: Assembly) -> None:
    broken_raw(raw, kind)
    with pytest.raises(SequenceError, match=said):
        _ = (sequence := open_sequence(raw, assembly=tiny))[0], sequence.truth(0)


def broken_rgbd(folder: Path, kind: str) -> None:
    image, label = folder / "images" / "000000.png", folder / "labels" / "000000.txt"
    if kind == "no label":
        label.unlink()
    elif kind == "no image":
        image.unlink()
    elif kind == "8 bit":
        cv2.imwrite(str(image), np.dstack([picture(0), picture(0)[..., 0]]))
    elif kind == "3 channels":
        cv2.imwrite(str(image), picture(0).astype(np.uint16) * 256)
    elif kind == "unknown class":
        label.write_text(label_row(4))
    elif kind == "half a row":
        label.write_text("0 0.5 0.5 0.2\n")
    elif kind == "words":
        label.write_text("base 0.5 0.5 0.2\n")
    elif kind == "two states":
        label.write_text(f"{label_row(3)}\n{label_row(3)}\n")
    elif kind == "two yamls":
        (folder.parents[1] / "Tiny.yaml").rename(folder.parents[1] / "Third.yaml")


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("no label", r"images/000000\.png has no labels"),
        ("no image", r"labels/000000\.txt has no image"),
        ("8 bit", r"000000\.png is 8 bit with 4 channel"),
        ("3 channels", r"000000\.png is 16 bit with 3 channel"),
        ("unknown class", r"000000\.txt line 1: class 4 has no name; the classes are 0 to 3"),
        ("half a row", r"line 1: 4 columns, expected 56"),
        ("words", r"line 1: expected 56 numbers"),
        ("two states", r"2 rows of states"),
        ("two yamls", r"several files with class names: Other\.yaml, Third\.yaml"),
    ],
)
def test_broken_exports(kind: str, said: str, rgbd: Path, tiny: Assembly) -> None:
    broken_rgbd(rgbd, kind)
    with pytest.raises(SequenceError, match=said):
        _ = (sequence := open_sequence(rgbd, assembly=tiny))[0], sequence.truth(0)


def test_class_names_that_are_nested_too_deeply(rgbd: Path, tiny: Assembly) -> None:
    (rgbd.parents[1] / "Tiny.yaml").write_text("names: " + "[" * 3000)
    with pytest.raises(SequenceError, match=r"Tiny\.yaml cannot be read as YAML: .* too deeply"):
        open_sequence(rgbd, assembly=tiny).truth(0)


def test_a_plain_scene_stays_one(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("gbot")
    (scene.folder / "labels").mkdir()
    (scene.folder / "images").mkdir()
    assert open_sequence(scene.folder).format == "gbot"
    assert read_folder_truth(scene.folder, tiny)[4].state == 1
