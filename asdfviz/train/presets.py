"""Whole recipes by a name, and what share of one a run did."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from asdfviz.errors import InputError
from asdfviz.train.config import TrainConfig
from asdfviz.train.epochs import Epochs

IMAGES = 20_000
"""Pictures an assembly, training and validation together (the paper's)."""
EPOCHS = 300
"""Of the paper's training, which stopped early where nothing became better."""
PATIENCE = 50
"""Epochs; YOLOv8's default, the paper gives none."""
HELD_OUT = 5
"""One picture in so many is validated on: 80:20."""


def paper_preset(config: TrainConfig) -> TrainConfig:
    """Train as the paper says: its loss, 300 epochs with early stopping, 80:20.

    Network, input size, batch and the other augmentation stay the config's: on two cores the paper's
    (YOLOv8x-pose-p6 at 1280, batch 6) is out of reach.

    Args:
        config: of the run; data are the pictures, of which 20,000 an assembly are wanted.

    Raises:
        InputError: the config has its own validation folders or fresh pictures.
    """
    if config.validation or config.fresh:
        raise InputError(
            "the paper preset counts epochs of the pictures in data and validates on a fifth of "
            "them: leave validation and fresh out"
        )
    return dataclasses.replace(
        config,
        preset="paper",
        loss="paper",
        rotation_gain=0.0,  # an auxiliary loss of ours
        epochs=EPOCHS,
        patience=PATIENCE,
        held_out=HELD_OUT,
    )


@dataclass(frozen=True, slots=True)
class Ran:
    """How much of its preset a run did."""

    preset: str
    images: dict[str, int]
    """Of each assembly, training and validation together."""
    of_images: int
    """That the preset asks for of each."""
    epochs: float
    of_epochs: int
    ended: str
    """By what, in words."""

    def text(self) -> str:
        """One line for people."""
        counts = sorted(set(self.images.values()))
        ends = dict.fromkeys((counts[0], counts[-1])) if counts else {0: None}
        images = " to ".join(f"{count:,}" for count in ends)
        return (
            f"{self.preset} preset: {images} of {self.of_images:,} images an assembly, "
            f"{self.epochs:.1f} of {self.of_epochs} epochs, {self.ended}"
        )

    def as_json(self) -> str:
        """The content of ran.json."""
        return json.dumps({**dataclasses.asdict(self), "text": self.text()}, indent=2) + "\n"


def what_ran(
    config: TrainConfig, shown: Iterable[str], epochs: Epochs, *, finished: bool | None
) -> Ran | None:
    """Say how much of its preset a run did.

    Args:
        config: of the run.
        shown: of each picture, training and validation, whose assembly it shows.
        epochs: how far the run is.
        finished: whether it has used its budget; False where it was stopped, None while it runs.

    Returns:
        None for a run without preset.
    """
    if config.preset is None or epochs.limit is None:
        return None
    counts = Counter(shown)
    return Ran(
        preset=config.preset,
        images=dict(counts),
        of_images=IMAGES,
        epochs=round(min(epochs.done, epochs.limit), 2),
        of_epochs=epochs.limit,
        ended=_ended(config, epochs, finished),
    )


def _ended(config: TrainConfig, epochs: Epochs, finished: bool | None) -> str:
    if finished is None:
        return "so far"
    if not finished:
        return "interrupted"
    if epochs.is_stale:
        return f"stopped early, {config.patience} epochs without a better validation"
    if epochs.done >= (epochs.limit or 0):
        return "to the end"
    limit = f"{config.minutes:g} minutes" if config.steps is None else f"{config.steps} steps"
    return f"ended by the limit of {limit}"
