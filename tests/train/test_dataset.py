from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply
from asdfviz.pose.labels import LabelledObject
from asdfviz.pose.yolo_rows import yolo_rows
from asdfviz.train.dataset import LabelledImage, load_images, told_unchecked


def test_labels_are_the_projected_truth(scene: Path, assembly: Assembly) -> None:
    images = load_images([scene], (assembly,), image_size=640)
    assert len(images) == 8
    body = next(o for o in images[0].objects if o.part == "body")
    part = assembly.parts["body"]
    assert body.T_camera_part is not None
    pixels = project(apply(body.T_camera_part, part.keypoints), images[0].K)
    np.testing.assert_allclose(body.keypoints[:, :2], pixels, atol=1e-3)
    corners = project(apply(body.T_camera_part, part.mesh.vertices), images[0].K)
    np.testing.assert_allclose(body.outline.min(0), corners.min(0), atol=1e-3)
    np.testing.assert_allclose(body.outline.max(0), corners.max(0), atol=1e-3)


def test_several_processes_share_the_frames(scene: Path, assembly: Assembly) -> None:
    every = load_images([scene], (assembly,), image_size=640)
    shares = [
        load_images([scene], (assembly,), image_size=640, share=slice(number, None, 12))
        for number in range(12)
    ]
    assert [image.name for share in shares for image in share] == [image.name for image in every]
    assert shares[11] == ()


def test_a_state_is_the_union_of_its_own_group(scene: Path, assembly: Assembly) -> None:
    """The loose bar comes first in the list and is no part of the joined state."""
    images = load_images([scene], (assembly,), image_size=640)
    states = [[o for o in image.objects if o.part is None] for image in images]
    assert [len(s) for s in states] == [0, 1] * 4
    loose, body, bar = (o for o in images[1].objects if o.part is not None)
    (state,) = states[1]
    assert state.label == 2
    assert not state.keypoints.any()
    both = np.concatenate([body.outline, bar.outline])
    np.testing.assert_allclose(state.outline.min(0), both.min(0), atol=1e-3)
    np.testing.assert_allclose(state.outline.max(0), both.max(0), atol=1e-3)
    assert loose.outline.max() > both.max()


def test_symmetric_poses_get_one_label(scene: Path, assembly: Assembly, tmp_path: Path) -> None:
    turned = tmp_path / "turned"
    turned.mkdir()
    for name in ("rgb", "scene_camera.json", "states.json"):
        (turned / name).symlink_to(scene / name)
    truth = json.loads((scene / "scene_gt.json").read_text())
    for entries in truth.values():
        for entry in entries:
            if entry["obj_id"] == "bar":
                R = np.array(entry["cam_R_m2c"]).reshape(3, 3) @ np.diag([-1.0, -1.0, 1.0])
                entry["cam_R_m2c"] = R.ravel().tolist()
    (turned / "scene_gt.json").write_text(json.dumps(truth))
    for a, b in zip(
        load_images([scene], (assembly,), image_size=640),
        load_images([turned], (assembly,), image_size=640),
        strict=True,
    ):
        for left, right in zip(a.objects, b.objects, strict=True):
            np.testing.assert_allclose(left.keypoints[:, :2], right.keypoints[:, :2], atol=1e-3)


def test_keypoints_behind_something_are_hidden(scene: Path, assembly: Assembly) -> None:
    images = load_images([scene], (assembly,), image_size=640)
    flags = np.concatenate([o.keypoints[:, 2] for i in images for o in i.objects if o.part])
    assert set(flags) == {1.0, 2.0}
    assert 0.2 < float((flags == 2).mean()) < 0.9


def relabelled(image: LabelledImage, rng: np.random.Generator) -> LabelledImage:
    """The picture with other flags in the same places."""
    objects: list[LabelledObject] = []
    for item in image.objects:
        keypoints = item.keypoints.copy()
        if item.part is not None:
            keypoints[:, 2] = rng.integers(1, 3, len(keypoints))
        objects.append(replace(item, keypoints=keypoints))
    return replace(image, objects=tuple(objects))


def flags_of(image: LabelledImage) -> np.ndarray:
    return np.stack([item.keypoints[:, 2] for item in image.objects])


@pytest.mark.parametrize("with_depth", [True, False])
def test_a_label_file_knows_which_keypoints_are_hidden(
    new_scene: Callable[[int], Path], assembly: Assembly, with_depth: bool
) -> None:
    """Each row counts for its own object, one of two bars too; a row of another pose for none."""
    folder = new_scene(2)
    if not with_depth:
        shutil.rmtree(folder / "depth")
    measured = load_images([folder], (assembly,), image_size=640)
    rng = np.random.default_rng(0)
    (folder / "labels").mkdir()
    told = [relabelled(image, rng) for image in measured]
    for number, image in enumerate(told):
        text = yolo_rows(image.objects[::-1], width=320, height=180)
        (folder / f"labels/{number:06d}.txt").write_text(f"0 0.5 0.5 0.1 0.1\n{text}")
    for wanted, image in zip(told, load_images([folder], (assembly,), image_size=640), strict=True):
        np.testing.assert_array_equal(flags_of(image), flags_of(wanted))
        np.testing.assert_array_equal(image.objects[0].keypoints, wanted.objects[0].keypoints)
    moved = [
        replace(item, keypoints=item.keypoints + np.array([2, 0, 0], np.float32))
        for item in told[1].objects
    ]
    (folder / "labels/000001.txt").write_text(yolo_rows(moved, width=320, height=180))
    again = load_images([folder], (assembly,), image_size=640)
    np.testing.assert_array_equal(flags_of(again[0]), flags_of(told[0]))
    np.testing.assert_array_equal(flags_of(again[1]), flags_of(measured[1]))


def test_hardly_visible_objects_have_no_label(
    new_scene: Callable[[int], Path], assembly: Assembly
) -> None:
    folder = new_scene(2)
    info = json.loads((folder / "scene_gt_info.json").read_text())
    info["1"][2]["visib_fract"] = 0.1
    (folder / "scene_gt_info.json").write_text(json.dumps(info))
    images = load_images([folder], (assembly,), image_size=640)
    # The state is seen by its body.
    assert [o.part for o in images[1].objects] == ["bar", "body", None]
    info["1"][1]["visib_fract"] = 0.1
    (folder / "scene_gt_info.json").write_text(json.dumps(info))
    images = load_images([folder], (assembly,), image_size=640)
    assert [o.part for o in images[1].objects] == ["bar"]


def test_large_pictures_shrink_with_their_labels(scene: Path, assembly: Assembly) -> None:
    (full, *_), (small, *_) = (
        load_images([scene], (assembly,), image_size=size, limit=2) for size in (640, 160)
    )
    assert small.rgb.shape == (90, 160, 3)
    for a, b in zip(full.objects, small.objects, strict=True):
        np.testing.assert_allclose(
            (a.keypoints[:, :2] + 0.5) / 2 - 0.5, b.keypoints[:, :2], atol=1e-3
        )
        if b.part is not None and b.T_camera_part is not None:
            points = apply(b.T_camera_part, assembly.parts[b.part].keypoints)
            np.testing.assert_allclose(project(points, small.K), b.keypoints[:, :2], atol=1e-2)


def test_the_outline_lies_on_the_picture(scene: Path, assembly: Assembly) -> None:
    """The drawn body and the label agree to a pixel."""
    image = load_images([scene], (assembly,), image_size=640)[0]
    body = next(o for o in image.objects if o.part == "body")
    background = image.rgb[0, 0]
    seen = np.zeros(image.rgb.shape[:2], np.uint8)
    cv2.fillConvexPoly(seen, np.round(body.outline).astype(np.int32), 1)
    covered = (image.rgb != background).any(2)
    assert covered[cv2.erode(seen, np.ones((3, 3))) > 0].mean() > 0.99


@pytest.mark.parametrize("missing", ["scene_gt.json", "scene_camera.json"])
def test_a_folder_without_truth_is_refused(
    new_scene: Callable[[int], Path], assembly: Assembly, missing: str
) -> None:
    folder = new_scene(1)
    (folder / missing).unlink()
    with pytest.raises(SequenceError, match=r"scene_gt|scene_camera"):
        load_images([folder], (assembly,), image_size=640)


def test_frames_with_parts_that_nobody_checked_are_left_out_and_told(
    new_scene: Callable[[int], Path], assembly: Assembly
) -> None:
    folder = new_scene(3)
    assert told_unchecked([folder]) == ""
    unchecked = {"1": ["bar"], "2": [], "7": ["bar"]}
    (folder / "unchecked.json").write_text(json.dumps(unchecked))
    images = load_images([folder], (assembly,), image_size=640)
    assert [image.name[-6:] for image in images] == ["000000", "000002"]
    assert told_unchecked([folder]) == (
        f"1 frame of {folder} left out, with parts that nobody checked (unchecked.json)"
    )
    (folder / "unchecked.json").write_text(json.dumps({key: ["bar"] for key in "012"}))
    with pytest.raises(SequenceError, match=r"no frame with truth .*3 frames of .* nobody checked"):
        load_images([folder], (assembly,), image_size=640)
