"""Reads and writes the weights of crop networks: safetensors with what they mean."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asdfviz.detector.crop_classes import state_spans
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.detector.packed_tensors import packed, unpacked
from asdfviz.detector.tensor_files import are_finite, fitting, read_tensors, write_tensors
from asdfviz.errors import WeightsError

FORMAT = "asdfviz-crops-2"


@dataclass(frozen=True, slots=True, eq=False)
class LoadedCropNetwork:
    """A crop network in evaluation mode and what its part numbers mean."""

    network: CropNetwork
    classes: tuple[str, ...]
    """As `class_name` and `group_name` give them."""
    states: Mapping[str, tuple[str, ...]]
    """Of every group its states, in the order of the network's outputs."""

    @property
    def spans(self) -> dict[str, slice]:
        """Where each group's states lie among the network's outputs."""
        return state_spans(self.states)


def save_crop_network(
    network: CropNetwork,
    path: Path,
    *,
    classes: Sequence[str],
    states: Mapping[str, Sequence[str]],
) -> None:
    """Write weights with all that is needed to rebuild the network; replaced at once or not at all.

    Args:
        network: with the weights.
        path: file to write.
        classes: names, in order.
        states: of every group its states, in order.
    """
    metadata = {
        "format": FORMAT,
        "classes": json.dumps(list(classes)),
        "states": json.dumps({name: list(of) for name, of in states.items()}),
        "shape": json.dumps(network.shape),
    }
    write_tensors(path, packed(network), metadata)


def load_crop_network(path: Path) -> LoadedCropNetwork:
    """Read what `save_crop_network` wrote.

    Raises:
        WeightsError: no such file, a corrupt one, or weights of another network.
    """
    if not path.is_file():
        raise WeightsError(
            f"no crop weights at '{path}': train them with `asdfviz train-crops`, or choose "
            "--first-pose keypoints"
        )
    tensors, metadata = read_tensors(
        path, format=FORMAT, otherwise="it does not hold a crop network"
    )
    with fitting(path, "a crop network"):
        classes = tuple(str(name) for name in json.loads(metadata["classes"]))
        told: dict[str, list[str]] = json.loads(metadata.get("states", "{}"))
        states = {name: tuple(str(state) for state in of) for name, of in told.items()}
        network = network_of_shape(json.loads(metadata["shape"]))
        weights = unpacked(tensors)
        network.load_state_dict(weights)
    if (
        not are_finite(weights)
        or len(classes) != network.classes
        or _count(states) != network.states
    ):
        raise WeightsError(f"'{path}' holds numbers that are not finite, or too few names")
    network.eval()
    return LoadedCropNetwork(network, classes, states)


def network_of_shape(shape: dict[str, Any]) -> CropNetwork:
    """A network with random weights of the shape that `CropNetwork.shape` told."""
    return CropNetwork(
        classes=int(shape["classes"]),
        grid=int(shape["grid"]),
        widths=tuple(int(w) for w in shape["widths"]),
        hidden=int(shape["hidden"]),
        own=int(shape["own"]),
        states=int(shape.get("states", 0)),
        names=bool(shape.get("names", False)),
    )


def _count(states: Mapping[str, Sequence[str]]) -> int:
    return sum(len(of) for of in states.values())
