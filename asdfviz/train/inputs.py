"""The stream of batches of a run: stored pictures, pictures rendered meanwhile, or both."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager

import torch

from asdfviz.datatypes import Assembly
from asdfviz.train.config import TrainConfig
from asdfviz.train.dataset import LabelledImage
from asdfviz.train.feeding import Feeding, fed
from asdfviz.train.fresh import FreshConfig
from asdfviz.train.loader import Batch, Recipe, batches
from asdfviz.train.packing import Packer
from asdfviz.train.world import World


@contextmanager
def input_stream(
    config: TrainConfig,
    assemblies: Sequence[Assembly],
    images: Sequence[LabelledImage],
    *,
    world: World,
    recipe: Callable[[int], Recipe],
    first: int,
) -> Generator[Iterator[Batch]]:
    """Give an endless iterator over the batches from step `first` on.

    Args:
        config: of the run.
        assemblies: in the order of the network's outputs.
        images: stored pictures; with fresh ones, the processes that render read them themselves.
        world: every process draws its own.
        recipe: what a step's batch is made of.
        first: number of the first step.
    """
    seed = config.seed * world.size + world.rank
    size = min(max(s.width for s in config.stages), config.image_size)
    if config.fresh:
        job = Feeding(
            assemblies=tuple(str(assembly.path) for assembly in assemblies),
            fresh=FreshConfig(
                kept=config.fresh,
                draws=config.fresh_draws,
                scenes=config.fresh_scenes,
                width=config.image_size,
                height=config.image_size * 9 // 16,
                device=_own(config.fresh_device, world),
            ),
            seed=seed,
            # Far beyond what an earlier sitting made.
            first=first * config.stages[0].batch,
            processes=config.loaders,
            data=config.data,
            image_size=config.image_size,
            side=size,
            augment=config.augment,
            cut_on=world.device if torch.device(world.device).type != "cpu" else None,
        )
        with fed(job, recipe, first=first) as stream:
            yield stream
        return
    packer = Packer(images, side=size, config=config.augment)
    with batches(packer, recipe, seed=seed, first=first, loaders=config.loaders) as stream:
        yield stream


def _own(device: str, world: World) -> str:
    """Of several GPUs the one that this process trains on."""
    same = torch.device(device).type == torch.device(world.device).type
    return world.device if same else device
