"""The paper's "+Seg" row: registered, refused without its weights, and run on the sample."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.data.hashes import file_sha256
from asdfviz.data.sequences import open_sequence
from asdfviz.errors import WeightsError
from asdfviz.geometry.boxes import BoxMask
from asdfviz.methods.asdf_seg import AsdfSegConfig
from asdfviz.methods.network import NetworkConfig, masks_path, weights_path
from asdfviz.methods.registry import build_method, find_method
from asdfviz.methods.yolov8pose import Yolov8Pose
from asdfviz.run import run


def test_masks_lie_beside_the_detector_s_weights_unless_named(tmp_path: Path) -> None:
    clamp, vise = load_assembly("corner_clamp"), load_assembly("vise")
    for assembly in (clamp, vise):
        weights = weights_path(NetworkConfig(), assembly)
        assert masks_path(None, NetworkConfig(), assembly) == weights.with_name("masks.safetensors")
    named = NetworkConfig(weights=tmp_path / "own.safetensors")
    assert masks_path(None, named, clamp) == tmp_path / "masks.safetensors"
    assert masks_path(tmp_path / "m.safetensors", named, clamp) == tmp_path / "m.safetensors"


def test_without_its_weights_it_says_how_to_get_some(tmp_path: Path) -> None:
    assembly = load_assembly("corner_clamp")
    config = AsdfSegConfig(masks=tmp_path / "none.safetensors", first_pose="keypoints")
    method = build_method(find_method("asdf_seg"), config)
    camera = open_sequence("sample").camera
    with pytest.raises(WeightsError, match=r"no mask weights at .*train-masks"):
        method.reset(assembly, camera, None)


def test_masks_of_another_detector_are_refused(
    tmp_path: Path, another_file: Callable[[Path, Path], Path]
) -> None:
    assembly = load_assembly("corner_clamp")
    masks = masks_path(None, NetworkConfig(), assembly)
    weights = weights_path(NetworkConfig(), assembly)
    other = another_file(weights, tmp_path / "weights.safetensors")
    config = AsdfSegConfig(
        detector=NetworkConfig(weights=other), masks=masks, first_pose="keypoints"
    )
    method = build_method(find_method("asdf_seg"), config)
    with pytest.raises(WeightsError, match="other weights"):
        method.reset(assembly, open_sequence("sample").camera, None)


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Three frames of the sample that show all parts."""
    sequence = open_sequence("sample")
    folder = tmp_path / "short"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        for file in sorted((Path(sequence.path) / kind).iterdir())[20:26:2]:
            shutil.copy(file, folder / kind)
    for file in Path(sequence.path).glob("*.json"):
        shutil.copy(file, folder)
    return folder


@pytest.mark.parametrize("first_pose", ["keypoints", "hypotheses"])
def test_it_runs_on_the_sample(first_pose: str, short: Path) -> None:
    sequence = open_sequence(str(short))
    assert sequence.assembly is not None
    spec = find_method("asdf_seg")
    config = dataclasses.replace(spec.config(), first_pose=first_pose, first_depth=False)
    result = run(spec, sequence, config=config)
    plain = find_method("yolov8pose")
    bare = run(plain, sequence, config=plain.config(first_pose=first_pose, first_depth=False))
    assert len(result.predictions) == 3
    masks = masks_path(None, NetworkConfig(), sequence.assembly)
    assert result.hashes["masks"] == file_sha256(masks)
    assert result.config["masks"] == masks
    assert "masks" not in bare.hashes
    errors: dict[str, list[float]] = {"seg": [], "bare": []}
    for place, (masked, raw) in enumerate(zip(result.predictions, bare.predictions, strict=True)):
        truth = sequence.truth(place)
        assert truth is not None
        assert masked.state is not None
        assert raw.state is not None
        assert masked.runtime["refine"] > 0
        assert set(masked.poses) == set(raw.poses)
        for name, pose in masked.poses.items():
            # Boxes, first poses and rotations are those of the baseline; distance alone changes.
            R_first = raw.poses[name].T_camera_part[:3, :3]
            assert np.array_equal(pose.T_camera_part[:3, :3], R_first)
            middle = sequence.assembly.parts[name].middle
            for kind, one in (("seg", pose), ("bare", raw.poses[name])):
                T, T_true = one.T_camera_part, truth.T_camera_part[name]
                off = (T[:3, :3] - T_true[:3, :3]) @ middle + T[:3, 3] - T_true[:3, 3]
                errors[kind].append(float(np.linalg.norm(off)))
    stages = [p.stage for one in result.predictions for p in one.poses.values()]
    assert stages.count("refined") > len(stages) / 2
    assert np.median(errors["seg"]) < 0.8 * np.median(errors["bare"])


def test_the_mask_says_which_readings_are_the_part_s(toy) -> None:
    poses = toy.poses(joined=False)
    frame = toy.frame(0, poses)
    depth = toy.depth(poses)
    assert frame.depth is not None
    alone = {name: toy.depth({name: T}) for name, T in poses.items()}
    detections = []
    for name, T in poses.items():
        detection = toy.detection(name, T)
        left, top = np.ceil(detection.box_xyxy[:2]).astype(int).clip(0)
        right, bottom = np.floor(detection.box_xyxy[2:]).astype(int) + 1
        shown = (alone[name] == depth) & (alone[name] < 0.74)
        mask = BoxMask(int(left), int(top), shown[top:bottom, left:right])
        detections.append(dataclasses.replace(detection, mask=mask if name == "base" else None))

    class Answers:
        def detect(self, rgb):
            return tuple(detections)

    method = Yolov8Pose(AsdfSegConfig(first_pose="keypoints"), detector=Answers())
    method.reset(toy.assembly, frame.camera, None)
    prediction = method.step(frame)
    assert {n: p.stage for n, p in prediction.poses.items()} == {"base": "refined", "block": "pnp"}
