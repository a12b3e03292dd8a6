"""One network for several assemblies: the names of its classes, and cutting it down to one of them.

A joint network learns "assembly/class" for every class of every assembly. Whoever detects one
assembly's parts keeps that assembly's outputs alone, so the others cost no time and cannot answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import torch
from torch import nn

from asdfviz.datatypes import Assembly
from asdfviz.detector.network import Network
from asdfviz.errors import WeightsError

SEPARATOR = "/"


def joint_classes(assemblies: Sequence[Assembly]) -> tuple[str, ...]:
    """Name the outputs of a network for these assemblies; a single one keeps its plain names."""
    if len(assemblies) == 1:
        return assemblies[0].detector_classes
    return tuple(f"{a.name}{SEPARATOR}{name}" for a in assemblies for name in a.detector_classes)


def own_columns(classes: Sequence[str], assembly: str) -> dict[str, int]:
    """Return the outputs of an assembly: plain class name to place; all of a plain network's.

    Raises:
        WeightsError: a joint network that does not know the assembly.
    """
    if not all(SEPARATOR in name for name in classes):
        return {name: place for place, name in enumerate(classes)}
    prefix = assembly + SEPARATOR
    columns = {n.removeprefix(prefix): i for i, n in enumerate(classes) if n.startswith(prefix)}
    if not columns:
        known = sorted({name.split(SEPARATOR)[0] for name in classes})
        raise WeightsError(
            f"these weights are for {', '.join(known)}, not for '{assembly}': name others"
        )
    return columns


@torch.no_grad()
def keep_classes(network: Network, columns: Sequence[int]) -> Network:
    """Drop all class outputs but these, in this order; changes the network and returns it."""
    for branch in network.head.cv3:
        layers = cast(nn.Sequential, branch)
        last = cast(nn.Conv2d, layers[2])
        like = last.weight
        kept = nn.Conv2d(last.in_channels, len(columns), 1, device=like.device, dtype=like.dtype)
        kept.weight.copy_(last.weight[list(columns)])
        if last.bias is not None and kept.bias is not None:
            kept.bias.copy_(last.bias[list(columns)])
        layers[2] = kept
    network.classes = len(columns)
    return network
