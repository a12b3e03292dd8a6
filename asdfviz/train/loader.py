"""Makes batches in background threads, the same ones for the same seed and step."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from asdfviz.datatypes import KEYPOINTS
from asdfviz.detector.assigner import Targets
from asdfviz.train.augment import Sample
from asdfviz.train.config import Stage
from asdfviz.train.packing import Packer

AHEAD = 2
"""Batches made ahead of the step that needs them."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """One step's inputs and labels."""

    images: UInt8[Tensor, "b h w 3"]
    targets: Targets
    rotations: Float[Tensor, "b m 3 3"]

    def to(self, device: str) -> Batch:
        """The same batch on a torch device."""
        targets = Targets(
            labels=self.targets.labels.to(device),
            boxes=self.targets.boxes.to(device),
            keypoints=self.targets.keypoints.to(device),
            present=self.targets.present.to(device),
        )
        return Batch(self.images.to(device), targets, self.rotations.to(device))


@dataclass(frozen=True, slots=True)
class Recipe:
    """What the batch of one step is made of."""

    stage: Stage
    spread: float
    """Share of the full camera roll, 0 to 1."""


def collate(samples: Sequence[Sample]) -> Batch:
    """Stack samples of one size, labels padded to the longest list."""
    most = max(1, *(len(s.labels) for s in samples))
    count = len(samples)
    labels = np.zeros((count, most), np.int64)
    boxes = np.zeros((count, most, 4), np.float32)
    keypoints = np.zeros((count, most, KEYPOINTS, 3), np.float32)
    rotations = np.zeros((count, most, 3, 3), np.float32)
    present = np.zeros((count, most), bool)
    for i, sample in enumerate(samples):
        n = len(sample.labels)
        labels[i, :n], boxes[i, :n] = sample.labels, sample.boxes
        keypoints[i, :n], rotations[i, :n] = sample.keypoints, sample.rotations
        present[i, :n] = True
    return Batch(
        images=torch.as_tensor(np.stack([s.rgb for s in samples])),
        targets=Targets(
            labels=torch.as_tensor(labels),
            boxes=torch.as_tensor(boxes),
            keypoints=torch.as_tensor(keypoints),
            present=torch.as_tensor(present),
        ),
        rotations=torch.as_tensor(rotations),
    )


def make_batch(packer: Packer, recipe: Recipe, *, seed: int, step: int) -> Batch:
    """Make the batch of a step; nothing but the arguments decides what is in it."""
    stage = recipe.stage
    samples: list[Sample] = []
    for place in range(stage.batch):
        rng = np.random.default_rng((seed, step, place))
        draw = packer.packed if rng.random() < stage.packed else packer.frame
        samples.append(draw(rng, width=stage.width, height=stage.height, spread=recipe.spread))
    return collate(samples)


@contextmanager
def batches(
    packer: Packer,
    recipe: Callable[[int], Recipe],
    *,
    seed: int,
    first: int,
    loaders: int = 1,
) -> Generator[Iterator[Batch]]:
    """Give an endless iterator over the batches from step `first` on, made ahead of time.

    Args:
        packer: draws the inputs.
        recipe: what a step's batch is made of; called shortly before the step.
        seed: of the run.
        first: number of the first step.
        loaders: threads that make batches.
    """
    pool = ThreadPoolExecutor(loaders, thread_name_prefix="training-loader")
    waiting: deque[Future[Batch]] = deque()

    def take() -> Iterator[Batch]:
        for step in itertools.count(first):
            waiting.append(pool.submit(make_batch, packer, recipe(step), seed=seed, step=step))
            if len(waiting) >= AHEAD + loaders:
                yield waiting.popleft().result()

    try:
        yield take()
    finally:
        pool.shutdown(cancel_futures=True)
