"""The stream of batches of a run: stored pictures, packs rendered meanwhile, or both."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager

from asdfviz.datatypes import Assembly
from asdfviz.synth.packs import PackConfig
from asdfviz.train.config import TrainConfig
from asdfviz.train.dataset import LabelledImage
from asdfviz.train.fresh import FreshPacks, renewed_packers
from asdfviz.train.loader import Batch, Recipe, batches
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
        images: stored pictures.
        world: every process draws its own.
        recipe: what a step's batch is made of.
        first: number of the first step.
    """
    seed = config.seed * world.size + world.rank
    with ExitStack() as stack:
        fresh = None
        if config.fresh:
            shape = PackConfig(width=config.image_size, height=config.image_size * 9 // 16)
            packs = FreshPacks(
                assemblies, capacity=config.fresh, device=world.device, seed=seed, config=shape
            )
            # A sitting makes fewer packs than it draws inputs, so none is ever drawn again.
            fresh = stack.enter_context(packs.rendering(first=first * config.stages[0].batch))
        longer = max(images[0].rgb.shape[:2]) if images else config.image_size
        size = min(max(s.width for s in config.stages), config.image_size)
        packers = renewed_packers(images, fresh, scale=size / longer, config=config.augment)
        yield stack.enter_context(
            batches(packers, recipe, seed=seed, first=first, loaders=config.loaders)
        )
