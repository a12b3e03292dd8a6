"""Processes that feed a training: they render pictures, keep the latest, and plan or make batches.

So neither rendering nor cutting inputs makes a GPU wait for Python: it has the pictures too, and cuts
the inputs itself (`asdfviz.train.device_cut`).
"""

from __future__ import annotations

import itertools
import pickle
import queue
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

import torch.multiprocessing as processes

from asdfviz.data.assembly import load_assembly
from asdfviz.errors import AsdfvizError
from asdfviz.geometry.shapes import Rgb
from asdfviz.synth.workers import spawned
from asdfviz.train.dataset import LabelledImage, load_images
from asdfviz.train.device_cut import PicturePool
from asdfviz.train.fresh import FreshConfig, Painter
from asdfviz.train.loader import AHEAD, Batch, BatchPlan, Recipe, make_batch, plan_batch
from asdfviz.train.packing import AugmentConfig, Packer

FIRST = 4
"""Pictures that a process renders before it makes its first batch; fewer where it keeps fewer."""
RENEW_EVERY = 4
"""New pictures after which inputs are drawn from them too."""
LINGERS_S = 60.0
"""A process that failed stays for so long, so that what it sent can be fetched, seconds."""
PATIENCE_S = 1.0
"""Between two looks at whether the processes still live, seconds."""


@dataclass(frozen=True, slots=True)
class Feeding:
    """A job for the processes that feed a training."""

    assemblies: tuple[str, ...]
    """Names or paths, in the order of the network's outputs."""
    fresh: FreshConfig
    seed: int
    first: int = 0
    """Number of the first picture of each process."""
    processes: int = 1
    data: tuple[Path, ...] = ()
    """Scene folders that are drawn from beside what is rendered; each process has its share."""
    image_size: int = 640
    """Longer side that larger stored pictures are reduced to, pixels."""
    side: int = 640
    """Longer side of every picture at zoom 1, input pixels."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    cut_on: str | None = None
    """A torch device on which the process that trains cuts the inputs; None where these do."""


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """A picture that batches are planned from."""

    key: int
    rgb: Rgb
    gone: int | None = None
    """Key of the one that it takes the place of."""


class Feeder:
    """One process's pictures, and the batches that it makes of them."""

    def __init__(self, job: Feeding, number: int) -> None:
        """Load the assemblies and this process's share of the stored pictures."""
        self._job, self._number = job, number
        assemblies = [load_assembly(name) for name in job.assemblies]
        stored: tuple[LabelledImage, ...] = ()
        if job.data:
            mine = slice(number, None, job.processes)
            stored = load_images(job.data, assemblies, image_size=job.image_size, share=mine)
        self._stored = stored
        self._painter = Painter(assemblies, job.fresh, seed=job.seed)
        kept = max(1, job.fresh.kept // job.processes)
        self._pool: deque[LabelledImage] = deque(maxlen=kept)
        self._keys: list[int] = []
        self._first = min(FIRST, kept)
        self._packer: Packer | None = None
        self._shows = False
        self._made = self._drawn = self._packed = 0

    def _key(self, place: int) -> int:
        """No other process has it."""
        return place * self._job.processes + self._number

    def stored(self) -> Iterator[Shown]:
        """The pictures that need not be rendered."""
        for i, image in enumerate(self._stored):
            yield Shown(self._key(i), image.rgb)

    @property
    def wants_pictures(self) -> bool:
        """Whether what there is was drawn from often enough, or shows nothing that is learnt."""
        is_used = self._drawn >= self._job.fresh.draws * self._made
        return self._made < self._first or is_used or not self._shows

    def paint(self) -> Shown:
        """Render one picture; the oldest goes."""
        number = self._key(self._job.first + self._made)
        newest = len(self._stored) + self._made
        gone = newest - len(self._pool) if len(self._pool) == self._pool.maxlen else None
        self._pool.append(self._painter.draw(number))
        self._shows = any(image.objects for image in (*self._stored, *self._pool))
        self._made += 1
        rgb = self._pool[-1].rgb
        return Shown(self._key(newest), rgb, None if gone is None else self._key(gone))

    def batch(self, step: int, recipe: Recipe) -> Batch | BatchPlan:
        """Make or plan the batch of a step from what there is."""
        job, seed = self._job, self._job.seed
        # A plan must not name what is gone where it is carried out: that one needs the latest.
        if self._packer is None or self._made - self._packed >= (1 if job.cut_on else RENEW_EVERY):
            images = [*self._stored, *self._pool]
            self._packer = Packer(images, side=job.side, config=job.augment)
            self._packed = self._made
            oldest = len(self._stored) + self._made - len(self._pool)
            places = [*range(len(self._stored)), *range(oldest, oldest + len(self._pool))]
            self._keys = [self._key(place) for place in places]
        self._drawn += recipe.stage.batch
        if job.cut_on is None:
            return make_batch(self._packer, recipe, seed=seed, step=step)
        return plan_batch(self._packer, recipe, seed=seed, step=step, keys=self._keys)


def feed(job: Feeding, number: int, requests: Any, batches: Any) -> None:
    """Answer requests with batches, and render meanwhile, until the parent process ends it."""
    tells = job.cut_on is not None
    try:
        feeder = Feeder(job, number)
        for shown in feeder.stored() if tells else ():
            batches.put(shown)
        while True:
            asked: tuple[int, Recipe] | None = None
            if not feeder.wants_pictures:
                with suppress(queue.Empty):
                    asked = requests.get_nowait()
            if asked is None:
                shown = feeder.paint()
                if tells:
                    batches.put(shown)
            else:
                batches.put(feeder.batch(*asked))
    except Exception as error:  # noqa: BLE001 - raised again in the process that trains
        batches.put(_sendable(error))
        # Whoever waits in the queue before it is handed over by this process, and told its end.
        time.sleep(LINGERS_S)


def _sendable(error: Exception) -> Exception:
    """The error with the place where it came up; in words where it cannot travel itself."""
    error.add_note(traceback.format_exc())
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001 - whatever it is, its words can travel
        return AsdfvizError(f"{type(error).__name__}: {error}")
    return error


@contextmanager
def fed(job: Feeding, recipe: Callable[[int], Recipe], *, first: int) -> Generator[Iterator[Batch]]:
    """Give an endless iterator over the batches from step `first` on, while processes make them.

    Args:
        job: what they draw from.
        recipe: what a step's batch is made of; called some steps before.
        first: number of the first step.
    """
    context = processes.get_context("spawn")
    requests, batches = context.Queue(), context.Queue()
    arguments = [(job, number, requests, batches) for number in range(job.processes)]

    pool = PicturePool(job.cut_on) if job.cut_on is not None else None

    def take(workers: Sequence[SpawnProcess]) -> Iterator[Batch]:
        waiting = 0
        for step in itertools.count(first):
            requests.put((step, recipe(step)))
            waiting += 1
            if waiting >= AHEAD + job.processes:
                yield _next_of(batches, workers, pool)
                waiting -= 1

    try:
        with spawned(feed, arguments) as workers:
            yield take(workers)
    finally:
        for each in (requests, batches):
            each.close()
            each.cancel_join_thread()


def _next_of(
    batches: Any, workers: Sequence[SpawnProcess], pool: PicturePool | None = None
) -> Batch:
    """Wait for the next batch; planned ones get their pixels here, where there is a pool.

    Raises:
        AsdfvizError: a process was killed.
        Exception: what ended one of them.
    """
    while True:
        try:
            found = batches.get(timeout=PATIENCE_S)
        except (queue.Empty, OSError, EOFError):  # nothing yet, or of a process that is gone
            gone = [w.exitcode for w in workers if not w.is_alive()]
            if gone:
                raise AsdfvizError(
                    f"a process that renders pictures ended (exit code {gone[0]}): with fewer "
                    "loaders it needs less memory, also in /dev/shm"
                ) from None
            continue
        if isinstance(found, Exception):
            raise found
        if pool is None:
            return found
        if isinstance(found, BatchPlan):
            return found.labelled(pool.cut(found.patches))
        if found.gone is not None:
            pool.drop(found.gone)
        pool.add(found.key, found.rgb)
