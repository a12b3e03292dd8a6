"""Times the tracker on many parts at once, in a scene that is made on the spot.

The parts are those of an assembly, repeated as often as it takes, each in a colour of its own and in
front of a speckled wall; they turn and move from frame to frame as hand-held parts do, and their true
poses are known.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from asdfviz.datatypes import Assembly, Camera, Frame
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.track import raster
from asdfviz.track.bodies import Body
from asdfviz.track.presets import PRESETS, TrackerConfig
from asdfviz.track.tracker import Tracker
from asdfviz.track.viewpoint_cache import load_viewpoint_models

SIZE = (1280, 720)
FOCAL = 920.0
"""Pixels."""
DISTANCE = 0.7
"""Of the parts from the camera, metres."""
WALL = 1.0
"""Distance of the wall, metres."""
TURN_DEG, SHIFT = 1.5, 0.003
"""How far every part turns, degrees, and moves, metres, from one frame to the next."""
AIM_MS = 20.0
"""What a frame with ten parts may take on two cores."""


@dataclass(frozen=True, slots=True)
class PartsResult:
    """One preset's figures on the scene of many parts."""

    parts: int
    ms_median: float
    """Tracking a frame, all parts together, the images being in memory; the best of several runs."""
    ms_p90: float
    """Of that run."""
    cpu_ms_median: float
    """What the tracker computed in a frame, whatever else the machine did; it uses one core."""
    add_mm_median: float
    """Over all parts and frames."""
    add_mm_max: float
    load: float
    """Of the machine in the last minute: above its number of cores, times are too long."""


def measure_parts(
    assembly: Assembly,
    *,
    parts: int = 10,
    frames: int = 30,
    runs: int = 5,
    size: tuple[int, int] = SIZE,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, PartsResult]:
    """Track `parts` parts with every preset; the preset's name and its figures.

    `size` is the picture's width and height in pixels; `progress` is told (views done, views) where
    a part's views have to be made first.
    """
    models = load_viewpoint_models(assembly, progress=progress)
    bodies = _bodies(assembly, {n: Body.of(p, models[n]) for n, p in assembly.parts.items()}, parts)
    scale = size[0] / SIZE[0]
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    focal = FOCAL * scale
    K = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    camera = Camera(K, *size)
    poses = [_poses(bodies, k) for k in range(frames)]
    images = [_drawn(bodies, now, camera, k) for k, now in enumerate(poses)]
    return {
        name: _measured(bodies, images, poses, config, runs) for name, config in PRESETS.items()
    }


def _bodies(assembly: Assembly, known: Mapping[str, Body], count: int) -> dict[str, Body]:
    """So many bodies, the assembly's parts in turn, in hues all round the circle."""
    names = list(assembly.parts)
    hues = np.array([[[round(180 * k / count), 200, 200]] for k in range(count)], np.uint8)
    colors = cv2.cvtColor(hues, cv2.COLOR_HSV2RGB)[:, 0]
    bodies: dict[str, Body] = {}
    for k in range(count):
        body = known[names[k % len(names)]]
        bodies[f"part {k + 1}"] = replace(body, color=colors[k])
    return bodies


def _poses(bodies: Mapping[str, Body], k: int) -> dict[str, Transform]:
    """Where every part is in frame k: on a grid that fills the picture, each swinging in its place."""
    columns = int(np.ceil(np.sqrt(len(bodies) * SIZE[0] / SIZE[1])))
    rows = int(np.ceil(len(bodies) / columns))
    width, height = (DISTANCE / FOCAL) * np.array(SIZE)
    poses: dict[str, Transform] = {}
    for i, (name, body) in enumerate(bodies.items()):
        rng = np.random.default_rng(i)
        column, row = i % columns, i // columns
        place = np.array(
            [
                width * ((column + 0.5) / columns - 0.5),
                height * ((row + 0.5) / rows - 0.5),
                DISTANCE,
            ]
        )
        # Swings have the wanted speed where they are fastest, and keep every part in its field.
        swing = 6 * np.sin(k / 6 + rng.uniform(0, 2 * np.pi))
        place = place + SHIFT * swing * _unit(rng)
        start = rotation_about(_unit(rng), float(rng.uniform(0, np.pi)))
        R = rotation_about(_unit(rng), float(np.deg2rad(TURN_DEG) * k)) @ start
        poses[name] = transform_from(R, place - R @ body.model.centre)
    return poses


def _unit(rng: np.random.Generator) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def _drawn(
    bodies: Mapping[str, Body], poses: Mapping[str, Transform], camera: Camera, k: int
) -> Frame:
    """The parts, shaded by how steeply they are seen, with a little noise in colour and depth."""
    rng = np.random.default_rng(k)
    inverse_depth, ids = raster.new_buffers(camera.width, camera.height)
    for number, (name, T) in enumerate(poses.items()):
        mesh = bodies[name].mesh
        raster.draw(mesh, T, K=camera.K, inverse_depth=inverse_depth, ids=ids, number=number)
    shape = (camera.height, camera.width)
    clean = np.where(inverse_depth > 0, 1 / np.maximum(inverse_depth, 1e-6), WALL)
    steep = np.hypot(*np.gradient(clean)) * camera.K[0, 0] / clean
    shade = 0.45 + 0.55 / np.sqrt(1 + np.minimum(steep, 10.0) ** 2)
    rgb = rng.integers(60, 150, shape)[..., None].repeat(3, axis=2).astype(np.float64)
    for number, name in enumerate(poses):
        inside = ids == number
        rgb[inside] = bodies[name].color * shade[inside][:, None]
    rgb += rng.normal(0, 5, (*shape, 3))
    depth = (clean + rng.normal(0, 1e-3, shape)).astype(np.float32)
    return Frame(k, k / 30, np.clip(rgb, 0, 255).astype(np.uint8), depth, camera)


def _measured(
    bodies: Mapping[str, Body],
    images: list[Frame],
    poses: list[dict[str, Transform]],
    config: TrackerConfig,
    runs: int,
) -> PartsResult:
    _track(bodies, images[:2], poses, config)
    tracked = [_track(bodies, images, poses, config) for _ in range(runs)]
    add = tracked[0].add_mm
    best = min(tracked, key=lambda run: statistics.median(run.ms))
    return PartsResult(
        parts=len(bodies),
        ms_median=statistics.median(best.ms),
        ms_p90=float(np.quantile(best.ms, 0.9)),
        cpu_ms_median=min(statistics.median(run.cpu_ms) for run in tracked),
        add_mm_median=statistics.median(add),
        add_mm_max=max(add),
        load=os.getloadavg()[0],
    )


@dataclass(frozen=True, slots=True)
class _Tracked:
    """Milliseconds by frame, and ADD (mm) of every part in every frame."""

    ms: list[float] = field(default_factory=list[float])
    cpu_ms: list[float] = field(default_factory=list[float])
    add_mm: list[float] = field(default_factory=list[float])


def _track(
    bodies: Mapping[str, Body],
    images: list[Frame],
    poses: list[dict[str, Transform]],
    config: TrackerConfig,
) -> _Tracked:
    """Track all parts from their true start."""
    tracker = Tracker(bodies, images[0].camera, config)
    tracker.start(images[0], poses[0])
    told = _Tracked()
    for frame, truth in zip(images[1:], poses[1:], strict=False):
        begun, begun_cpu = time.perf_counter(), time.thread_time()
        found = tracker.update(frame)
        told.ms.append((time.perf_counter() - begun) * 1e3)
        told.cpu_ms.append((time.thread_time() - begun_cpu) * 1e3)
        for name, T in found.items():
            off = T - truth[name]
            moved = bodies[name].mesh.vertices @ off[:3, :3].T + off[:3, 3]
            told.add_mm.append(1e3 * float(np.linalg.norm(moved, axis=1).mean()))
    return told


def parts_table(results: Mapping[str, PartsResult]) -> str:
    """Lay the results out as text, preset by preset."""
    some = next(iter(results.values()))
    lines = [
        f"{some.parts} parts at {SIZE[0]}x{SIZE[1]}, from their true start",
        f"{'preset':8}{'ms a frame':>12}{'p90':>8}{'CPU ms':>9}{'ADD median mm':>15}{'max':>8}",
    ]
    lines += [
        f"{name:8}{row.ms_median:12.2f}{row.ms_p90:8.2f}{row.cpu_ms_median:9.2f}"
        f"{row.add_mm_median:15.2f}{row.add_mm_max:8.2f}"
        for name, row in results.items()
    ]
    load = max(row.load for row in results.values())
    lines.append(f"aim: {AIM_MS:.0f} ms for ten parts on two cores; load of the machine {load:.1f}")
    return "\n".join(lines)
