"""What a training run of the state network begins with, and the export of its weights."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from asdfviz.data.atomic import write_text
from asdfviz.detector.crop_maps import MAPS
from asdfviz.detector.crop_weights import FORMAT as CROP_FORMAT
from asdfviz.detector.crop_weights import load_crop_network
from asdfviz.detector.state_network import GEOMETRY, StateNetwork
from asdfviz.detector.state_weights import load_state_network, save_state_network
from asdfviz.detector.tensor_files import format_of
from asdfviz.errors import WeightsError
from asdfviz.train.checkpoint import Progress
from asdfviz.train.record import record_of
from asdfviz.train.state_config import StateTrainConfig
from asdfviz.train.state_validation import StateValidation

STATE_WEIGHTS = "states.safetensors"


@torch.no_grad()
def begin_states_from(
    network: StateNetwork, weights: Path, *, states: Mapping[str, Sequence[str]]
) -> None:
    """Take over what another network learned: all of a state network, the maps of a crop network.

    Args:
        network: to change.
        weights: states.safetensors for the same groups, or crops.safetensors.
        states: of every group of `network`.

    Raises:
        WeightsError: no such file, a corrupt one, or weights of other groups or sizes.
    """
    own = network.state_dict()
    if not weights.is_file():
        raise WeightsError(f"no weights to begin with at '{weights}'")
    if format_of(weights) != CROP_FORMAT:
        loaded = load_state_network(weights)
        if dict(loaded.states) != {name: tuple(of) for name, of in states.items()}:
            raise WeightsError(f"'{weights}' tells other states: {dict(loaded.states)}")
        if loaded.network.shape != network.shape:
            raise WeightsError(f"'{weights}' has the shape {loaded.network.shape}")
        learned = loaded.network.state_dict()
        network.load_state_dict(learned | {name: own[name] for name in GEOMETRY})
        return
    crops = load_crop_network(weights)
    learned, classes = crops.network.state_dict(), list(crops.classes)
    for name, tensor in own.items():
        if name.split(".")[0] not in MAPS:
            continue
        source = learned[name]
        if ".table." in name:  # of a group that it does not know: the mean of all that it does
            rows = [classes.index(g) if g in classes else -1 for g in states]
            source = torch.stack([source[r] if r >= 0 else source.mean(dim=0) for r in rows])
        if source.shape != tensor.shape:
            raise WeightsError(f"'{weights}' has maps of other widths: {name}")
        tensor.copy_(source)


def export_states(
    config: StateTrainConfig,
    network: StateNetwork,
    progress: Progress,
    *,
    states: Mapping[str, Sequence[str]],
    found: Sequence[StateValidation],
) -> Path:
    """Write a run's weights, and beside them how they came to be.

    Args:
        config: of the run.
        network: the weights to export.
        progress: how far the run is.
        states: of every group.
        found: what validation said of these weights.
    """
    path = config.output / STATE_WEIGHTS
    save_state_network(network, path, states=states)
    record = {
        "states": {name: list(of) for name, of in states.items()},
        **record_of(
            config,
            path,
            steps=progress.step,
            batch=config.batch,
            seconds=progress.seconds,
        ),
        "validation": [dataclasses.asdict(one) for one in found],
    }
    write_text(path.with_suffix(".json"), json.dumps(record, indent=2) + "\n")
    return path
