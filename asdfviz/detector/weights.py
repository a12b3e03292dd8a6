"""Reads and writes network weights: our own as safetensors in half precision, users' own as .pt.

A .pt is read as tensors only (never unpickled), so it must hold a plain state dict.
"""

from __future__ import annotations

import json
import pickle
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import torch
from torch import Tensor

from asdfviz.detector.network import Network, Scale
from asdfviz.detector.tensor_files import (
    are_finite,
    half_tensors,
    read_metadata,
    read_tensors,
    single_tensors,
    write_tensors,
)
from asdfviz.errors import WeightsError

FORMAT = "asdfviz-detector-1"
_OTHERWISE = "it was not written by this program's training"
SCALES: tuple[Scale, ...] = ("n", "s", "m", "l", "x", "x-p6")


@dataclass(frozen=True, slots=True, eq=False)
class LoadedNetwork:
    """A network with its weights, in evaluation mode, and what its outputs mean."""

    network: Network
    classes: tuple[str, ...]
    """Names in the order of the outputs."""
    scale: Scale
    keypoint_width: int | None
    """None = the public width."""
    image_size: int
    """Longer side of the pictures that it was trained on, pixels."""


def save_network(
    network: Network,
    path: Path,
    *,
    classes: Sequence[str],
    image_size: int,
    extra: Mapping[str, str] | None = None,
) -> None:
    """Write weights in half precision with all that is needed to rebuild the network.

    Args:
        network: with batch norms, not fused.
        path: a .safetensors file; replaced at once or not at all.
        classes: names in the order of the outputs.
        image_size: longer side of the training pictures, pixels.
        extra: more metadata.
    """
    tensors = half_tensors(network)
    metadata = {
        **(extra or {}),
        "format": FORMAT,
        "scale": network.scale,
        "classes": json.dumps(list(classes)),
        "keypoints": str(network.keypoints),
        "keypoint_width": str(network.keypoint_width or 0),
        "image_size": str(image_size),
    }
    write_tensors(path, tensors, metadata)


def load_network(path: Path, *, classes: Sequence[str] | None = None) -> LoadedNetwork:
    """Read weights and rebuild their network in evaluation mode, batch norms not yet folded.

    Args:
        path: .safetensors written by `save_network`, or a .pt or .pth state dict in the public
            layout.
        classes: names for a .pt, which holds none; for our own files they must agree.

    Raises:
        WeightsError: no such file, a corrupt one, or weights of another network.
    """
    if not path.is_file():
        raise WeightsError(f"no network weights at '{path}': train or export some first")
    loaded = _load_own(path) if path.suffix == ".safetensors" else _load_public(path)
    if classes is None:
        return loaded
    if path.suffix == ".safetensors" and tuple(classes) != loaded.classes:
        raise WeightsError(
            f"'{path}' was trained for the classes {list(loaded.classes)}, "
            f"asked for were {list(classes)}: use the weights of this assembly"
        )
    if len(classes) != len(loaded.classes):
        raise WeightsError(
            f"'{path}' has {len(loaded.classes)} classes, asked for were {len(classes)}"
        )
    return LoadedNetwork(
        network=loaded.network,
        classes=tuple(classes),
        scale=loaded.scale,
        keypoint_width=loaded.keypoint_width,
        image_size=loaded.image_size,
    )


def assemblies_known(path: Path) -> frozenset[str]:
    """The assemblies whose classes a file of ours tells apart; empty where it knows but one.

    A network of several assemblies has "assembly/class" for every class.

    Raises:
        WeightsError: no file of ours.
    """
    metadata = read_metadata(path, format=FORMAT, otherwise=_OTHERWISE)
    try:
        names = (str(name) for name in json.loads(metadata["classes"]))
        return frozenset(name.split("/")[0] for name in names if "/" in name)
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"'{path}' has broken metadata: {error!r}") from error


def _load_own(path: Path) -> LoadedNetwork:
    tensors, metadata = read_tensors(path, format=FORMAT, otherwise=_OTHERWISE)
    try:
        classes = tuple(str(name) for name in json.loads(metadata["classes"]))
        scale = _known_scale(metadata["scale"], path)
        width = int(metadata["keypoint_width"]) or None
        keypoints, image_size = int(metadata["keypoints"]), int(metadata["image_size"])
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"'{path}' has broken metadata: {error!r}") from error
    network = Network(scale, classes=len(classes), keypoints=keypoints, keypoint_width=width)
    _fill(network, tensors, path)
    return LoadedNetwork(network, classes, scale, width, image_size)


def _load_public(path: Path) -> LoadedNetwork:
    tensors = _state_dict(path)
    try:
        last = max(int(name.split(".")[1]) for name in tensors)
        prefix = f"model.{last}"
        classes = tensors[f"{prefix}.cv3.0.2.weight"].shape[0]
        outputs = tensors[f"{prefix}.cv4.0.2.weight"].shape[0]
        width = tensors[f"{prefix}.cv4.0.0.conv.weight"].shape[0]
        scale = _guess_scale(tensors, last)
    except (KeyError, IndexError, ValueError) as error:
        raise WeightsError(
            f"'{path}' does not have the layers of a YOLOv8-pose network (missing {error}): "
            "expected names such as model.0.conv.weight and model.22.cv4.0.2.weight"
        ) from error
    network = Network(scale, classes=classes, keypoints=outputs // 3, keypoint_width=width)
    _fill(network, tensors, path)
    names = tuple(str(index) for index in range(classes))
    return LoadedNetwork(network, names, scale, width, 640)


def _state_dict(path: Path) -> dict[str, Tensor]:
    try:
        content: object = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise WeightsError(
            f"'{path}' is not a plain state dict, and programs inside a file are never run. Save "
            "the tensors alone: torch.save(model.state_dict(), path)"
        ) from error
    except (RuntimeError, OSError, EOFError, zipfile.BadZipFile, ValueError, KeyError) as error:
        raise WeightsError(f"'{path}' is corrupt or cut short: {error}") from error
    for key in ("state_dict", "model"):
        if isinstance(content, dict):
            content = cast(dict[object, object], content).get(key, cast(object, content))
    entries = cast(dict[object, object], content) if isinstance(content, dict) else {}
    if {"average", "about"} <= entries.keys():
        raise WeightsError(
            f"'{path}' is a checkpoint, for training to go on from: give the .safetensors that the "
            "run leaves beside it once it ends or is stopped"
        )
    tensors = {k: v for k, v in entries.items() if isinstance(k, str) and isinstance(v, Tensor)}
    if not tensors or len(tensors) < len(entries):
        raise WeightsError(f"'{path}' does not hold a state dict (names and tensors)")
    if all(name.startswith("model.model.") for name in tensors):
        tensors = {name.removeprefix("model."): value for name, value in tensors.items()}
    if not all(name.startswith("model.") for name in tensors):
        raise WeightsError(f"'{path}': a YOLOv8-pose state dict's names start with 'model.'")
    return tensors


def _guess_scale(tensors: Mapping[str, Tensor], last: int) -> Scale:
    """Tell the size from the first layer's channels and the number of levels."""
    if last == 30:
        return "x-p6"
    first = tensors["model.0.conv.weight"].shape[0]
    by_channels: dict[int, Scale] = {16: "n", 32: "s", 48: "m", 64: "l", 80: "x"}
    if first not in by_channels:
        raise ValueError(f"no size with {first} channels in the first layer")
    return by_channels[first]


def _known_scale(name: str, path: Path) -> Scale:
    for scale in SCALES:
        if scale == name:
            return scale
    raise WeightsError(f"'{path}' has the size '{name}'; known are {', '.join(SCALES)}")


def _fill(network: Network, tensors: Mapping[str, Tensor], path: Path) -> None:
    own = network.state_dict()
    missing = sorted(own.keys() - tensors.keys())
    unknown = sorted(tensors.keys() - own.keys())
    wrong = sorted(k for k in own.keys() & tensors.keys() if own[k].shape != tensors[k].shape)
    if missing or unknown or wrong:
        raise WeightsError(
            f"'{path}' does not fit a YOLOv8{network.scale}-pose with {network.keypoints} "
            f"keypoints: missing {missing[:3]}, unknown {unknown[:3]}, wrong shape {wrong[:3]}"
        )
    if not are_finite(tensors):
        raise WeightsError(f"'{path}' holds numbers that are not finite: the training diverged")
    network.load_state_dict(single_tensors(tensors))
    network.eval()
