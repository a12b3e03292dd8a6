"""A pool of crops that is renewed while a network trains on it.

Processes write shards of fresh crops into a folder; the training process takes them in and throws
the oldest away. Shards on disk let a later sitting begin at once.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.errors import InputError, Stopped
from asdfviz.synth.workers import spawned
from asdfviz.train.crop_config import CropRunConfig
from asdfviz.train.crop_data import CropMaker, Crops
from asdfviz.train.crop_scenes import CropConfig

SPARE = 2
"""Shards that are made ahead when nobody trains."""
_SHARDS = "shard_*.npz"


class CropPool:
    """Crops in memory, in shards; draws from all of them alike."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._shards: list[Crops] = []

    def __len__(self) -> int:
        return len(self._shards)

    def add(self, crops: Crops) -> None:
        """Take in a shard; the oldest goes if there are too many."""
        self._shards.append(crops)
        del self._shards[: -self._size]

    def draw(self, count: int, *, rng: np.random.Generator) -> Crops:
        """Random crops of up to four shards."""
        chosen = [self._shards[int(i)] for i in rng.integers(len(self._shards), size=4)]
        ends = [round(count * k / len(chosen)) for k in range(len(chosen) + 1)]
        drawn: list[Crops] = []
        for shard, first, last in zip(chosen, ends, ends[1:], strict=False):
            rows = rng.integers(len(shard), size=last - first)
            drawn.append(shard.taken(torch.as_tensor(rows, device=shard.labels.device)))
        return Crops.joined(drawn)


class ShardFolder:
    """Shards on disk, seen by the process that trains."""

    def __init__(self, folder: Path, *, size: int, device: str = "cpu") -> None:
        self._folder, self._size, self._device = folder, size, device
        self._known: set[Path] = set()

    def fresh(self, *, limit: int) -> list[Crops]:
        """Load shards that came since the last call to the device, oldest first; delete those beyond the size."""
        paths = shards_in(self._folder)
        for path in paths[: -self._size]:
            path.unlink(missing_ok=True)
        news = [p for p in paths[-self._size :] if p not in self._known][:limit]
        self._known.update(news)
        return [Crops.load(path).to(self._device) for path in news]


def shards_in(folder: Path) -> list[Path]:
    """The shards of a folder, oldest first: their names hold the time."""
    return sorted(folder.glob(_SHARDS))


@contextmanager
def generating(
    assemblies: Sequence[str],
    folder: Path,
    *,
    processes: int,
    shard: int,
    size: int,
    seed: int,
    niceness: int = 0,
    drawing: CropConfig | None = None,
) -> Generator[Callable[[], bool]]:
    """Let processes fill a folder with shards while the body runs; yields whether any still lives.

    Args:
        assemblies: names or paths.
        folder: of the shards.
        processes: how many.
        shard: crops a shard.
        size: shards of the pool.
        seed: other seeds show other crops.
        niceness: by which the processes stand back behind this one.
        drawing: how crops are drawn.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = tuple(assemblies)
    seeds = [[seed, number, time.time_ns()] for number in range(processes)]
    arguments = [(names, folder, shard, size, own, niceness, drawing) for own in seeds]
    with spawned(fill_folder, arguments) as workers:
        yield lambda: any(worker.is_alive() for worker in workers)


def fill_folder(
    assemblies: Sequence[str],
    folder: Path,
    shard: int,
    size: int,
    seed: Sequence[int],
    niceness: int,
    drawing: CropConfig | None,
) -> None:
    """Write shards until the parent process ends it; wait while the folder is full."""
    os.nice(niceness)
    rng = np.random.default_rng(list(seed))
    maker = CropMaker([load_assembly(name) for name in assemblies], config=drawing)
    while True:
        if len(shards_in(folder)) >= size + SPARE:
            time.sleep(1.0)
            continue
        maker.make(shard, rng=rng).save(folder / f"shard_{time.time_ns():020d}.npz")


def pools(
    config: CropRunConfig,
    *,
    maker: CropMaker,
    drawing: CropConfig,
    stop: Callable[[], bool],
    step: Callable[[], int],
    rng: np.random.Generator,
) -> Iterator[CropPool]:
    """The pool before every step of a run, renewed as fresh crops come.

    Args:
        config: of the run.
        maker: makes crops here, where nobody makes them beside a run on a GPU.
        drawing: how those that do draw them.
        stop: says that the run is to end.
        step: which is next.
        rng: of crops that are made here.

    Raises:
        Stopped: `stop` said so before the first step.
        InputError: there are no crops, and nobody makes any.
    """
    pool = CropPool(config.pool)
    if config.generators == 0 and torch.device(config.device).type != "cpu":
        while True:
            if len(pool) < config.first_shards or step() % config.live_steps == 0:
                pool.add(maker.make(config.shard, rng=rng))
            yield pool
    folder = config.output / "pool"
    shards = ShardFolder(folder, size=config.pool, device=config.device)
    with generating(
        config.assemblies,
        folder,
        processes=config.generators,
        shard=config.shard,
        size=config.pool,
        seed=config.seed,
        niceness=config.generator_niceness,
        drawing=drawing,
    ) as alive:
        wanted = min(config.first_shards, config.pool)
        await_shards(shards, pool, count=wanted, alive=alive, stop=stop)
        while True:
            for crops in shards.fresh(limit=1) if step() % 10 == 0 else ():
                pool.add(crops)
            yield pool


def await_shards(
    folder: ShardFolder,
    pool: CropPool,
    *,
    count: int,
    alive: Callable[[], bool],
    stop: Callable[[], bool],
) -> None:
    """Load shards until the pool holds `count`, or those that there are if nobody makes more.

    Raises:
        Stopped: `stop` said so.
        InputError: there are none, and nobody makes any.
    """
    while len(pool) < count:
        for crops in folder.fresh(limit=1000):
            pool.add(crops)
        if stop():
            raise Stopped("before the first step of this sitting")
        if not alive():
            if len(pool):
                return
            raise InputError(
                "no crops to train on: the generator ended or there is none, see its message above "
                "and give generators 1 or more"
            )
        time.sleep(0.2)
