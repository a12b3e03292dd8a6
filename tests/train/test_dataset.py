from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply
from asdfviz.train.dataset import load_images


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
