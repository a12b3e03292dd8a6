"""What a training run is made of; written into the run folder as it was."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from asdfviz.detector.losses import PAPER, PUBLISHED, LossConfig
from asdfviz.detector.network import Scale, strides_of
from asdfviz.errors import InputError
from asdfviz.train.packing import AugmentConfig

LOSSES: dict[str, LossConfig] = {"mix": LossConfig(), "oks": PUBLISHED, "paper": PAPER}


@dataclass(frozen=True, slots=True)
class Stage:
    """A stretch of the run with inputs of one size."""

    share: float
    """Share of the budget."""
    width: int
    """Of the input, pixels, a multiple of the last stride."""
    height: int
    """Of the input, pixels, a multiple of the last stride."""
    batch: int
    """Inputs a step."""
    packed: float
    """Share of inputs packed with tiles; the others show a whole frame, 0 to 1."""


def two_stages(image_size: int, *, stride: int) -> tuple[Stage, ...]:
    """Small packed inputs first, for the most objects a second, then full size with frames.

    Args:
        image_size: longer side of a whole frame, pixels.
        stride: the network's last one; sides are rounded up to it.
    """
    (half_width, half_height), (width, height) = (
        tuple(math.ceil(side / stride) * stride for side in (longer, longer * 9 / 16))
        for longer in (image_size / 2, image_size)
    )
    return (Stage(0.3, half_width, half_height, 16, 1.0), Stage(0.7, width, height, 8, 0.6))


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """A training run of the detector."""

    assemblies: tuple[str, ...]
    """Names or paths of the assemblies; several share one network."""
    data: tuple[Path, ...]
    """Scene folders with truth; with several assemblies, each folder's sequence.json says whose."""
    output: Path
    """Run folder: checkpoints, log, curve, weights."""
    fresh: int = 0
    """Pictures rendered while training: the latest so many are drawn from beside `data`, which may
    then be empty. 0 for none. Such a run does not repeat exactly. A GPU keeps them in its memory to cut
    inputs out of, 0.7 MB each at 640x360."""
    fresh_draws: int = 40
    """Inputs for each of them that is rendered; a faster training waits."""
    fresh_scenes: float = 0.5
    """Share of scenes among them; the others are packs, half of them with joined groups mostly."""
    fresh_device: str = "cpu"
    """Where torch renders them. Thirteen processes that all rendered on one H100 made 4.5 pictures a
    second together and kept the training waiting; six made 10.8, and seven on CPU cores 6."""
    loaders: int = 1
    """Threads that make batches; with `fresh`, processes that render and make batches. A GPU wants
    nearly as many as there are cores."""
    validation: tuple[Path, ...] = ()
    """Scene folders that are never trained on."""
    start: Path | None = None
    """Checkpoint of another run, or its weights.safetensors, to begin with: layers of the same
    shape are taken over, outputs of classes by their names."""
    scale: Scale = "n"
    """Size of the network."""
    keypoint_width: int = 128
    """Hidden channels of the keypoint branch; 0 means the public width (51 in size n)."""
    minutes: float = 60.0
    """Budget, wall clock, resumed runs counted together."""
    steps: int | None = None
    """Budget in steps instead, which repeats exactly."""
    preset: str | None = None
    """Name of the recipe that was asked for, of `asdfviz.train.presets`; what of it ran is told."""
    epochs: int | None = None
    """The run also ends after so many passes over the pictures of `data`: so many inputs as they are
    pictures each. It is then validated after each of them."""
    patience: int = 50
    """With `epochs`: epochs without a better validation after which the run stops early."""
    held_out: int = 0
    """Of so many pictures of `data` in a row, by number, one is validated on instead, which one the
    seed decides. 0 for none."""
    image_size: int = 640
    """Longer side of a whole frame, pixels; infer at the same."""
    stages: tuple[Stage, ...] = ()
    """None given: the `two_stages` that end at image_size."""
    threads: int = 1
    """CPU threads of torch; more than there are idle cores makes every step wait."""
    seed: int = 0
    device: str = "cpu"
    """A torch device."""
    bfloat16: bool = True
    """Mixed precision, where the device has it."""
    learning_rate: float = 1.5e-3
    """AdamW, at the top of the schedule."""
    hold: float = 0.0
    """Share of the budget over which the rate stays at the top before the cosine begins."""
    final_rate: float = 0.03
    """Share of the learning rate that the cosine ends at."""
    weight_decay: float = 0.01
    """Of convolution weights only."""
    warmup_steps: int = 150
    ema: float = 0.998
    """Decay of the averaged weights that are validated and exported."""
    clip: float = 10.0
    """Largest gradient norm (YOLOv8's)."""
    loss: Literal["mix", "oks", "paper"] = "mix"
    """Keypoint loss: our mix, YOLOv8's, or the paper's L2."""
    keypoint_gain: float = 1.0
    """Factor on the keypoint loss and the rotation hint. At 1 they are 90 % of the whole and rule
    what the shared layers learn; 0.12 lets boxes and classes of many parts come first, which is
    what poses from crops need."""
    rotation_gain: float = 1.0
    """Weight of the rotation hint, an auxiliary loss, beside the keypoints'; 0 switches it off."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    closing: float = 0.1
    """Share of the budget at whose end inputs are whole frames alone, as YOLOv8 closes its mosaic: what
    is inferred on looks like them. 0 keeps tiles to the end. A run that stops early has no such end."""
    calm_share: float = 0.1
    """Share of the budget over which the camera roll grows from 30 % to its full range."""
    validate_minutes: float = 8.0
    """Time between validations."""
    checkpoint_minutes: float = 3.0
    """Time between checkpoints."""
    validation_frames: int = 60
    """Frames of each intermediate validation; the last one takes all."""
    resume: bool = True
    """Go on from output/last.pt if it is there."""

    def __post_init__(self) -> None:
        if not self.stages:
            stages = two_stages(self.image_size, stride=self.stride)
            object.__setattr__(self, "stages", stages)

    @property
    def stride(self) -> int:
        """The last stride of a network of this size, pixels."""
        return strides_of(self.scale)[-1]

    @property
    def split(self) -> list[int]:
        """What decides which pictures are held out: `held_out` and the seed, 0 and 0 where none is."""
        return [self.held_out, self.seed] if self.held_out else [0, 0]

    @property
    def losses(self) -> LossConfig:
        """The losses of boxes, classes and keypoints."""
        chosen = LOSSES[self.loss]
        return replace(chosen, keypoint_gain=self.keypoint_gain * chosen.keypoint_gain)


def check_config(config: TrainConfig) -> None:
    """Refuse figures with which no training can start.

    Raises:
        InputError: with the field and what would be right.
    """
    if not (math.isfinite(config.minutes) and config.minutes > 0):
        raise InputError(f"minutes is {config.minutes:g}, give a budget above 0")
    if not (math.isfinite(config.keypoint_gain) and config.keypoint_gain >= 0):
        raise InputError(f"keypoint_gain is {config.keypoint_gain:g}, give 0 or more")
    for name in ("fresh_scenes", "closing"):
        if not 0 <= getattr(config, name) <= 1:
            raise InputError(f"{name} is {getattr(config, name):g}, give a share from 0 to 1")
    least = {"threads": 1, "image_size": 32, "keypoint_width": 0, "loaders": 1}
    least |= {"fresh": 0, "fresh_draws": 1}
    for name, smallest in least.items():
        if getattr(config, name) < smallest:
            raise InputError(f"{name} is {getattr(config, name)}, use {smallest} or more")
    widest = max(stage.width for stage in config.stages)
    if widest >= config.image_size + config.stride:
        raise InputError(
            f"a stage is {widest} pixels wide, image_size is {config.image_size}: the widest stage "
            "is what is inferred at"
        )
    _check_epochs(config)
    if not (config.data or config.fresh):
        raise InputError("there is nothing to train on: name scene folders (data) or ask for fresh")


def _check_epochs(config: TrainConfig) -> None:
    if config.fresh and (config.epochs is not None or config.held_out):
        raise InputError("pictures that are rendered meanwhile have no epochs: leave fresh out")
    if config.epochs is not None and min(config.epochs, config.patience) < 1:
        figures = f"epochs is {config.epochs}, patience {config.patience}"
        raise InputError(f"{figures}, give 1 or more of each")
    if config.held_out not in (0, *range(2, 101)):
        raise InputError(f"held_out is {config.held_out}, give 0 or one in 2 to 100")
    if config.held_out and config.validation:
        raise InputError("pictures are held out to validate on: leave validation out")
