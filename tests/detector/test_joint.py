from __future__ import annotations

import copy
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.detector.detector import Detector, DetectorConfig
from asdfviz.detector.joint import joint_classes, keep_classes, own_columns
from asdfviz.detector.network import Network
from asdfviz.detector.weights import save_network
from asdfviz.errors import WeightsError

JOINT = ("vise/jaw", "clamp/jaw", "clamp/bolt", "clamp/clamp:1")


def test_one_assembly_keeps_plain_names_and_several_get_their_own() -> None:
    clamp = load_assembly("corner_clamp")
    twin = dataclasses.replace(clamp, name="twin")
    names = clamp.detector_classes
    assert joint_classes([clamp]) == names
    both = [f"{a}/{n}" for a in ("corner_clamp", "twin") for n in names]
    assert joint_classes([clamp, twin]) == tuple(both)


def test_an_assembly_finds_its_outputs() -> None:
    assert own_columns(JOINT, "clamp") == {"jaw": 1, "bolt": 2, "clamp:1": 3}
    assert own_columns(("jaw", "clamp:1"), "whatever") == {"jaw": 0, "clamp:1": 1}
    with pytest.raises(WeightsError, match="for clamp, vise, not for 'caliper'"):
        own_columns(JOINT, "caliper")


def test_the_outputs_that_are_kept_do_not_change() -> None:
    torch.manual_seed(3)
    network = Network("n", classes=4).eval()
    images = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        whole = network(images)
        kept = keep_classes(copy.deepcopy(network), (3, 1))(images)
    assert torch.equal(kept.scores, whole.scores[:, [3, 1]])
    assert torch.equal(kept.boxes, whole.boxes)
    assert torch.equal(kept.keypoints, whole.keypoints)


def test_the_outputs_that_are_kept_stay_where_the_network_is() -> None:
    network = keep_classes(Network("n", classes=4).to("meta").half(), (3, 1))
    kept = {(p.device.type, p.dtype) for p in network.parameters()}
    assert kept == {("meta", torch.float16)}


def test_a_detector_answers_for_its_assembly_alone(tmp_path: Path) -> None:
    torch.manual_seed(4)
    network = Network("n", classes=4)
    for branch in network.head.cv3:
        branch[2].bias.data.fill_(4.0)  # type: ignore[index, union-attr] - every anchor answers
    path = tmp_path / "weights.safetensors"
    save_network(network, path, classes=JOINT, image_size=64)
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    detector = Detector(path, config=DetectorConfig(image_size=64), assembly="clamp")
    assert detector.classes == ("jaw", "bolt", "clamp:1")
    labels = {found.label for found in detector.detect(picture)}
    assert labels
    assert labels <= set(detector.classes)
    with pytest.raises(WeightsError, match="caliper"):
        Detector(path, assembly="caliper")
