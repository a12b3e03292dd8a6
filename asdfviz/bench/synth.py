"""How many training images a second the generator makes here, by kind and size."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from asdfviz.datatypes import Assembly
from asdfviz.synth.images import generate_images
from asdfviz.synth.packs import PackConfig
from asdfviz.synth.scene import SceneConfig

SIZES = ((640, 360), (1280, 720))
WARM_UP = 2
"""Images made before the clock starts: hand meshes and textures are built with the first ones."""


@dataclass(frozen=True)
class SynthSpeed:
    """Speed of one kind of image at one size, in one process."""

    kind: str
    width: int
    height: int
    images_per_s: float
    cpu_s_per_image: float
    load: float
    """Mean load of the machine over the last minute; near 1 means nothing else ran."""


def measure_synth(
    assembly: Assembly, *, images: int, progress: Callable[[int, int], None] | None = None
) -> list[SynthSpeed]:
    """Generate `images` images of every kind and size in a temporary folder and time them."""
    found: list[SynthSpeed] = []
    kinds = [("scene", SceneConfig), ("pack", PackConfig)]
    jobs = [(name, kind, size) for name, kind in kinds for size in SIZES]
    for place, (name, kind, (width, height)) in enumerate(jobs):
        with tempfile.TemporaryDirectory() as folder:
            config = kind(width=width, height=height)
            target = Path(folder)
            generate_images(assembly, count=WARM_UP, seed=5, folder=target, config=config)
            wall, cpu = time.perf_counter(), time.process_time()
            generate_images(assembly, count=WARM_UP + images, seed=5, folder=target, config=config)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        found.append(
            SynthSpeed(name, width, height, images / wall, cpu / images, os.getloadavg()[0])
        )
        if progress is not None:
            progress(place + 1, len(jobs))
    return found


def speed_table(speeds: list[SynthSpeed]) -> str:
    """One row a kind and size."""
    rows = ["kind      size  images/s  CPU s/image  load"]
    for s in speeds:
        size = f"{s.width}x{s.height}"
        rows.append(
            f"{s.kind:<6}{size:>9}{s.images_per_s:>9.2f}{s.cpu_s_per_image:>12.2f}{s.load:>8.1f}"
        )
    return "\n".join(rows)
