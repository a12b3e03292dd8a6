"""Pictures rendered while the network trains: they never repeat and are made where it trains.

Processes render them, keep the latest, and make the batches that the training asks for, so that
neither rendering nor cutting inputs makes a GPU wait for Python.
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

import numpy as np
import torch.multiprocessing as processes

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.errors import AsdfvizError
from asdfviz.pose.labels import Subject
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.frame_labels import picture_labels
from asdfviz.synth.frame_truth import truth_order
from asdfviz.synth.images import draw_picture
from asdfviz.synth.packs import PackConfig
from asdfviz.synth.scene import SceneConfig
from asdfviz.synth.sensor import photograph, random_rgb_sensor
from asdfviz.synth.workers import spawned
from asdfviz.train.dataset import LabelledImage, load_images
from asdfviz.train.loader import AHEAD, Batch, Recipe, make_batch
from asdfviz.train.packing import AugmentConfig, Packer

FIRST = 16
"""Pictures that a process renders before it makes its first batch; fewer where it keeps fewer."""
RENEW_EVERY = 4
"""New pictures after which inputs are drawn from them too."""
LINGERS_S = 60.0
"""A process that failed stays for so long, so that what it sent can be fetched, seconds."""
PATIENCE_S = 1.0
"""Between two looks at whether the processes still live, seconds."""


@dataclass(frozen=True, slots=True)
class FreshConfig:
    """What is rendered while a network trains, and for how long it is drawn from."""

    kept: int
    """The latest so many pictures are drawn from, over all processes."""
    draws: int = 40
    """Inputs for each picture that is rendered; a training that wants more waits."""
    scenes: float = 0.5
    """Share of scenes among the pictures; the others are packs."""
    grouped: float = 0.5
    """Share of packs that show mostly joined groups, 0 to 1: from them states are learnt."""
    width: int = 640
    """Of the pictures, pixels."""
    height: int = 360
    """Of the pictures, pixels."""
    device: str = "cpu"
    """Where torch renders."""

    def kinds(self) -> tuple[tuple[float, SceneConfig | PackConfig], ...]:
        """What a picture may be, and how often it is."""
        scene = SceneConfig(width=self.width, height=self.height)
        pack = PackConfig(width=self.width, height=self.height)
        groups = PackConfig(
            width=self.width,
            height=self.height,
            sizes_px=(52.0, 180.0),
            coverage=0.55,
            groups=0.8,
            strays=0.12,
            occluders=0.06,
            hand=0.2,
        )
        rest = 1 - self.scenes
        return (
            (self.scenes, scene),
            (rest * (1 - self.grouped), pack),
            (rest * self.grouped, groups),
        )


class Painter:
    """Draws numbered pictures, each of one of the assemblies."""

    def __init__(self, assemblies: Sequence[Assembly], config: FreshConfig, *, seed: int) -> None:
        """Prepare the assemblies, in the order of the network's outputs."""
        self._seed = seed
        shares, self._kinds = zip(*config.kinds(), strict=True)
        self._shares = np.array(shares) / sum(shares)
        self._makers: list[tuple[Assets, Subject]] = []
        first = 0
        for assembly in assemblies:
            subject = Subject.of(assembly, first_label=first)
            self._makers.append((load_assets(assembly, device=config.device), subject))
            first += len(assembly.detector_classes)

    def draw(self, number: int) -> LabelledImage:
        """Render one picture; the same seed and number give the same one."""
        rng = np.random.default_rng([self._seed, number])
        # Not in turn: of numbers that go up in steps, as each process has them, some never come.
        assets, subject = self._makers[int(rng.integers(len(self._makers)))]
        kind = self._kinds[int(rng.choice(len(self._kinds), p=self._shares))]
        true_scene, picture = draw_picture(assets, rng=rng, config=kind)
        rgb = photograph(picture.radiance, sensor=random_rgb_sensor(rng), rng=rng)
        return LabelledImage(
            name=f"fresh/{number:06d}",
            assembly=subject.assembly.name,
            rgb=rgb,
            K=true_scene.scene.camera.K,
            objects=picture_labels(true_scene, picture, truth_order(true_scene), subject),
        )


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


class Feeder:
    """One process's pictures, and the batches that it makes of them."""

    def __init__(self, job: Feeding, number: int) -> None:
        """Load the assemblies and this process's share of the stored pictures."""
        self._job, self._number = job, number
        assemblies = [load_assembly(name) for name in job.assemblies]
        self._painter = Painter(assemblies, job.fresh, seed=job.seed)
        stored: tuple[LabelledImage, ...] = ()
        if job.data:
            mine = slice(number, None, job.processes)
            stored = load_images(job.data, assemblies, image_size=job.image_size, share=mine)
        self._stored = stored
        kept = max(1, job.fresh.kept // job.processes)
        self._pool: deque[LabelledImage] = deque(maxlen=kept)
        self._first = min(FIRST, kept)
        self._packer: Packer | None = None
        self._shows = False
        self._made = self._drawn = self._packed = 0

    @property
    def wants_pictures(self) -> bool:
        """Whether what there is was drawn from often enough, or shows nothing that is learnt."""
        is_used = self._drawn >= self._job.fresh.draws * self._made
        return self._made < self._first or is_used or not self._shows

    def paint(self) -> None:
        """Render one picture; the oldest goes."""
        number = (self._job.first + self._made) * self._job.processes + self._number
        self._pool.append(self._painter.draw(number))
        self._shows = any(image.objects for image in (*self._stored, *self._pool))
        self._made += 1

    def batch(self, step: int, recipe: Recipe) -> Batch:
        """Make the batch of a step from what there is."""
        if self._packer is None or self._made - self._packed >= RENEW_EVERY:
            images = [*self._stored, *self._pool]
            self._packer = Packer(images, side=self._job.side, config=self._job.augment)
            self._packed = self._made
        self._drawn += recipe.stage.batch
        return make_batch(self._packer, recipe, seed=self._job.seed, step=step)


def feed(job: Feeding, number: int, requests: Any, batches: Any) -> None:
    """Answer requests with batches, and render meanwhile, until the parent process ends it."""
    try:
        feeder = Feeder(job, number)
        while True:
            asked: tuple[int, Recipe] | None = None
            if not feeder.wants_pictures:
                with suppress(queue.Empty):
                    asked = requests.get_nowait()
            if asked is None:
                feeder.paint()
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

    def take(workers: Sequence[SpawnProcess]) -> Iterator[Batch]:
        waiting = 0
        for step in itertools.count(first):
            requests.put((step, recipe(step)))
            waiting += 1
            if waiting >= AHEAD + job.processes:
                yield _next_of(batches, workers)
                waiting -= 1

    try:
        with spawned(feed, arguments) as workers:
            yield take(workers)
    finally:
        for each in (requests, batches):
            each.close()
            each.cancel_join_thread()


def _next_of(batches: Any, workers: Sequence[SpawnProcess]) -> Batch:
    """Wait for the next batch.

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
        return found
