from __future__ import annotations

import sys

import pytest
import torch

from asdfviz.detector.backends import Backend, make_run
from asdfviz.detector.network import Network
from asdfviz.errors import InputError


@pytest.fixture(scope="module")
def network() -> Network:
    torch.manual_seed(5)
    network = Network("n", classes=4)
    # Norms with statistics of their own, so that folding them matters.
    for name, buffer in network.named_buffers():
        if name.endswith("running_var"):
            buffer.uniform_(0.5, 2.0)
    return network.eval().fuse()


@pytest.mark.parametrize("backend", ["onnxruntime", "openvino"])
def test_every_backend_puts_out_the_same(network: Network, backend: Backend) -> None:
    run = make_run(network, backend=backend, device="cpu", bfloat16=False)
    reference = make_run(network, backend="torch", device="cpu", bfloat16=False)
    assert run.strides == (8, 16, 32)
    for size in ((64, 96), (96, 64)):
        images = torch.rand(1, 3, *size, generator=torch.Generator().manual_seed(1))
        expected = reference(images)
        assert expected.shape[1] == 4 + 4 + 51
        assert torch.allclose(run(images), expected, atol=1e-3, rtol=0)


def test_a_backend_that_is_not_installed_says_how(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "openvino", None)
    with pytest.raises(InputError, match=r"needs the package openvino: pip install 'asdfviz\[open"):
        make_run(network, backend="openvino", device="cpu", bfloat16=False)


def test_what_a_backend_cannot_do_is_refused(network: Network) -> None:
    with pytest.raises(InputError, match="runs on the cpu alone"):
        make_run(network, backend="openvino", device="cuda", bfloat16=False)
    with pytest.raises(InputError, match="no bfloat16"):
        make_run(network, backend="onnxruntime", device="cpu", bfloat16=True)
