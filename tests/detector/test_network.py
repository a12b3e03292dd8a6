from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.detector.head import decode
from asdfviz.detector.network import Network, Scale


@pytest.mark.parametrize("scale", ["n", "s", "m", "l", "x", "x-p6"])
def test_the_layout_is_the_public_one(reference: Path, scale: Scale) -> None:
    wanted = json.loads((reference / f"ultralytics_v8pose_{scale}_keys.json").read_text())
    with torch.device("meta"):
        network = Network(scale, classes=wanted["nc"])
    layout = {name: list(value.shape) for name, value in network.state_dict().items()}
    assert layout == wanted["keys"]
    assert sum(p.numel() for p in network.parameters()) == wanted["n_params"]


@pytest.mark.parametrize("case", ["a", "b"])
def test_forward_and_decode_equal_the_public_network(
    reference: Path, public_network: Network, case: str
) -> None:
    wanted = np.load(reference / "forward.npz")
    with torch.inference_mode():
        raw = public_network(torch.as_tensor(wanted[f"{case}_x"]))
        decoded = decode(raw)
    for mine, name in ((raw.boxes, "boxes"), (raw.scores, "scores"), (raw.keypoints, "kpts")):
        np.testing.assert_allclose(mine, wanted[f"{case}_raw_{name}"], atol=1e-4)
    # Pixels up to 480 in single precision: a relative tolerance comes on top.
    np.testing.assert_allclose(decoded, wanted[f"{case}_y"], atol=1e-4, rtol=1e-6)


def test_folding_the_batch_norms_equals_the_public_fused_network(
    reference: Path, public_network: Network
) -> None:
    wanted = np.load(reference / "forward.npz")
    with torch.inference_mode():
        decoded = decode(public_network.fuse()(torch.as_tensor(wanted["a_x"])))
    np.testing.assert_allclose(decoded, wanted["a_y_fused"], atol=1e-4, rtol=1e-6)


def test_folding_changes_nothing_and_can_be_done_twice(tiny_network: Network) -> None:
    images = torch.rand(1, 3, 64, 96)
    with torch.inference_mode():
        before = decode(tiny_network(images))
        after = decode(tiny_network.fuse().fuse()(images))
    torch.testing.assert_close(before, after, atol=2e-3, rtol=1e-4)
    assert not any("bn.running_mean" in name for name in tiny_network.state_dict())


def test_a_wide_keypoint_branch_changes_that_branch_alone() -> None:
    stock = Network("n", classes=3).state_dict()
    wide = Network("n", classes=3, keypoint_width=128).state_dict()
    changed = {k for k in stock if stock[k].shape != wide[k].shape}
    assert changed
    assert all(".cv4." in name for name in changed)


@pytest.mark.parametrize(("scale", "levels"), [("n", 3), ("x-p6", 4)])
def test_every_level_has_its_anchors(scale: Scale, levels: int) -> None:
    torch.manual_seed(0)
    network = Network(scale, classes=2).eval()
    with torch.inference_mode():
        raw = network(torch.zeros(1, 3, 64, 128))
    cells = sum((64 // s) * (128 // s) for s in (8, 16, 32, 64)[:levels])
    assert raw.boxes.shape == (1, 64, cells)
    assert raw.keypoints.shape == (1, 51, cells)


def test_bfloat16_keeps_the_outputs_in_single_precision(tiny_network: Network) -> None:
    with torch.inference_mode(), torch.autocast("cpu", dtype=torch.bfloat16):
        raw = tiny_network(torch.rand(1, 3, 64, 64))
    assert raw.keypoints.dtype == torch.float32
