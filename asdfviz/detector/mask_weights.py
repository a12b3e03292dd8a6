"""Reads and writes mask branches: half-precision safetensors, bound to the detector they grew on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from asdfviz.data.hashes import file_sha256
from asdfviz.detector.mask_branch import MaskBranch
from asdfviz.detector.tensor_files import (
    are_finite,
    fitting,
    half_tensors,
    read_tensors,
    single_tensors,
    write_tensors,
)
from asdfviz.errors import WeightsError

FORMAT = "asdfviz-masks-1"


@dataclass(frozen=True, slots=True, eq=False)
class LoadedMasks:
    """A mask branch in evaluation mode and the detector classes that it was trained on."""

    branch: MaskBranch
    classes: tuple[str, ...]
    """Of parts alone, named as the detector's classes are."""


def save_masks(branch: MaskBranch, path: Path, *, classes: Sequence[str], detector: Path) -> None:
    """Write a branch with all that is needed to rebuild it; replaced at once or not at all.

    Args:
        branch: with batch norms, not fused.
        path: file to write.
        classes: of the parts that it was trained on.
        detector: weights whose features it reads.
    """
    tensors = half_tensors(branch)
    metadata = {
        "format": FORMAT,
        "classes": json.dumps(list(classes)),
        "channels": json.dumps(branch.channels),
        "width": str(branch.width),
        "detector": file_sha256(detector),
    }
    write_tensors(path, tensors, metadata)


def load_masks(path: Path, *, detector: Path) -> LoadedMasks:
    """Read what `save_masks` wrote.

    Args:
        path: the file.
        detector: weights that are to run with it.

    Raises:
        WeightsError: no such file, a corrupt one, or one that belongs to other detector weights.
    """
    if not path.is_file():
        raise WeightsError(
            f"no mask weights at '{path}': train them with `asdfviz train-masks --weights "
            f"{detector}`, or choose a method without segmentation"
        )
    loaded, grown_on = read_branch(path)
    if grown_on != file_sha256(detector):
        raise WeightsError(
            f"'{path}' was trained on the features of other weights than '{detector}': a mask "
            "branch fits its own detector alone; train one with `asdfviz train-masks`"
        )
    return loaded


def read_branch(path: Path) -> tuple[LoadedMasks, str | None]:
    """Read a mask branch whatever its detector, and the SHA-256 of that.

    Raises:
        WeightsError: a corrupt file, or one that is missing.
    """
    tensors, metadata = read_tensors(
        path, format=FORMAT, otherwise="it does not hold a mask branch"
    )
    with fitting(path, "a mask branch"):
        classes = tuple(str(name) for name in json.loads(metadata["classes"]))
        channels = tuple(int(c) for c in json.loads(metadata["channels"]))
        branch = MaskBranch(channels, width=int(metadata["width"]))
        branch.load_state_dict(single_tensors(tensors))
    if not are_finite(tensors):
        raise WeightsError(f"'{path}' holds numbers that are not finite: the training diverged")
    branch.eval()
    return LoadedMasks(branch, classes), metadata.get("detector")
