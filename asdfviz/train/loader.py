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
from asdfviz.train.augment import Marks
from asdfviz.train.config import Stage
from asdfviz.train.device_cut import PatchTable
from asdfviz.train.packing import Packer
from asdfviz.train.patches import InputPlan, cut_input

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


@dataclass(frozen=True, slots=True, eq=False)
class BatchPlan:
    """A batch before it has pixels."""

    patches: PatchTable
    targets: Targets
    rotations: Float[Tensor, "b m 3 3"]

    def labelled(self, images: UInt8[Tensor, "b h w 3"]) -> Batch:
        """The batch of these pixels."""
        return Batch(images, self.targets, self.rotations)


def make_batch(packer: Packer, recipe: Recipe, *, seed: int, step: int) -> Batch:
    """Make the batch of a step; nothing but the arguments decides what is in it."""
    inputs = _draw(packer, recipe, seed=seed, step=step)
    pixels = np.stack([cut_input(packer.images, plan).rgb for plan in inputs])
    return Batch(torch.as_tensor(pixels), *_collated([plan.marks for plan in inputs]))


def plan_batch(
    packer: Packer, recipe: Recipe, *, seed: int, step: int, keys: Sequence[int]
) -> BatchPlan:
    """Plan the batch that `make_batch` makes.

    Args:
        packer: draws the inputs.
        recipe: what the batch is made of.
        seed: of the run.
        step: its number.
        keys: of the packer's pictures, where the pixels are cut.
    """
    inputs = _draw(packer, recipe, seed=seed, step=step)
    marks = _collated([plan.marks for plan in inputs])
    return BatchPlan(PatchTable.of(inputs, keys), *marks)


def _draw(packer: Packer, recipe: Recipe, *, seed: int, step: int) -> list[InputPlan]:
    stage = recipe.stage
    inputs: list[InputPlan] = []
    for place in range(stage.batch):
        rng = np.random.default_rng((seed, step, place))
        draw = packer.packed if rng.random() < stage.packed else packer.frame
        inputs.append(draw(rng, width=stage.width, height=stage.height, spread=recipe.spread))
    return inputs


def _collated(marks: Sequence[Marks]) -> tuple[Targets, Float[Tensor, "b m 3 3"]]:
    """Labels and rotations of a batch, padded to the longest list."""
    most = max(1, *(len(m.labels) for m in marks))
    count = len(marks)
    labels = np.zeros((count, most), np.int64)
    boxes = np.zeros((count, most, 4), np.float32)
    keypoints = np.zeros((count, most, KEYPOINTS, 3), np.float32)
    rotations = np.zeros((count, most, 3, 3), np.float32)
    present = np.zeros((count, most), bool)
    for i, each in enumerate(marks):
        n = len(each.labels)
        labels[i, :n], boxes[i, :n] = each.labels, each.boxes
        keypoints[i, :n], rotations[i, :n] = each.keypoints, each.rotations
        present[i, :n] = True
    targets = Targets(
        labels=torch.as_tensor(labels),
        boxes=torch.as_tensor(boxes),
        keypoints=torch.as_tensor(keypoints),
        present=torch.as_tensor(present),
    )
    return targets, torch.as_tensor(rotations)


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
