"""What training runs on crops are made of; written into the run folder as they were."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from asdfviz.detector.crop_network import GRID
from asdfviz.errors import InputError


@dataclass(frozen=True, slots=True)
class CropRunConfig:
    """What every training on crops is told."""

    assemblies: tuple[str, ...]
    """Names or paths of the assemblies that one network knows."""
    output: Path
    """Run folder: checkpoints, pool, log, curve."""
    minutes: float = 60.0
    """Budget, wall clock, resumed runs counted together."""
    steps: int | None = None
    """Budget in steps instead."""
    scene_share: float = 0.4
    """Share of a batch that is cut out of scenes, where there are any."""
    batch: int = 128
    """Crops a step."""
    learning_rate: float = 1.5e-3
    """AdamW, until `hold` of the budget is used; then half a cosine."""
    final_rate: float = 0.02
    """Share of the learning rate at the end."""
    clip: float = 5.0
    """Largest gradient norm."""
    generators: int = 1
    """Processes that render fresh crops beside, on the CPU; with 0 a run on a GPU renders itself."""
    generator_niceness: int = 2
    """By which they stand back behind the training."""
    shard: int = 1024
    """Crops a file of the pool."""
    pool: int = 40
    """Files of the pool; the oldest is thrown away for a fresh one."""
    first_shards: int = 2
    """Training begins once there are so many."""
    live_steps: int = 8
    """Where a run on a GPU renders itself: a fresh shard every so many steps."""
    threads: int = 1
    """CPU threads of torch; more than there are idle cores makes every step wait."""
    seed: int = 0
    device: str = "cpu"
    bfloat16: bool = True
    """Mixed precision, where the device has it."""
    validate_minutes: float = 6.0
    checkpoint_minutes: float = 3.0


@dataclass(frozen=True, slots=True)
class CropTrainConfig(CropRunConfig):
    """A training run of the crop network."""

    validation: tuple[Path, ...] = ()
    """Scene folders with truth whose parts are never trained on; their sequence.json names the
    assembly."""
    scenes: tuple[Path, ...] = ()
    """Scene folders with truth whose parts and groups are shown beside rendered crops; their
    sequence.json names the assembly."""
    empty_share: float = 0.15
    """How often one of these shows a place about a base part in which the part is still missing."""
    start: Path | None = None
    """Checkpoint or crops.safetensors of another run to begin with: what is shared by all classes is
    taken over, and new classes begin at the mean of the old ones."""
    teach: Literal["all", "names", "poses"] = "all"
    """What is taught: everything, which part a crop shows alone, or all but that; the rest stays as
    `start` had it."""
    hold: float = 0.5
    weight_decay: float = 0.05
    warmup_steps: int = 200
    ema: float = 0.998
    """Decay of the averaged weights that are validated and exported."""
    outline_gain: float = 1.0
    place_gain: float = 1.0
    state_gain: float = 1.0
    name_gain: float = 1.0
    grid: int = GRID
    """Rotations."""
    validation_crops: int = 40
    """Fresh crops a class that are kept for validation."""


def check_run(config: CropRunConfig) -> None:
    """Refuse figures with which no training on crops can start.

    Raises:
        InputError: with the field and what would be right.
    """
    if not config.assemblies:
        raise InputError("no assembly named: give one or more")
    if not (math.isfinite(config.minutes) and config.minutes > 0):
        raise InputError(f"minutes is {config.minutes:g}, give a budget above 0")
    if not 0 < config.learning_rate < 1:
        raise InputError(
            f"learning_rate is {config.learning_rate:g}, give one above 0 and below 1; 0.0015 is usual"
        )
    if not 0 <= config.scene_share < 1:
        raise InputError(f"scene_share is {config.scene_share:g}, give one from 0 to below 1")
    least = {"threads": 1, "batch": 2, "generators": 0, "shard": 16, "pool": 1}
    for name, smallest in least.items():
        if getattr(config, name) < smallest:
            raise InputError(f"{name} is {getattr(config, name)}, use {smallest} or more")


def check_crop_config(config: CropTrainConfig) -> None:
    """Refuse figures with which no training of the crop network can start.

    Raises:
        InputError: with the field and what would be right.
    """
    check_run(config)
    if config.teach != "all" and config.start is None:
        raise InputError(
            f"to teach {config.teach} alone, name the weights to begin with (start): last.pt or "
            "crops.safetensors of a run that was taught everything"
        )
    if not 0 <= config.empty_share < 1:
        raise InputError(f"empty_share is {config.empty_share:g}, give one from 0 to below 1")
    if config.grid < 60:
        raise InputError(f"grid is {config.grid}, use 60 or more")
