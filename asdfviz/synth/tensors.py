"""Between numpy and torch: the one place where arrays become tensors on a device."""

from __future__ import annotations

from typing import cast

import numpy as np
import torch
from jaxtyping import Float32, Int64, Shaped
from torch import Tensor
from torch.nn.functional import avg_pool2d


def to_tensor(
    array: Shaped[np.ndarray, "..."],
    device: torch.device | str,
    *,
    dtype: torch.dtype | None = None,
) -> Tensor:
    """Copy an array to a device, in its own type unless another is named."""
    return torch.tensor(array, dtype=dtype, device=device)


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Products of vectors along the last axis, of size 3, which stays with size 1; `a` is no smaller.

    Written out by coordinates: torch takes four times as long to sum over so short an axis.
    """
    x, y, z = a.unbind(-1)
    u, v, w = b.unbind(-1)
    return (x * u).addcmul_(y, v).addcmul_(z, w)[..., None]


def length(vectors: Tensor) -> Tensor:
    """Length of vectors along the last axis, of size 3, which stays with size 1."""
    return dot(vectors, vectors).sqrt_()


def unit(vectors: Tensor) -> Tensor:
    """Vectors along the last axis (of size 3) brought to length 1; zero stays zero."""
    x, y, z = vectors.unbind(-1)
    return vectors * (x * x + y * y + z * z).clamp_(min=1e-24).rsqrt_()[..., None]


def box_mean(
    images: Float32[Tensor, "b c h w"], radius: int, *, padding: int = 0
) -> Float32[Tensor, "b c h2 w2"]:
    """Means over squares of 2 `radius` + 1 pixels a side, with so many zeros about the images.

    As a row after a column: the square itself costs far more.
    """
    side = 2 * radius + 1
    columns = avg_pool2d(images, (side, 1), stride=1, padding=(padding, 0))
    return avg_pool2d(columns, (1, side), stride=1, padding=(0, padding))


def invert(matrices: Tensor) -> Tensor:
    """Inverses of square matrices, batched."""
    inverse = torch.linalg.inv(matrices)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType] - untyped in torch
    return cast(Tensor, inverse)


def transform_each(
    matrices: Float32[Tensor, "m 3 4"], points: Float32[Tensor, "n 3"], index: Int64[Tensor, "n"]
) -> Float32[Tensor, "3 n"]:
    """Affine images of points, each under the matrix that its index names; a row a coordinate.

    Written out by coordinates: many 3x3 products one by one are slow in torch.
    """
    M = matrices.reshape(-1, 12).T.index_select(1, index)
    x, y, z = points.T.contiguous()
    rows = [
        M[i + 3].addcmul(M[i], x).addcmul_(M[i + 1], y).addcmul_(M[i + 2], z) for i in (0, 4, 8)
    ]
    return torch.stack(rows)
