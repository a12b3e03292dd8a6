"""Reads and writes the weights of state networks: safetensors with what they mean."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from asdfviz.detector.crop_classes import state_spans
from asdfviz.detector.packed_tensors import packed, unpacked
from asdfviz.detector.state_network import GEOMETRY, StateNetwork
from asdfviz.detector.tensor_files import (
    are_finite,
    fitting,
    read_metadata,
    read_tensors,
    write_tensors,
)
from asdfviz.errors import WeightsError

FORMAT = "asdfviz-states-2"
_KIND = "state network"
_OTHERWISE = f"it holds no {_KIND} of this version; `asdfviz train-states` makes one"


@dataclass(frozen=True, slots=True, eq=False)
class LoadedStateNetwork:
    """A state network in evaluation mode and what its numbers mean."""

    network: StateNetwork
    states: Mapping[str, tuple[str, ...]]
    """Of every group (`group_name`), in the order of the network's, its states in that of its outputs."""

    @property
    def spans(self) -> dict[str, slice]:
        """Where each group's states lie among the network's outputs."""
        return state_spans(self.states)


def save_state_network(
    network: StateNetwork, path: Path, *, states: Mapping[str, Sequence[str]]
) -> None:
    """Write weights with all that is needed to rebuild the network; replaced at once or not at all.

    Args:
        network: with the weights.
        path: file to write.
        states: of every group its states, in order.
    """
    metadata = {
        "format": FORMAT,
        "states": json.dumps({name: list(of) for name, of in states.items()}),
        "shape": json.dumps(network.shape),
    }
    tensors = packed(network, by_last=("own", "gather"), exact=GEOMETRY)
    write_tensors(path, tensors, metadata)


def states_known(path: Path) -> dict[str, tuple[str, ...]]:
    """The states of every group that a file of weights tells apart.

    Raises:
        WeightsError: a file that is not whole, or of another network.
    """
    metadata = read_metadata(path, format=FORMAT, otherwise=_OTHERWISE)
    with fitting(path, f"a {_KIND}"):
        return _states(metadata)


def load_state_network(path: Path) -> LoadedStateNetwork:
    """Read what `save_state_network` wrote.

    Raises:
        WeightsError: no such file, a corrupt one, or weights of another network.
    """
    if not path.is_file():
        raise WeightsError(
            f"no state weights at '{path}': train them with `asdfviz train-states`, or choose "
            "--state-looks crops"
        )
    tensors, metadata = read_tensors(path, format=FORMAT, otherwise=_OTHERWISE)
    with fitting(path, f"a {_KIND}"):
        states = _states(metadata)
        network = state_network_of_shape(json.loads(metadata["shape"]))
        weights = unpacked(tensors)
        network.load_state_dict(weights)
    count = sum(len(of) for of in states.values())
    if not are_finite(weights) or len(states) != network.groups or count != network.states:
        raise WeightsError(f"'{path}' holds numbers that are not finite, or too few names")
    network.eval()
    return LoadedStateNetwork(network, states)


def state_network_of_shape(shape: dict[str, Any]) -> StateNetwork:
    """A network with random weights, and no points yet, of the shape that `StateNetwork.shape` told."""
    nowhere = torch.zeros(int(shape["groups"]), int(shape["points"]), 3)
    return StateNetwork(
        points=nowhere,
        normals=nowhere.clone(),
        axes=nowhere[:, 0].clone(),
        states=int(shape["states"]),
        widths=tuple(int(w) for w in shape["widths"]),
        hidden=int(shape["hidden"]),
    )


def _states(metadata: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    told: dict[str, list[str]] = json.loads(metadata["states"])
    return {name: tuple(str(state) for state in of) for name, of in told.items()}
