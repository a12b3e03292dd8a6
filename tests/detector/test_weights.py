from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from asdfviz.detector.head import decode
from asdfviz.detector.network import Network
from asdfviz.detector.weights import load_network, save_network
from asdfviz.errors import WeightsError

CLASSES = ("body", "bolt", "toy:joined")


@pytest.fixture
def weights(tiny_network: Network, tmp_path: Path) -> Path:
    path = tmp_path / "weights.safetensors"
    save_network(tiny_network, path, classes=CLASSES, image_size=512)
    return path


def test_weights_come_back_with_what_they_mean(weights: Path, tiny_network: Network) -> None:
    loaded = load_network(weights)
    assert loaded.classes == CLASSES
    assert (loaded.scale, loaded.keypoint_width, loaded.image_size) == ("n", 128, 512)
    assert not loaded.network.training
    images = torch.rand(1, 3, 64, 64)
    with torch.inference_mode():
        there, back = decode(tiny_network(images)), decode(loaded.network(images))
    # Half precision keeps three digits.
    torch.testing.assert_close(there, back, atol=0.5, rtol=1e-2)
    assert list(weights.parent.iterdir()) == [weights]


def test_a_public_state_dict_loads(reference: Path, public_network: Network) -> None:
    loaded = load_network(reference / "state_dict.pt")
    assert (loaded.scale, len(loaded.classes), loaded.keypoint_width) == ("n", 16, 51)
    images = torch.rand(1, 3, 64, 64)
    with torch.inference_mode():
        torch.testing.assert_close(decode(public_network(images)), decode(loaded.network(images)))


@pytest.mark.parametrize("wrap", [None, "model", "state_dict"])
def test_plain_state_dicts_of_users_load(
    tiny_network: Network, tmp_path: Path, wrap: str | None
) -> None:
    state = tiny_network.state_dict()
    torch.save(state if wrap is None else {wrap: state}, tmp_path / "own.pt")
    loaded = load_network(tmp_path / "own.pt", classes=CLASSES)
    assert loaded.classes == CLASSES
    assert loaded.keypoint_width == 128


class Payload:
    """What a malicious pickle would run."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("touch hacked",)


def broken_files(folder: Path, good: Path, network: Network) -> dict[str, Path]:
    data = good.read_bytes()
    flipped = bytearray(data)
    flipped[:8] = b"\xff" * 8
    files = {
        "cut": data[: len(data) // 2],
        "empty": b"",
        "text": b"hello",
        "flipped": bytes(flipped),
    }
    for name, content in files.items():
        (folder / f"{name}.safetensors").write_bytes(content)
        (folder / f"{name}.pt").write_bytes(content)
    torch.save({"model.0": Payload()}, folder / "pickled.pt")
    torch.save({"weights": torch.zeros(2)}, folder / "other.pt")
    torch.save([1, 2], folder / "list.pt")
    torch.save({"model.0.conv.weight": torch.zeros(16, 3, 3, 3)}, folder / "part.pt")
    state = network.state_dict()
    state["model.0.bn.bias"] = torch.full_like(state["model.0.bn.bias"], float("nan"))
    torch.save(state, folder / "nan.pt")
    torch.save(network.state_dict(), folder / "whole.pt")
    (folder / "half.pt").write_bytes((folder / "whole.pt").read_bytes()[:100_000])
    (folder / "whole.pt").unlink()
    save_file({"a": torch.zeros(1)}, folder / "foreign.safetensors")
    return {p.name: p for p in folder.iterdir() if p != good}


def test_whatever_is_wrong_is_a_weights_error(
    weights: Path, tiny_network: Network, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    broken = broken_files(tmp_path, weights, tiny_network)
    assert len(broken) > 12
    for path in [*broken.values(), tmp_path / "absent.pt", tmp_path / "absent.safetensors"]:
        with pytest.raises(WeightsError) as caught:
            load_network(path)
        assert path.name in str(caught.value)
    assert not (tmp_path / "hacked").exists()


def test_weights_of_another_assembly_are_refused(weights: Path) -> None:
    with pytest.raises(WeightsError, match="was trained for the classes"):
        load_network(weights, classes=("a", "b", "c"))
    assert load_network(weights, classes=CLASSES).classes == CLASSES


def test_the_wide_branch_costs_about_a_megabyte(weights: Path) -> None:
    assert weights.stat().st_size < 8.2e6
    assert np.isfinite(load_network(weights).network.head.dfl.conv.weight.detach().numpy()).all()
