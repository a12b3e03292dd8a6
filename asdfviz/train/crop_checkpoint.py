"""Checkpoints of a crop training run, and the export of its weights."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor

from asdfviz.data.atomic import write_text
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.detector.crop_weights import load_crop_network, save_crop_network
from asdfviz.errors import WeightsError
from asdfviz.train.checkpoint import Average, Progress, load_checkpoint, write_checkpoint
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.crop_validation import CropValidation
from asdfviz.train.record import record_of
from asdfviz.train.whole_run import resume_whole, whole_run

CROP_WEIGHTS = "crops.safetensors"


def save_crop_checkpoint(
    path: Path,
    *,
    network: CropNetwork,
    average: Average,
    progress: Progress,
    optimizer: torch.optim.Optimizer,
    about: Mapping[str, object],
) -> None:
    """Write all that is needed to go on, in one step.

    Args:
        path: file to write.
        network: being trained.
        average: of its weights.
        progress: how far the run is.
        optimizer: with its state.
        about: "classes", "states" and "shape", which must be the same when the run goes on.
    """
    content = whole_run(
        network, average=average, progress=progress, optimizer=optimizer, about=json.dumps(about)
    )
    write_checkpoint(path, content)


def resume_crops(
    path: Path,
    *,
    network: CropNetwork,
    average: Average,
    optimizer: torch.optim.Optimizer,
    about: Mapping[str, object],
) -> Progress:
    """Bring network, average and optimiser to where a checkpoint was; returns how far that is.

    Raises:
        WeightsError: the checkpoint is corrupt, or of a run with other classes or sizes.
    """
    content = load_checkpoint(path)
    there: dict[str, Any] = json.loads(content["about"])
    if there != json.loads(json.dumps(about)):
        raise WeightsError(
            f"'{path}' was trained for {there.get('classes')} and {there.get('shape')}, asked for "
            f"were {about['classes']} and {about['shape']}: take another run folder"
        )
    return resume_whole(content, network, average=average, optimizer=optimizer)


@torch.no_grad()
def begin_crops_from(
    network: CropNetwork,
    checkpoint: Path,
    *,
    names: Sequence[str],
    states: Mapping[str, Sequence[str]],
) -> None:
    """Take over what another run learned; a class of the same name keeps its own tables.

    Args:
        network: to change.
        checkpoint: last.pt of the other run, or its crops.safetensors.
        names: classes of `network`.
        states: of its groups.

    Raises:
        WeightsError: the checkpoint is corrupt, or of another shape of network.
    """
    there, average = _learned(checkpoint)
    own = {name: network.shape[name] for name in ("classes", "states", "names")}
    shape = {**there.get("shape", {}), **own}
    if shape != json.loads(json.dumps(network.shape)):
        raise WeightsError(
            f"'{checkpoint}' has the shape {there.get('shape')}, not that of a crop network of "
            f"{network.shape}"
        )
    known = [str(name) for name in there["classes"]]
    for name, tensor in network.state_dict().items():
        if name.startswith("to_states."):
            if there.get("states") == json.loads(json.dumps(states)):
                tensor.copy_(average[name])
            continue  # those of other groups are others
        if name not in average or (name.startswith("name.to_names.") and known != list(names)):
            continue  # it was not taught this, or of other classes
        source = average[name]
        if source.shape == tensor.shape and not _is_by_class(name):
            tensor.copy_(source)
            continue
        rows = source.view(len(known), -1)
        own = tensor.view(len(names), -1)
        own.copy_(rows.mean(dim=0, keepdim=True).expand_as(own))
        for place, wanted in enumerate(names):
            if wanted in known:
                own[place] = rows[known.index(wanted)]


def _learned(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """What a run was about, and its averaged weights."""
    if path.suffix == ".safetensors":
        loaded = load_crop_network(path)
        about = {"classes": loaded.classes, "states": loaded.states, "shape": loaded.network.shape}
        return json.loads(json.dumps(about)), loaded.network.state_dict()
    content = load_checkpoint(path)
    return json.loads(content["about"]), cast(dict[str, Tensor], content["average"])


def _is_by_class(name: str) -> bool:
    return ".table." in name or name.startswith("own_layer.")


def export(
    config: CropTrainConfig,
    network: CropNetwork,
    progress: Progress,
    *,
    names: Sequence[str],
    states: Mapping[str, Sequence[str]],
    found: Sequence[CropValidation],
) -> Path:
    """Write a run's weights as half-precision safetensors, and beside them how they came to be.

    Args:
        config: of the run.
        network: the weights to export.
        progress: how far the run is.
        names: of the classes.
        states: of every group.
        found: what validation said of these weights.
    """
    path = config.output / CROP_WEIGHTS
    save_crop_network(network, path, classes=names, states=states)
    record = {
        "classes": list(names),
        "states": {name: list(of) for name, of in states.items()},
        **record_of(
            config,
            path,
            steps=progress.step,
            batch=config.batch,
            seconds=progress.seconds,
        ),
        "validation": [one.as_json() for one in found],
    }
    write_text(path.with_suffix(".json"), json.dumps(record, indent=2) + "\n")
    return path
