"""Packs rendered while the network trains: pictures that never repeat, made where it trains."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.pose.labels import Subject
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.frame_labels import picture_labels
from asdfviz.synth.frame_truth import truth_order
from asdfviz.synth.images import draw_picture
from asdfviz.synth.packs import PackConfig
from asdfviz.synth.sensor import photograph, random_rgb_sensor
from asdfviz.train.dataset import LabelledImage
from asdfviz.train.packing import AugmentConfig, Packer

RENEW_EVERY = 16
"""New pictures after which the training draws from them; a smaller pool is renewed as a whole."""


class FreshPacks:
    """A pool of the latest packs; a thread renders new ones and the oldest go.

    Args:
        assemblies: in the order of the network's outputs; packs show them in turn.
        capacity: pictures in the pool.
        device: where torch renders.
        seed: of the packs; together with their number it decides what they show.
        config: how packs are drawn.
    """

    def __init__(
        self,
        assemblies: Sequence[Assembly],
        *,
        capacity: int,
        device: str,
        seed: int,
        config: PackConfig | None = None,
    ) -> None:
        self.made = 0
        self._config = config or PackConfig()
        self._seed = seed
        self._makers: list[tuple[Assets, Subject]] = []
        first = 0
        for assembly in assemblies:
            subject = Subject.of(assembly, first_label=first)
            self._makers.append((load_assets(assembly, device=device), subject))
            first += len(assembly.detector_classes)
        self._pool: deque[LabelledImage] = deque(maxlen=capacity)
        self._renewal = min(RENEW_EVERY, capacity)
        self._changed = threading.Condition()
        self._error: Exception | None = None

    def draw(self, number: int) -> LabelledImage:
        """Render one pack; the same seed and number give the same one."""
        assets, subject = self._makers[number % len(self._makers)]
        rng = np.random.default_rng([self._seed, number])
        true_scene, picture = draw_picture(assets, rng=rng, config=self._config)
        rgb = photograph(picture.radiance, sensor=random_rgb_sensor(rng), rng=rng)
        return LabelledImage(
            name=f"pack/{number:06d}",
            assembly=subject.assembly.name,
            rgb=rgb,
            K=true_scene.scene.camera.K,
            objects=picture_labels(true_scene, picture, truth_order(true_scene), subject),
        )

    @contextmanager
    def rendering(self, *, first: int = 0) -> Generator[FreshPacks]:
        """Render packs from number `first` on, in a thread, while the body runs."""
        closed = threading.Event()

        def work() -> None:
            number = first
            try:
                while not closed.is_set():
                    image = self.draw(number)
                    number += 1
                    with self._changed:
                        self._pool.append(image)
                        self.made += 1
                        self._changed.notify_all()
            except Exception as error:  # noqa: BLE001 - raised again in the thread that waits
                with self._changed:
                    self._error = error
                    self._changed.notify_all()

        worker = threading.Thread(target=work, name="fresh-packs", daemon=True)
        worker.start()
        try:
            yield self
        finally:
            closed.set()
            worker.join(timeout=60)

    def is_renewed(self, since: int) -> bool:
        """Whether enough pictures were made since `since` to draw from them.

        Raises:
            Exception: what ended the rendering.
        """
        with self._changed:
            self._require_rendering()
            return self.made - since >= self._renewal

    def latest(self) -> tuple[LabelledImage, ...]:
        """Return the pool, once there is something to draw from.

        Raises:
            Exception: what ended the rendering.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._error or len(self._pool) >= self._renewal)
            self._require_rendering()
            return tuple(self._pool)

    def _require_rendering(self) -> None:
        if self._error is not None:
            raise self._error


def renewed_packers(
    stored: Sequence[LabelledImage],
    fresh: FreshPacks | None,
    *,
    scale: float,
    config: AugmentConfig,
) -> Callable[[], Packer]:
    """Return what gives the packer of a step: of stored pictures, and of fresh ones where there are.

    Args:
        stored: pictures that stay.
        fresh: pictures that change; None for none.
        scale: input pixels a picture pixel at zoom 1.
        config: how much to change a picture.
    """
    if fresh is None:
        packer = Packer(stored, scale=scale, config=config)
        return lambda: packer
    made = fresh.made
    current: Packer | None = None

    def give() -> Packer:
        nonlocal current, made
        if current is None or fresh.is_renewed(made):
            images = fresh.latest()
            made = fresh.made
            current = Packer([*stored, *images], scale=scale, config=config)
        return current

    return give
