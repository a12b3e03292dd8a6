"""How many training images and objects a second the generator makes here, by kind and size."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.synth.assets import load_assets
from asdfviz.synth.images import ImageWork, generate_images
from asdfviz.synth.packs import PackConfig, draw_pack
from asdfviz.synth.scene import SceneConfig
from asdfviz.synth.workers import Crew, Piece, Stop, do_all

KINDS = ("scene", "pack")
SIZES = ((640, 360), (1280, 720))
WARM_UP = 2
"""Images made before the clock starts: hand meshes and light meshes are built with the first ones."""


@dataclass(frozen=True)
class SynthSpeed:
    """Speed of one kind of image at one size."""

    kind: str
    width: int
    height: int
    workers: int
    """Processes that worked at the same time."""
    images_per_s: float
    cpu_s_per_image: float
    load: float
    """Mean load of the machine over the last minute; near 1 means nothing else ran."""
    objects_per_s: float | None = None
    """Parts with known poses, of packs made in memory."""
    objects_per_cpu_s: float | None = None


def measure_synth(
    assembly: Assembly,
    *,
    images: int,
    workers: int = 1,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> list[SynthSpeed]:
    """Make `images` images of every kind and size in every process, and time them.

    Scenes are written to a temporary folder as for training; packs stay in memory, as training makes
    them.

    Args:
        assembly: parts and states to show.
        images: timed images of each kind and size, in each process.
        workers: processes at work at the same time, which share the cores; 1 is this process alone.
        device: where torch renders.
        progress: called with kinds and sizes done and in all.

    Raises:
        InputError: the number of images or of workers.
    """
    if images < 1:
        raise InputError(f"{images} images: time 1 or more")
    jobs = [(kind, *size) for kind in KINDS for size in SIZES]
    found: list[SynthSpeed] = []
    for place, (kind, width, height) in enumerate(jobs):
        with tempfile.TemporaryDirectory() as folder:
            work = _Timed(assembly, images, kind, width, height, Path(folder), device)
            do_all(work, range(workers), crew=Crew(workers))
            found.append(work.speed(workers))
        if progress is not None:
            progress(place + 1, len(jobs))
    return found


@dataclass(frozen=True)
class _Timed:
    """Work whose pieces are all the same, one for each process; each leaves its times in a file."""

    assembly: Assembly
    images: int
    kind: str
    width: int
    height: int
    folder: Path
    device: str

    @property
    def token(self) -> str:
        return str(self.folder)

    def open(self) -> Piece:
        return self._time

    def speed(self, workers: int) -> SynthSpeed:
        """Put together what the processes measured, between their first reading and their last."""
        begun, ended, cpu, objects = np.array(
            [json.loads(self._times(n).read_text()) for n in range(workers)]
        ).T
        wall, made = ended.max() - begun.min(), self.images * workers
        packs = self.kind == "pack"
        return SynthSpeed(
            self.kind,
            self.width,
            self.height,
            workers,
            float(made / wall),
            float(cpu.sum() / made),
            os.getloadavg()[0],
            float(objects.sum() / wall) if packs else None,
            float(objects.sum() / cpu.sum()) if packs else None,
        )

    def _time(self, number: int, stop: Stop) -> None:
        make = self._packs() if self.kind == "pack" else self._scenes(number)
        for warm in range(WARM_UP):
            make(warm, stop)
        begun, cpu, objects = time.time(), time.process_time(), 0
        first = WARM_UP + number * self.images
        for image in range(first, first + self.images):
            if stop():
                return
            objects += make(image, stop)
        # All processes share this clock, as they do not share perf_counter everywhere.
        times = [begun, time.time(), time.process_time() - cpu, objects]
        self._times(number).write_text(json.dumps(times))

    def _times(self, number: int) -> Path:
        return self.folder / f"{number}.json"

    def _scenes(self, number: int) -> Callable[[int, Stop], int]:
        folder, config = self.folder / str(number), SceneConfig(self.width, self.height)
        # One image begins the folder.
        generate_images(
            self.assembly, count=1, seed=5, folder=folder, config=config, device=self.device
        )
        piece = ImageWork(self.assembly, 6, folder, config, device=self.device).open()

        def make(image: int, stop: Stop) -> int:
            piece(1 + image, stop)
            return 0

        return make

    def _packs(self) -> Callable[[int, Stop], int]:
        config = PackConfig(width=self.width, height=self.height)
        assets = load_assets(self.assembly, device=self.device)

        def make(image: int, _: Stop) -> int:
            rng = np.random.default_rng([6, image])
            return len(draw_pack(assets, rng=rng, config=config)[1].objects)

        return make


def speed_table(speeds: list[SynthSpeed]) -> str:
    """One row a kind and size."""
    rows = ["kind      size  workers  images/s  CPU s/image  load  objects/s  objects/CPU s"]
    for s in speeds:
        size = f"{s.width}x{s.height}"
        row = f"{s.kind:<6}{size:>9}{s.workers:>9}{s.images_per_s:>10.2f}"
        row += f"{s.cpu_s_per_image:>13.2f}{s.load:>6.1f}"
        if s.objects_per_s is not None:
            row += f"{s.objects_per_s:>11.0f}{s.objects_per_cpu_s:>15.0f}"
        rows.append(row)
    return "\n".join(rows)
