"""Weights as small files hold them: matrices in 8 bits, the rest in half precision.

Half the size of half precision, and answers that differ less than two trainings of the same network.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import cast

import torch
from torch import Tensor, nn

_SCALE = ".scale"
"""Ends the name of the scales that belong to a tensor of 8 bits."""
_LEVELS = 127


def packed(
    network: nn.Module, *, by_last: Collection[str] = (), exact: Collection[str] = ()
) -> dict[str, Tensor]:
    """A network's weights, on the CPU.

    Args:
        network: whose.
        by_last: tensors with one scale for what differs in the last dimension only; others have one
            for each place of the first (an output channel).
        exact: tensors that stay in single precision.
    """
    tensors: dict[str, Tensor] = {}
    for name, tensor in network.state_dict().items():
        value = cast(Tensor, tensor).detach().cpu()
        if name in exact:
            tensors[name] = value.contiguous()
        else:
            tensors |= _packed(name, value, by_last=name in by_last)
    return tensors


def unpacked(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """What `packed` packed, in single precision."""
    weights: dict[str, Tensor] = {}
    for name, value in tensors.items():
        if value.dtype == torch.int8:
            scale = tensors[name + _SCALE].float()
            weights[name] = (value.float().view(len(scale), -1) * scale[:, None]).view(value.shape)
        elif not name.endswith(_SCALE):
            weights[name] = value.float() if value.is_floating_point() else value
    return weights


def _packed(name: str, value: Tensor, *, by_last: bool) -> dict[str, Tensor]:
    """A weight as it lies in the file: one tensor, or whole numbers and the scale of every row."""
    if not value.is_floating_point():
        return {name: value.contiguous()}
    if value.dim() < 2:
        return {name: value.half().contiguous()}
    rows = value.float().flatten(0, -2) if by_last else value.float().flatten(1)
    scale = (rows.abs().amax(dim=1) / _LEVELS).half().float().clamp_min(1e-7)
    levels = (rows / scale[:, None]).round().clamp(-_LEVELS, _LEVELS).to(torch.int8)
    return {name: levels.view(value.shape).contiguous(), name + _SCALE: scale.half()}
