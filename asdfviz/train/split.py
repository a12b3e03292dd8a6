"""Which of the stored pictures a run trains on, and which it validates on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.train.config import TrainConfig
from asdfviz.train.dataset import LabelledImage, load_images


def stored_pictures(
    config: TrainConfig, assemblies: Sequence[Assembly]
) -> tuple[tuple[LabelledImage, ...], tuple[LabelledImage, ...]]:
    """Read the pictures of a run.

    Args:
        config: of the run.
        assemblies: in the order of the network's outputs.

    Returns:
        Pictures to train on, none where the processes that render read them; and to validate on.

    Raises:
        InputError: too few to hold any out.
        SequenceError: a folder is broken, or shows no part.
    """

    def read(folders: Sequence[Path]) -> tuple[LabelledImage, ...]:
        return load_images(folders, assemblies, image_size=config.image_size) if folders else ()

    if config.held_out:
        return hold_out(read(config.data), every=config.held_out, seed=config.seed)
    return () if config.fresh else read(config.data), read(config.validation)


def hold_out(
    images: Sequence[LabelledImage], *, every: int, seed: int
) -> tuple[tuple[LabelledImage, ...], tuple[LabelledImage, ...]]:
    """Split pictures by their numbers: of each `every` numbers in a row, chance holds one out.

    A folder that grows, as `asdfviz synth images` makes it go on, keeps its split.

    Args:
        images: all of the run's folders.
        every: 5 for 80:20.
        seed: of the run; the same one holds out the same pictures.

    Returns:
        Pictures to train on, pictures to validate on.

    Raises:
        InputError: one of the two shows nothing.
    """
    kept: list[LabelledImage] = []
    held: list[LabelledImage] = []
    for image in images:
        block, place = divmod(int(image.name.rsplit("/", 1)[-1]), every)
        is_held = place == int(np.random.default_rng([seed, block]).integers(every))
        (held if is_held else kept).append(image)
    for pictures, use in ((kept, "train"), (held, "validate")):
        if not any(image.objects for image in pictures):
            raise InputError(
                f"of {len(images)} pictures, one in {every} held out, none that shows a part is "
                f"left to {use} on: give more pictures"
            )
    return tuple(kept), tuple(held)
