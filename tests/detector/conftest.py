from __future__ import annotations

from pathlib import Path

import pytest
import torch

from asdfviz.detector.network import Network


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def reference(shared: Path) -> Path:
    return shared / "reference" / "yolov8n_pose"


@pytest.fixture
def public_network(reference: Path) -> Network:
    """The public network of size n with the reference weights."""
    network = Network("n", classes=16)
    network.load_state_dict(torch.load(reference / "state_dict.pt", weights_only=True))
    return network.eval()


@pytest.fixture
def tiny_network() -> Network:
    """Size n with random weights and running statistics that are not the starting ones."""
    torch.manual_seed(0)
    network = Network("n", classes=3, keypoint_width=128)
    with torch.no_grad():
        for name, value in network.named_buffers():
            if name.endswith("running_mean"):
                value.normal_(0, 0.1)
            if name.endswith("running_var"):
                value.uniform_(0.5, 1.5)
    return network.eval()
