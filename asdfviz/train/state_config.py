"""What a training run of the state network is made of; written into the run folder as it was."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asdfviz.train.crop_config import CropRunConfig


@dataclass(frozen=True, slots=True)
class StateTrainConfig(CropRunConfig):
    """A training run of the state network."""

    validation: tuple[Path, ...] = ()
    """Scene folders with truth whose groups are never trained on."""
    scenes: tuple[Path, ...] = ()
    """Scene folders with truth whose groups are shown beside rendered crops."""
    scene_share: float = 0.5
    start: Path | None = None
    """crops.safetensors, whose maps the network begins with, or states.safetensors of a network for
    the same groups, with which it goes on."""
    batch: int = 96
    smoothing: float = 0.05
    """Share of the target that all states of a group have alike: between two states nobody can be sure."""
    maps_rate: float = 0.4
    """Share of the learning rate that what begins with the crop network's weights has."""
    hold: float = 0.3
    weight_decay: float = 0.03
    warmup_steps: int = 150
    ema: float = 0.996
    """Decay of the averaged weights that are validated and exported."""
    shard: int = 512
    validation_crops: int = 20
    """Fresh crops a state that are kept for validation."""
    validate_minutes: float = 5.0
