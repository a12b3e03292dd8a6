"""Checkpoints of a mask branch's training run, and the export of its weights."""

from __future__ import annotations

import dataclasses
import json
import platform
from collections.abc import Sequence
from pathlib import Path

import torch

from asdfviz.data.atomic import write_text
from asdfviz.data.hashes import file_sha256
from asdfviz.detector.mask_branch import MaskBranch
from asdfviz.detector.mask_weights import save_masks
from asdfviz.errors import WeightsError
from asdfviz.train.checkpoint import Average, Progress, load_checkpoint, write_checkpoint
from asdfviz.train.mask_config import MaskTrainConfig
from asdfviz.train.mask_validation import MaskValidation
from asdfviz.train.record import made_by, without_places
from asdfviz.train.whole_run import resume_whole, whole_run

MASK_WEIGHTS = "masks.safetensors"


def save_mask_checkpoint(
    path: Path,
    *,
    branch: MaskBranch,
    average: Average,
    progress: Progress,
    optimizer: torch.optim.Optimizer,
    detector: Path,
) -> None:
    """Write all that is needed to go on, in one step.

    Args:
        path: file to write.
        branch: being trained.
        average: of its weights.
        progress: how far the run is.
        optimizer: with its state.
        detector: weights whose features the branch reads.
    """
    content = whole_run(
        branch, average=average, progress=progress, optimizer=optimizer, about=file_sha256(detector)
    )
    write_checkpoint(path, content)


def resume_masks(
    path: Path,
    *,
    branch: MaskBranch,
    average: Average,
    optimizer: torch.optim.Optimizer,
    detector: Path,
) -> Progress:
    """Bring branch, average and optimiser to where a checkpoint was; returns how far that is.

    Raises:
        WeightsError: the checkpoint is corrupt, or of a branch beside other detector weights.
    """
    content = load_checkpoint(path)
    if content["about"] != file_sha256(detector):
        raise WeightsError(
            f"'{path}' was trained beside other weights than '{detector}': take another run folder"
        )
    return resume_whole(content, branch, average=average, optimizer=optimizer)


def export_masks(
    config: MaskTrainConfig,
    branch: MaskBranch,
    progress: Progress,
    *,
    classes: Sequence[str],
    found: MaskValidation | None,
) -> Path:
    """Write a run's weights as half-precision safetensors, and beside them how they came to be.

    Args:
        config: of the run.
        branch: the weights to export.
        progress: how far the run is.
        classes: of the parts that have masks.
        found: what validation said of these weights.
    """
    path = config.output / MASK_WEIGHTS
    save_masks(branch, path, classes=classes, detector=config.detector)
    record = {
        "classes": list(classes),
        "command": made_by(),
        "machine": f"{platform.machine()}, {platform.processor() or platform.system()}",
        "torch": torch.__version__,
        "steps": progress.step,
        "inputs": progress.step * config.batch,
        "minutes": round(progress.seconds / 60, 1),
        "bytes": path.stat().st_size,
        "detector_sha256": file_sha256(config.detector),
        "config": without_places(dataclasses.asdict(config)),
        "validation": None if found is None else found.as_json(),
    }
    write_text(path.with_suffix(".json"), json.dumps(record, indent=2) + "\n")
    return path
