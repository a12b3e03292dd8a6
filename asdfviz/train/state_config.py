"""What a training run of the state network is made of; written into the run folder as it was."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from asdfviz.errors import InputError


@dataclass(frozen=True, slots=True)
class StateTrainConfig:
    """A training run of the state network."""

    assemblies: tuple[str, ...]
    """Names or paths of the assemblies that one network knows."""
    output: Path
    """Run folder: checkpoints, pool, log, curve."""
    validation: tuple[Path, ...] = ()
    """Scene folders with truth whose groups are never trained on."""
    scenes: tuple[Path, ...] = ()
    """Scene folders with truth whose groups are shown beside rendered crops."""
    scene_share: float = 0.5
    """Share of a batch that is cut out of them."""
    start: Path | None = None
    """crops.safetensors, whose maps the network begins with, or states.safetensors of a network for
    the same groups, with which it goes on."""
    minutes: float = 60.0
    """Budget, wall clock, resumed runs counted together."""
    steps: int | None = None
    """Budget in steps instead."""
    batch: int = 96
    """Crops a step."""
    learning_rate: float = 1.5e-3
    """AdamW, until `hold` of the budget is used; then half a cosine."""
    maps_rate: float = 0.4
    """Share of the learning rate that what begins with the crop network's weights has."""
    hold: float = 0.3
    final_rate: float = 0.02
    """Share of the learning rate at the end."""
    weight_decay: float = 0.03
    warmup_steps: int = 150
    ema: float = 0.996
    """Decay of the averaged weights that are validated and exported."""
    clip: float = 5.0
    """Largest gradient norm."""
    generators: int = 1
    """Processes that render fresh crops beside, on the CPU; with 0 a run on a GPU renders itself."""
    generator_niceness: int = 2
    """By which they stand back behind the training."""
    shard: int = 512
    """Crops a file of the pool."""
    pool: int = 40
    """Files of the pool; the oldest is thrown away for a fresh one."""
    first_shards: int = 2
    """Training begins once there are so many."""
    live_steps: int = 8
    """Where a run on a GPU renders itself: a fresh shard every so many steps."""
    validation_crops: int = 20
    """Fresh crops a state that are kept for validation."""
    threads: int = 1
    """CPU threads of torch; more than there are idle cores makes every step wait."""
    seed: int = 0
    device: str = "cpu"
    bfloat16: bool = True
    """Mixed precision, where the device has it."""
    validate_minutes: float = 5.0
    checkpoint_minutes: float = 3.0


def check_state_config(config: StateTrainConfig) -> None:
    """Refuse figures with which no training can start.

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
