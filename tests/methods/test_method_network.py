from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Detection
from asdfviz.errors import InputError, WeightsError
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.network import NetworkConfig, has_detector, load_detector, weights_path


def save_random(path: Path, classes: tuple[str, ...]) -> Path:
    torch = pytest.importorskip("torch")
    from asdfviz.detector.network import Network
    from asdfviz.detector.weights import save_network

    torch.manual_seed(0)
    save_network(Network("n", classes=len(classes)), path, classes=classes, image_size=320)
    return path


def test_weights_lie_beside_the_assembly_unless_named(assembly: Assembly, tmp_path: Path) -> None:
    assert weights_path(NetworkConfig(), assembly) == Path("/toy/weights.safetensors")
    named = NetworkConfig(weights=tmp_path / "mine.safetensors")
    assert weights_path(named, assembly) == tmp_path / "mine.safetensors"


def test_a_network_of_several_assemblies_is_theirs_alone(toy, tmp_path: Path) -> None:
    folder = tmp_path / "toy"
    folder.mkdir()
    assembly = dataclasses.replace(toy.assembly, path=str(folder / "assembly.yaml"))
    assert not has_detector(NetworkConfig(), assembly)
    joint = tmp_path / "weights.safetensors"
    save_random(joint, ("boat/hull", "kite/tail"))
    assert not has_detector(NetworkConfig(), assembly)
    save_random(joint, ("boat/hull", f"{assembly.name}/base"))
    assert has_detector(NetworkConfig(), assembly)
    joint.write_bytes(b"broken")
    assert has_detector(NetworkConfig(), assembly)  # whoever loads it is told what is wrong
    (folder / "weights.safetensors").write_bytes(b"read when it runs")
    assert has_detector(NetworkConfig(), assembly)


def test_a_network_runs_as_configured(toy, tmp_path: Path) -> None:
    path = save_random(tmp_path / "weights.safetensors", toy.assembly.detector_classes)
    config = NetworkConfig(weights=path, image_size=160, confidence=0.001)
    detections = load_detector(config, toy.assembly).detect(toy.frame(7).rgb)
    assert {d.label for d in detections} <= set(toy.assembly.detector_classes)
    method = Asdf(dataclasses.replace(AsdfConfig(), detector=config))
    method.reset(toy.assembly, toy.frame(0).camera, None)
    prediction = method.step(toy.frame(7))
    assert len(prediction.detections) == len(detections)
    assert prediction.runtime["detect"] > 0


def test_weights_of_another_assembly_are_refused(assembly: Assembly, tmp_path: Path) -> None:
    path = save_random(tmp_path / "weights.safetensors", ("wheel", "axle"))
    with pytest.raises(WeightsError, match="wheel, axle"):
        load_detector(NetworkConfig(weights=path), assembly)


def test_a_state_dict_without_names_takes_the_assembly_s_classes(toy, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from asdfviz.detector.network import Network

    classes = toy.assembly.detector_classes
    torch.save(Network("n", classes=len(classes)).state_dict(), tmp_path / "own.pt")
    detector = load_detector(NetworkConfig(weights=tmp_path / "own.pt"), toy.assembly)
    assert getattr(detector, "classes") == classes  # noqa: B009 - not part of the protocol
    torch.save(Network("n", classes=len(classes) + 1).state_dict(), tmp_path / "more.pt")
    with pytest.raises(WeightsError, match=f"has {len(classes) + 1} classes"):
        load_detector(NetworkConfig(weights=tmp_path / "more.pt"), toy.assembly)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"confidence": 5.0}, "confidence is 5, use a score from 0 to 1"),
        ({"confidence": float("nan")}, "confidence is nan"),
        ({"image_size": 0}, "image_size is 0, use 32 pixels or more"),
        ({"device": "toaster"}, "device 'toaster' cannot be used here"),
    ],
)
def test_an_impossible_option_is_an_error(toy, tmp_path: Path, options, message: str) -> None:
    path = save_random(tmp_path / "weights.safetensors", toy.assembly.detector_classes)
    with pytest.raises(InputError, match=message):
        load_detector(NetworkConfig(weights=path, **options), toy.assembly)


def test_another_number_of_keypoints_is_an_error(toy, detector) -> None:
    box = np.array([100.0, 80, 220, 160])
    detector.answers[1] = (Detection("base", box, np.zeros((5, 2)), np.ones(5), 0.9),)
    method = Asdf(AsdfConfig(), detector=detector)
    method.reset(toy.assembly, toy.frame(0).camera, None)
    with pytest.raises(WeightsError, match="5 keypoints"):
        method.step(toy.frame(1))
