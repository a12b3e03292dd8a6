"""What computes the network: torch, ONNX Runtime or OpenVINO, with the same outputs.

The other two compile the network for the shape of the input when they first meet it: inputs of one
sequence all have the same shape.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from typing import Any, Literal, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from asdfviz.detector.head import decode
from asdfviz.detector.network import Network
from asdfviz.detector.precision import has_bfloat16
from asdfviz.errors import InputError

Backend = Literal["torch", "onnxruntime", "openvino"]
Compiled: TypeAlias = Callable[[np.ndarray], np.ndarray]


@runtime_checkable
class Runs(Protocol):
    """Computes decoded columns of a picture, as `decode` lists them."""

    strides: tuple[int, ...]

    def __call__(self, images: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 n a"]:
        """Run on RGB in 0 to 1 whose sides are multiples of the last stride."""
        ...


class TorchRun:
    """torch, on any of its devices."""

    def __init__(self, network: Network, *, device: str, bfloat16: bool) -> None:
        """Keep a network that is in evaluation mode and on its device."""
        self.strides: tuple[int, ...] = network.strides
        self._network = network
        self._device = device
        self._half = bfloat16 and has_bfloat16(device)

    def __call__(self, images: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 n a"]:
        """Run."""
        inputs = images.to(self._device).contiguous(memory_format=torch.channels_last)
        kind = torch.device(self._device).type
        with (
            torch.inference_mode(),
            torch.autocast(kind, dtype=torch.bfloat16, enabled=self._half),
        ):
            return decode(self._network(inputs)).float()


class CompiledRun:
    """A network compiled by another program, once for every shape of input."""

    def __init__(self, network: Network, compile: Callable[[nn.Module, Tensor], Compiled]) -> None:
        """Keep a fused network on the CPU."""
        self.strides: tuple[int, ...] = network.strides
        self._decoded = _Decoded(network).eval()
        self._compile = compile
        self._by_shape: dict[tuple[int, ...], Compiled] = {}

    def __call__(self, images: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 n a"]:
        """Run; the first input of a shape takes a few seconds."""
        inputs = images.contiguous()
        shape = tuple(inputs.shape)
        if shape not in self._by_shape:
            self._by_shape[shape] = self._compile(self._decoded, inputs)
        return torch.as_tensor(self._by_shape[shape](inputs.numpy()))


class _Decoded(nn.Module):
    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> Tensor:
        return decode(self.network(images))


def make_run(network: Network, *, backend: Backend, device: str, bfloat16: bool) -> Runs:
    """Return what runs a fused network.

    Raises:
        InputError: the backend is not installed, or cannot do what is asked for.
    """
    if backend == "torch":
        network.to(device).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        return TorchRun(network, device=device, bfloat16=bfloat16)
    if device != "cpu":
        raise InputError(f"the backend {backend} runs on the cpu alone, asked for was {device}")
    for module in ("onnx", backend):
        _require(module, backend)
    if backend == "onnxruntime":
        if bfloat16:
            raise InputError("the backend onnxruntime has no bfloat16: use torch or openvino")
        return CompiledRun(network, _compile_onnx)
    half = bfloat16 and has_bfloat16(device)
    return CompiledRun(network, lambda module, images: _compile_openvino(module, images, half=half))


def _require(module: str, backend: str) -> None:
    try:
        __import__(module)
    except ImportError as error:
        raise InputError(
            f"the backend {backend} needs the package {module}: pip install 'asdfviz[{backend}]'"
        ) from error


def _as_onnx(module: nn.Module, images: Tensor) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        # The tracing exporter warns of itself; the other one needs two packages more.
        warnings.simplefilter("ignore")
        export = cast(Any, torch.onnx).export
        export(module, (images,), buffer, dynamo=False, input_names=["images"])
    return buffer.getvalue()


def _compile_onnx(module: nn.Module, images: Tensor) -> Compiled:
    import onnxruntime  # pyright: ignore[reportMissingTypeStubs] - has none

    runtime = cast(Any, onnxruntime)
    options = runtime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    model = _as_onnx(module, images)
    session = runtime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    return lambda inputs: session.run(None, {"images": inputs})[0]


def _compile_openvino(module: nn.Module, images: Tensor, *, half: bool) -> Compiled:
    import openvino  # pyright: ignore[reportMissingTypeStubs] - has none

    core = cast(Any, openvino).Core()
    # Read as ONNX: OpenVINO's own converter of torch models reports its use over the network.
    model = core.read_model(_as_onnx(module, images), b"")
    precision = "bf16" if half else "f32"
    threads = torch.get_num_threads()
    settings = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads}
    compiled = core.compile_model(model, "CPU", settings)
    return lambda inputs: compiled(inputs)[0]
