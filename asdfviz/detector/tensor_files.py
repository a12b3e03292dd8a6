"""Safetensors files as all our networks have them: tensors and metadata that begins with a format."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from asdfviz.data.atomic import write_bytes
from asdfviz.errors import WeightsError


def half_tensors(module: nn.Module) -> dict[str, Tensor]:
    """A module's weights in half precision, on the CPU; whole numbers stay."""
    tensors: dict[str, Tensor] = {}
    for name, tensor in module.state_dict().items():
        value = cast(Tensor, tensor)
        half = value.half() if value.is_floating_point() else value
        tensors[name] = half.detach().cpu().contiguous()
    return tensors


def single_tensors(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same in single precision; whole numbers stay."""
    return {
        n: value.float() if value.is_floating_point() else value for n, value in tensors.items()
    }


def write_tensors(path: Path, tensors: dict[str, Tensor], metadata: dict[str, str]) -> None:
    """Write a file; it is replaced at once or not at all."""
    write_bytes(path, save(tensors, metadata=metadata))


def read_tensors(
    path: Path, *, format: str, otherwise: str
) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read tensors and metadata.

    Args:
        path: the file.
        format: that the metadata must name.
        otherwise: what a file of another format is, for the message.

    Raises:
        WeightsError: a file that is not whole, or of another format.
    """
    return _read(path, format, otherwise, with_tensors=True)


def read_metadata(path: Path, *, format: str, otherwise: str) -> dict[str, str]:
    """Read the metadata alone (see `read_tensors`)."""
    return _read(path, format, otherwise, with_tensors=False)[1]


def format_of(path: Path) -> str | None:
    """The format that a file's metadata names.

    Raises:
        WeightsError: a file that is not whole.
    """
    return _content(path, with_tensors=False)[1].get("format")


@contextmanager
def fitting(path: Path, network: str) -> Generator[None]:
    """Where a network is rebuilt from a file: what does not fit is one WeightsError that names both.

    Args:
        path: the file.
        network: what it is to be, such as "a crop network".
    """
    try:
        yield
    except (KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        # Torch says which tensors do not fit on many lines; the first says what is wrong.
        reason = str(error).splitlines()[0] if str(error) else repr(error)
        raise WeightsError(f"'{path}' does not fit {network}: {reason}") from error


def are_finite(tensors: Mapping[str, Tensor]) -> bool:
    """Whether no number of any tensor is infinite or none."""
    floating = (value for value in tensors.values() if value.is_floating_point())
    return all(bool(torch.isfinite(value).all()) for value in floating)


def _read(
    path: Path, format: str, otherwise: str, *, with_tensors: bool
) -> tuple[dict[str, Tensor], dict[str, str]]:
    tensors, metadata = _content(path, with_tensors=with_tensors)
    if metadata.get("format") != format:
        raise WeightsError(
            f"'{path}' says format '{metadata.get('format')}', expected '{format}': {otherwise}"
        )
    return tensors, metadata


def _content(path: Path, *, with_tensors: bool) -> tuple[dict[str, Tensor], dict[str, str]]:
    try:
        with cast(Any, safe_open)(path, framework="pt") as file:
            metadata = cast(dict[str, str], file.metadata() or {})
            names = cast(list[str], file.keys()) if with_tensors else []
            tensors = {name: cast(Tensor, file.get_tensor(name)) for name in names}
    except (SafetensorError, OSError, ValueError) as error:
        instead = "; a checkpoint's run leaves one beside it" if path.suffix == ".pt" else ""
        raise WeightsError(f"'{path}' is not a whole safetensors file: {error}{instead}") from error
    return tensors, metadata
