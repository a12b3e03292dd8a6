"""What a training run of a mask branch is made of; written beside its weights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from asdfviz.errors import InputError


@dataclass(frozen=True, slots=True)
class MaskTrainConfig:
    """A training run of the mask branch beside one detector, which stays as it is."""

    assemblies: tuple[str, ...]
    """Names or paths of the assemblies, in the order in which the detector learned them."""
    detector: Path
    """Weights of the detector, a .safetensors file."""
    data: tuple[Path, ...]
    """Scene folders with truth and mask_visib/."""
    output: Path
    """Run folder: checkpoint, log, curve, masks.safetensors and .json."""
    validation: tuple[Path, ...] = ()
    """Scene folders that are never trained on."""
    start: Path | None = None
    """masks.safetensors of another run, also beside another detector, to begin with."""
    minutes: float = 30.0
    """Budget, wall clock, resumed runs counted together."""
    steps: int | None = None
    """Budget in steps instead."""
    width: int = 640
    """Of the input, pixels, a multiple of the last stride."""
    height: int = 384
    """Of the input, pixels, a multiple of the last stride."""
    batch: int = 4
    """Inputs a step."""
    positives: int = 300
    """Anchors a step that learn a mask, drawn from those that the assigner gives an object."""
    margin: float = 0.1
    """The loss looks at the true box grown by this share: predicted boxes are not exact."""
    dice_gain: float = 0.5
    """Weight of the dice loss beside the binary cross-entropy."""
    learning_rate: float = 3e-3
    """AdamW, until `hold` of the budget is used; then half a cosine."""
    hold: float = 0.3
    final_rate: float = 0.02
    """Share of the learning rate at the end."""
    weight_decay: float = 0.01
    warmup_steps: int = 40
    ema: float = 0.99
    """Decay of the averaged weights that are validated and exported."""
    clip: float = 10.0
    """Largest gradient norm."""
    threads: int = 1
    """CPU threads of torch."""
    seed: int = 0
    device: str = "cpu"
    bfloat16: bool = True
    """Mixed precision, where the device has it."""
    checkpoint_minutes: float = 3.0


def check_mask_config(config: MaskTrainConfig) -> None:
    """Refuse figures with which no training can start.

    Raises:
        InputError: with the field and what would be right.
    """
    if not config.assemblies:
        raise InputError("no assembly named: give those of the detector, in its order")
    if not config.data:
        raise InputError(
            "there is nothing to train on: name scene folders (data) with masks, as "
            "`asdfviz synth packs --masks` writes them"
        )
    if not (math.isfinite(config.minutes) and config.minutes > 0):
        raise InputError(f"minutes is {config.minutes:g}, give a budget above 0")
    for name, smallest in {"threads": 1, "batch": 1, "positives": 1}.items():
        if getattr(config, name) < smallest:
            raise InputError(f"{name} is {getattr(config, name)}, use {smallest} or more")
    for name in ("width", "height"):
        if getattr(config, name) < 64 or getattr(config, name) % 64:
            raise InputError(f"{name} is {getattr(config, name)}, use a multiple of 64")
