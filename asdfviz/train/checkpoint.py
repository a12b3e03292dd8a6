"""Checkpoints of a run, and the export of its weights."""

from __future__ import annotations

import io
import json
import pickle
import platform
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.datatypes import Assembly
from asdfviz.detector.joint import SEPARATOR, joint_classes
from asdfviz.detector.network import Network, Scale
from asdfviz.detector.weights import load_network, save_network
from asdfviz.errors import WeightsError
from asdfviz.train.config import TrainConfig
from asdfviz.train.record import made_by, without_places
from asdfviz.train.validation import SCORE


class Average:
    """Exponential moving average of a network's weights; early on it forgets faster."""

    def __init__(self, network: nn.Module, *, decay: float) -> None:
        self._decay = decay
        self.updates = 0
        self.state = {k: v.detach().clone() for k, v in network.state_dict().items()}

    @torch.no_grad()
    def update(self, network: nn.Module) -> None:
        """Take in the weights after a step."""
        self.updates += 1
        keep = min(self._decay, (1 + self.updates) / (10 + self.updates))
        mine: list[Tensor] = []
        theirs: list[Tensor] = []
        for name, value in network.state_dict().items():
            if value.is_floating_point():
                mine.append(self.state[name])
                theirs.append(value)
            else:
                self.state[name].copy_(value)
        # All at once: one after the other they are hundreds of small steps of a GPU.
        get_ema_multi_avg_fn(keep)(mine, theirs, self.updates)


@dataclass(slots=True, eq=False)
class Progress:
    """How far a run is."""

    step: int = 0
    seconds: float = 0.0
    best: float = -1.0
    """Best validation score so far."""


def save_checkpoint(
    path: Path,
    *,
    network: Network,
    average: Average,
    progress: Progress,
    about: Mapping[str, object],
    drawn: Mapping[str, object] | None = None,
    trainer: Mapping[str, Any] | None = None,
) -> None:
    """Write a checkpoint in one step.

    Args:
        path: file to write.
        network: being trained.
        average: of its weights.
        progress: how far the run is.
        about: what the weights are: "classes", "image_size", "run".
        drawn: which pictures were held out ("split") and how often the others were drawn ("epochs").
        trainer: state of optimiser, auxiliary head and warm-up, to go on exactly; None for weights
            alone.
    """
    content = {
        "network": network.state_dict(),
        "average": average.state,
        "updates": average.updates,
        "progress": [progress.step, progress.seconds, progress.best],
        "score": SCORE,
        "scale": network.scale,
        "keypoint_width": network.keypoint_width or 0,
        "about": json.dumps(about),
        "drawn": dict(drawn or {}),
        "trainer": dict(trainer or {}),
    }
    if trainer is None:
        content["network"] = {}
    write_checkpoint(path, content)


def write_checkpoint(path: Path, content: Mapping[str, object]) -> None:
    """Write a checkpoint's content in one step."""
    buffer = io.BytesIO()
    torch.save(dict(content), buffer)
    write_bytes(path, buffer.getvalue())


def keep_average(checkpoint: Path, path: Path) -> None:
    """Write a checkpoint's averaged weights and progress alone: a fraction of its size.

    A run goes on from it with the averaged weights and a fresh optimiser, warmed up again.
    """
    content = load_checkpoint(checkpoint)
    write_checkpoint(path, {**content, "network": {}, "trainer": {}})


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint; only tensors, numbers and strings are accepted.

    Raises:
        WeightsError: missing, cut short or not written by a training run.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise WeightsError(f"no checkpoint at '{path}'") from error
    except pickle.UnpicklingError as error:
        raise WeightsError(
            f"'{path}' is no checkpoint of a training run, and programs inside a file are never run: "
            "give the run's best.pt or last.pt"
        ) from error
    except (RuntimeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise WeightsError(f"checkpoint '{path}' is corrupt or cut short: {error}") from error
    if not isinstance(content, dict) or "average" not in content or "about" not in content:
        raise WeightsError(f"'{path}' is no checkpoint of a training run")
    return cast(dict[str, Any], content)


@torch.no_grad()
def begin_from(network: Network, checkpoint: Path, *, classes: Sequence[str]) -> int:
    """Take over what another run learned: layers of the same shape, class outputs by their names.

    A class "vise/jaw" takes the outputs of "vise/jaw" or, from a network of one assembly, of "jaw".

    Args:
        network: to change.
        checkpoint: best.pt or last.pt of the other run, or its weights.safetensors; of the same
            size of network.
        classes: what `network` puts out.

    Returns:
        How many tensors were taken over whole.

    Raises:
        WeightsError: the checkpoint is missing, corrupt or of another size.
    """
    scale, known, given = _learned(checkpoint)
    if scale != network.scale:
        raise WeightsError(f"'{checkpoint}' is of size {scale}, asked for was {network.scale}")
    rows = [
        (place, known.index(name))
        for place, full in enumerate(classes)
        for name in dict.fromkeys((full, full.split(SEPARATOR)[-1]))
        if name in known
    ]
    taken = 0
    for name, tensor in network.state_dict().items():
        source = given.get(name)
        if source is None:
            continue
        is_class = ".cv3." in name and name.split(".")[-2] == "2"
        if source.shape == tensor.shape and not is_class:
            tensor.copy_(source)
            taken += 1
        elif is_class and source.shape[1:] == tensor.shape[1:] and rows:
            to, origin = zip(*rows, strict=True)
            tensor[list(to)] = source[list(origin)].to(tensor.device)
    return taken


def _learned(path: Path) -> tuple[str, list[str], dict[str, Tensor]]:
    """Size of network, classes and averaged weights of another run."""
    if path.suffix == ".safetensors":
        loaded = load_network(path)
        return loaded.scale, list(loaded.classes), loaded.network.state_dict()
    content = load_checkpoint(path)
    known = [str(name) for name in json.loads(content["about"])["classes"]]
    return content["scale"], known, cast(dict[str, Tensor], content["average"])


def require_same(
    content: Mapping[str, Any],
    path: Path,
    *,
    network: Network,
    classes: Sequence[str],
    image_size: int,
    split: Sequence[int],
) -> None:
    """Refuse to go on from the checkpoint of another network, or with other inputs.

    Raises:
        WeightsError: its classes, size, keypoint width, image size or held-out pictures differ.
    """
    about = json.loads(content["about"])
    known = about["classes"]
    if known != list(classes):
        raise WeightsError(
            f"'{path}' was trained for {known}, asked for are {list(classes)}: "
            "take another run folder"
        )
    had = (content["scale"], content["keypoint_width"], about["image_size"])
    asked = (network.scale, network.keypoint_width or 0, image_size)
    if had != asked:
        sizes = f"of scale, keypoint_width and image_size {had}, asked for were {asked}"
        raise WeightsError(f"'{path}' is {sizes}: take another run folder")
    held = content.get("drawn", {}).get("split", [0, 0])  # older ones lack it
    if held != list(split):
        raise WeightsError(
            f"'{path}' may have learnt pictures that are to be held out (one in {split[0]} with seed "
            f"{split[1]}; there: {held[0]} and {held[1]}): keep preset and seed, or take another run "
            "folder"
        )


def network_of(content: Mapping[str, Any]) -> Network:
    """Build the network of a checkpoint with its averaged weights, in evaluation mode."""
    about = json.loads(content["about"])
    network = Network(
        cast(Scale, content["scale"]),
        classes=len(about["classes"]),
        keypoint_width=content["keypoint_width"] or None,
    )
    network.load_state_dict(cast(dict[str, Tensor], content["average"]))
    network.eval()
    return network


def averaged(network: Network, average: Average) -> Network:
    """Another network of the same size with the averaged weights, in evaluation mode, on the CPU."""
    other = Network(network.scale, classes=network.classes, keypoint_width=network.keypoint_width)
    other.load_state_dict(average.state)
    return other.eval()


def export_weights(checkpoint: Path, path: Path) -> Path:
    """Write a checkpoint's averaged weights as half-precision safetensors, and how they came to be.

    Args:
        checkpoint: best.pt or last.pt of a run folder.
        path: the .safetensors to write; a .json of the same name comes to lie beside it.

    Raises:
        WeightsError: the checkpoint is missing or corrupt.
    """
    content = load_checkpoint(checkpoint)
    about = json.loads(content["about"])
    save_network(
        network_of(content), path, classes=about["classes"], image_size=about["image_size"]
    )
    step, seconds, best = content["progress"]
    record = {
        **about,
        "scale": content["scale"],
        "keypoint_width": content["keypoint_width"],
        "steps": step,
        "minutes": round(seconds / 60, 1),
        "best_score": best,
        "score": content.get("score", "mean over parts of recall times keypoint accuracy"),
        "bytes": path.stat().st_size,
    }
    for name in ("validation", "ran"):
        report = checkpoint.with_name(f"{name}.json")
        if report.is_file():
            record[name] = json.loads(report.read_text(encoding="utf-8"))
    write_text(path.with_suffix(".json"), json.dumps(record, indent=2) + "\n")
    return path


def about_run(config: TrainConfig, assemblies: Sequence[Assembly]) -> dict[str, object]:
    """What exported weights should say of themselves."""
    return {
        "assemblies": [assembly.name for assembly in assemblies],
        "classes": list(joint_classes(assemblies)),
        "image_size": config.image_size,
        "command": made_by(),
        "machine": f"{platform.machine()}, {platform.processor() or platform.system()}",
        "torch": torch.__version__,
        "config": without_places(asdict(config)),
    }
