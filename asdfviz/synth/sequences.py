"""Continuous RGB-D sequences of an assembly being put together by a hand, with exact truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Depth
from asdfviz.geometry.transforms import apply
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.bop_writer import SceneFolder, require_size
from asdfviz.synth.description import Ground, Light, Placed, Scene
from asdfviz.synth.gbuffer import Views
from asdfviz.synth.layout import Outfit, Table, dress
from asdfviz.synth.looks import any_grounds, linear, plastic, random_lights, theatre
from asdfviz.synth.motion import Pace
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import Group, TrueScene, camera_for, random_view
from asdfviz.synth.script import Director, Moment, chosen_error
from asdfviz.synth.sensor import DepthSensor, RgbSensor, blur_moving, measure_depth, photograph
from asdfviz.synth.stage import Stage, set_stage


@dataclass(frozen=True, slots=True)
class SequenceConfig:
    """How a sequence is played and recorded."""

    width: int = 640
    """Pixels."""
    height: int = 360
    """Pixels."""
    fps: float = 10.0
    frames: int | None = None
    """Frames in all; slower movements fill them. None for as many as the pace needs, which is also the least."""
    error: bool = True
    """Make one error, if the assembly knows any, and correct it."""
    distance: tuple[float, float] = (0.48, 0.62)
    """Camera to table, metres."""
    tilt: tuple[float, float] = (0.0, 0.22)
    """Angle between the optical axis and the vertical, radians."""
    distractors: int = 3
    """At most."""
    theatre: float = 0.7
    """Probability of the blue drape."""
    depth_step_mm: int = 1
    """Depth is rounded to multiples of this, millimetres; 2 halves the size of the files."""
    shutter: float = 0.3
    """Share of the time between frames in which the shutter is open."""
    jpeg_quality: int = 88
    pace: Pace = field(default_factory=Pace)


@dataclass(frozen=True, slots=True, eq=False)
class Play:
    """A sequence before it is rendered."""

    moments: tuple[Moment, ...]
    stage: Stage
    outfit: Outfit
    table: Table
    scenery: tuple[Ground, ...]
    lights: tuple[Light, ...]
    sky: np.ndarray
    tint: np.ndarray


def plan_sequence(assets: Assets, *, seed: int, config: SequenceConfig) -> Play:
    """Write the script; with a wished number of frames the pace is stretched to fill it."""
    play = _play(assets, seed=seed, config=config, stretch=1.0)
    if config.frames is None or config.frames <= len(play.moments):
        return play
    stretch = config.frames / len(play.moments)
    while (
        len((slower := _play(assets, seed=seed, config=config, stretch=stretch)).moments)
        > config.frames
    ):
        stretch *= 0.985
    still = (slower.moments[-1],) * (config.frames - len(slower.moments))
    return Play(
        slower.moments + still,
        slower.stage,
        slower.outfit,
        slower.table,
        slower.scenery,
        slower.lights,
        slower.sky,
        slower.tint,
    )


def _play(assets: Assets, *, seed: int, config: SequenceConfig, stretch: float) -> Play:
    rng = np.random.default_rng([seed, 11])
    camera = camera_for(config.width, config.height)
    T_camera_world = random_view(rng, distance=config.distance, tilt=config.tilt)
    table = Table(camera.K, T_camera_world, camera.width, camera.height, reach=1.0)
    assembly = assets.assembly
    last = assembly.steps[-1]
    stage = set_stage(assets, table, last.T_base_part, rng, distractors=config.distractors)
    outfit = dress(rng, grasp=_fitting_grasp(assembly))
    director = Director(assets, stage, outfit, config.pace, stretch, joints_seed=seed)
    error = chosen_error(assembly, rng) if config.error else None
    director.idle(3)
    for step in assembly.steps:
        if step.index > 0:
            director.go_to(step)
        if error is not None and error.after == step.index:
            director.go_to(error)
    shift = np.array([*(rng.uniform(0.02, 0.05) * _unit(rng)), 0.0])
    director.show(shift, float(rng.choice([-1, 1]) * rng.uniform(0.3, 0.7)))
    director.idle(2)
    footprints = np.concatenate(table.outlines)
    scenery = (
        theatre(footprints, rng) if rng.random() < config.theatre else any_grounds(footprints, rng)
    )
    lights, sky, tint = random_lights(rng)
    return Play(tuple(director.moments), stage, outfit, table, scenery, lights, sky, tint)


def _unit(rng: np.random.Generator) -> np.ndarray:
    angle = rng.random() * 2 * np.pi
    return np.array([np.cos(angle), np.sin(angle)])


def _fitting_grasp(assembly: Assembly) -> int:
    """The pinch whose width suits the parts that are carried."""
    widths = [
        float(np.ptp(p.mesh.vertices, axis=0).min())
        for n, p in assembly.parts.items()
        if n != assembly.base
    ]
    return int(np.searchsorted([0.014, 0.03], float(np.median(widths or [0.02]))))


def scenes_of(play: Play, assets: Assets, *, seed: int, config: SequenceConfig) -> list[TrueScene]:
    """The scene of every moment."""
    rng = np.random.default_rng([seed, 12])
    assembly = assets.assembly
    finishes = {
        n: plastic(np.clip(linear(p.color), 0.004, 0.85), rng) for n, p in assembly.parts.items()
    }
    camera = camera_for(config.width, config.height)
    target = play.table.on_table(camera.width / 2, camera.height / 2)
    holder = dress(rng, grasp=4)
    result: list[TrueScene] = []
    for moment in play.moments:
        names = list(moment.T_world_part)
        placed = [
            Placed(assets.parts[n], moment.T_world_part[n], finishes[n], "part", n, truth=True)
            for n in names
        ]
        group = Group(moment.state, tuple(names.index(n) for n in moment.attached))
        placed += play.stage.clutter
        if moment.T_world_hand is not None:
            placed += play.outfit.place(assets, moment.T_world_hand)
        if play.stage.base_held:
            placed += _holding(assets, moment, play, holder)
        scene = Scene(
            camera,
            play.table.T_camera_world,
            tuple(placed),
            play.scenery,
            play.lights,
            play.sky,
            play.tint,
            target,
            0.5,
        )
        result.append(TrueScene(scene, (group,), 0))
    return result


def _holding(assets: Assets, moment: Moment, play: Play, holder: Outfit) -> list[Placed]:
    """The second hand, at the side of the base that is turned from the first one."""
    base = assets.assembly.base
    world = apply(moment.T_world_part[base], assets.assembly.parts[base].mesh.vertices)
    arm = (play.stage.shoulder - world.mean(axis=0))[:2]
    arm = arm / np.linalg.norm(arm)
    away = np.array([0.35 * arm[0] - arm[1], 0.35 * arm[1] + arm[0], 0.0])
    away /= np.linalg.norm(away)
    point = world[int((world @ away).argmax())] - 0.004 * away
    return holder.place(assets, holder.pose(point, away, pitch=0.3, roll=0.0))


def generate_sequence(
    assembly: Assembly,
    *,
    seed: int,
    folder: Path,
    config: SequenceConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
    device: str = "cpu",
) -> int:
    """Write a sequence with truth as a BOP scene folder; frames that are there already stay.

    Args:
        assembly: what is put together.
        seed: the same seed gives the same sequence.
        folder: the scene folder to write.
        config: pace, camera and sensor.
        progress: called with frames done and in all.
        stop: asked before every frame; true ends the job, which can be taken up later.
        device: where torch renders.

    Returns:
        How many frames the folder holds.

    Raises:
        InputError: the size, the rate or the number of frames is impossible.
    """
    chosen = config or SequenceConfig()
    require_size(chosen.width, chosen.height)
    if not chosen.fps > 0 or (chosen.frames is not None and chosen.frames < 1):
        raise InputError(f"{chosen.frames} frames at {chosen.fps} a second: use positive numbers")
    assets = load_assets(assembly, device=device)
    play = plan_sequence(assets, seed=seed, config=chosen)
    scenes = scenes_of(play, assets, seed=seed, config=chosen)
    output = SceneFolder(folder)
    camera = scenes[0].scene.camera
    complete = True
    for index, true_scene in enumerate(scenes):
        if stop is not None and stop():
            complete = False
            break
        if not output.has(index):
            _write_frame(index, true_scene, play, assets, seed, chosen, output)
        if progress is not None:
            progress(index + 1, len(scenes))
    count = output.merge(
        sequence={"assembly": assembly.name, "fps": chosen.fps, "seed": seed}, camera=camera
    )
    if complete:
        output.finish()
    return count


def _write_frame(
    index: int,
    true_scene: TrueScene,
    play: Play,
    assets: Assets,
    seed: int,
    config: SequenceConfig,
    output: SceneFolder,
) -> None:
    # Light is sampled alike in every frame, or shadows would crawl.
    picture = render(
        [true_scene.scene], assets.bank, rng=np.random.default_rng([seed, 13]), supersampling=1.5
    )[0]
    rng = np.random.default_rng([seed, 14, index])
    radiance = _moving_blur(index, true_scene, picture, play, config)
    settings = np.random.default_rng([seed, 15])
    rgb_sensor = RgbSensor(
        exposure=float(settings.uniform(0.36, 0.46)),
        blur_px=float(settings.uniform(0.6, 0.9)),
        noise=float(settings.uniform(0.001, 0.002)),
        vignette=float(settings.uniform(0.05, 0.2)),
        contrast=float(settings.uniform(1.05, 1.15)),
        saturation=float(settings.uniform(1.1, 1.25)),
    )
    rgb = photograph(radiance, sensor=rgb_sensor, rng=rng)
    depth = measure_depth(picture.depth, picture.albedo, sensor=DepthSensor(noise=0.0007), rng=rng)
    depth = _rounded(depth, config.depth_step_mm)
    output.write_frame(
        index, true_scene, picture, rgb=rgb, depth=depth, jpeg_quality=config.jpeg_quality
    )


def _rounded(depth: Depth, step_mm: int) -> Depth:
    step = step_mm / 1000
    return (np.round(depth / step) * step).astype(np.float32)


def _moving_blur(
    index: int, true_scene: TrueScene, picture: Picture, play: Play, config: SequenceConfig
) -> np.ndarray:
    """Smear the hand and what it holds along the way they made since the frame before."""
    now, before = play.moments[index], play.moments[max(index - 1, 0)]
    if now.T_world_hand is None or before.T_world_hand is None:
        return picture.radiance
    views = Views.of([true_scene.scene], scale=1.0, device="cpu")
    ends = np.stack([before.T_world_hand[:3, 3], now.T_world_hand[:3, 3]]).astype(np.float32)
    p = ends @ views.R[0].numpy().T + views.t[0].numpy()
    px = p[:, :2] / p[:, 2:] * float(views.K[0, 0, 0])
    motion = (px[1] - px[0]) * config.shutter
    if float(np.hypot(*motion)) < 1.2:
        return picture.radiance
    moving = [
        i
        for i, thing in enumerate(true_scene.scene.placed)
        if thing.kind == "hand" or (thing.name == now.held and now.held is not None)
    ]
    return blur_moving(
        picture.radiance, np.isin(picture.ids, moving), (float(motion[0]), float(motion[1]))
    )
