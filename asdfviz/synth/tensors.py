"""Between numpy and torch: the one place where arrays become tensors on a device."""

from __future__ import annotations

from typing import cast

import numpy as np
import torch
from jaxtyping import Shaped
from torch import Tensor


def to_tensor(
    array: Shaped[np.ndarray, "..."],
    device: torch.device | str,
    *,
    dtype: torch.dtype | None = None,
) -> Tensor:
    """Copy an array to a device, in its own type unless another is named."""
    tensor: Tensor = torch.tensor(array, dtype=dtype)
    return tensor.to(device)


def length(vectors: Tensor) -> Tensor:
    """Length of vectors along the last axis, which stays with size 1."""
    return (vectors * vectors).sum(dim=-1, keepdim=True).sqrt()


def invert(matrices: Tensor) -> Tensor:
    """Inverses of square matrices, batched."""
    inverse = torch.linalg.inv(matrices)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType] - untyped in torch
    return cast(Tensor, inverse)
