"""How many training images and objects a second the generator makes here, by kind and size."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.synth.assets import load_assets
from asdfviz.synth.images import generate_images
from asdfviz.synth.packs import PackConfig, draw_pack
from asdfviz.synth.scene import SceneConfig
from asdfviz.synth.textures import build_maps

SIZES = ((640, 360), (1280, 720))
WARM_UP = 2
"""Images made before the clock starts: hand meshes and light meshes are built with the first ones."""


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
    objects_per_s: float | None = None
    """Parts with known poses, of packs made in memory."""
    objects_per_cpu_s: float | None = None


def measure_synth(
    assembly: Assembly, *, images: int, progress: Callable[[int, int], None] | None = None
) -> list[SynthSpeed]:
    """Make `images` images of every kind and size and time them.

    Scenes are written to a temporary folder as for training; packs stay in memory, as training makes
    them.
    """
    build_maps("cpu")
    jobs = [(measure, size) for measure in (_scenes, _packs) for size in SIZES]
    found: list[SynthSpeed] = []
    for place, (measure, (width, height)) in enumerate(jobs):
        found.append(measure(assembly, images, width, height))
        if progress is not None:
            progress(place + 1, len(jobs))
    return found


def _scenes(assembly: Assembly, images: int, width: int, height: int) -> SynthSpeed:
    config = SceneConfig(width=width, height=height)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder)
        generate_images(assembly, count=WARM_UP, seed=5, folder=target, config=config)
        wall, cpu = time.perf_counter(), time.process_time()
        generate_images(assembly, count=WARM_UP + images, seed=5, folder=target, config=config)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return SynthSpeed("scene", width, height, images / wall, cpu / images, os.getloadavg()[0])


def _packs(assembly: Assembly, images: int, width: int, height: int) -> SynthSpeed:
    config = PackConfig(width=width, height=height)
    assets = load_assets(assembly)
    for number in range(WARM_UP):
        draw_pack(assets, rng=np.random.default_rng([5, number]), config=config)
    wall, cpu, objects = time.perf_counter(), time.process_time(), 0
    for number in range(images):
        rng = np.random.default_rng([6, number])
        objects += len(draw_pack(assets, rng=rng, config=config)[1].objects)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return SynthSpeed(
        "pack",
        width,
        height,
        images / wall,
        cpu / images,
        os.getloadavg()[0],
        objects / wall,
        objects / cpu,
    )


def speed_table(speeds: list[SynthSpeed]) -> str:
    """One row a kind and size."""
    rows = ["kind      size  images/s  CPU s/image  load  objects/s  objects/CPU s"]
    for s in speeds:
        size = f"{s.width}x{s.height}"
        row = f"{s.kind:<6}{size:>9}{s.images_per_s:>9.2f}{s.cpu_s_per_image:>12.2f}{s.load:>8.1f}"
        if s.objects_per_s is not None:
            row += f"{s.objects_per_s:>11.0f}{s.objects_per_cpu_s:>15.0f}"
        rows.append(row)
    return "\n".join(rows)
