"""Continuous RGB-D sequences of an assembly being put together, with exact truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Depth
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.bop_writer import SceneFolder
from asdfviz.synth.depth_sensor import DepthSensor, measure_depth, random_depth_sensor
from asdfviz.synth.gbuffer import Views
from asdfviz.synth.images import check_seed
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.photo_grounds import recorded
from asdfviz.synth.play import Play, plan_sequence
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import TrueScene
from asdfviz.synth.sensor import RgbSensor, blur_moving, photograph
from asdfviz.synth.sequence_config import SequenceConfig, check_config, condition_config
from asdfviz.synth.studio import Studio

__all__ = [
    "Play",
    "SequenceConfig",
    "condition_config",
    "generate_sequence",
    "plan_sequence",
    "scenes_of",
]

_BRIGHT = 1.3
"""Light (of lamps and sky, linear) above which the exposure is shortened."""


def scenes_of(play: Play, assets: Assets, *, seed: int, config: SequenceConfig) -> list[TrueScene]:
    """The scene of every moment."""
    studio = Studio.of(play, assets, seed=seed, config=config)
    return [studio.scene(float(k)) for k in range(len(play.moments))]


def generate_sequence(
    assembly: Assembly,
    *,
    seed: int,
    folder: Path,
    config: SequenceConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
    device: str = "cpu",
    masks: bool = False,
    exactly: bool = False,
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
        masks: write BOP's masks too.
        exactly: refuse fewer frames than held parts need; else there are as many as they need.

    Returns:
        How many frames the folder holds.

    Raises:
        InputError: the seed, the size, the rate or the number of frames is impossible, or the folder was
            begun for something else. Nothing is written then.
    """
    chosen = config or SequenceConfig()
    check_seed(seed, of_test_set=True)
    check_config(chosen)
    assets = load_assets(assembly, device=device)
    # What cannot be played is refused before a folder is begun for it.
    play = plan_sequence(assets, seed=seed, config=chosen)
    if exactly:
        _require_frames(len(play.moments), chosen)
    output = SceneFolder(folder, assets=assets, masks=masks)
    about = {"fps": chosen.fps, "seed": seed, "kind": "sequence", "masks": masks}
    camera = camera_for(chosen.width, chosen.height)
    drawn = recorded(asdict(chosen), chosen.photos)
    output.begin(assembly, sequence={**about, "config": drawn}, camera=camera)
    studio = Studio.of(play, assets, seed=seed, config=chosen)
    tell: Callable[[int, int], None] = progress or (lambda done, total: None)
    due = _drawn(len(play.moments), seed=seed, every=chosen.every)
    tell(0, len(due))
    for done, index in enumerate(due):
        if stop is not None and stop():
            break
        if not output.has(index):
            _write_frame(index, studio, output)
        tell(done + 1, len(due))
    count = output.merge()
    if count == len(due):
        output.finish()
    return count


def _drawn(moments: int, *, seed: int, every: int) -> range:
    """The frames that are drawn."""
    return range(min(-seed % every, moments - 1), moments, every)


def _require_frames(least: int, config: SequenceConfig) -> None:
    if config.frames is not None and config.frames < least:
        raise InputError(
            f"frames is {config.frames}, use {least} or more: at {config.fps:g} frames a second "
            "hands and parts need as many"
        )


def _write_frame(index: int, studio: Studio, output: SceneFolder) -> None:
    config, seed, bank = studio.config, studio.seed, studio.assets.bank
    true_scene = studio.scene(float(index))
    # Light is sampled alike in every frame, or shadows would crawl.
    picture = render(
        [true_scene.scene], bank, rng=np.random.default_rng([seed, 13]), supersampling=1.5
    )[0]
    rng = np.random.default_rng([seed, 14, index])
    if config.exposures > 1:
        radiance = _exposed(index, studio)
    else:
        radiance = _smeared(index, true_scene, picture, studio)
    settings = np.random.default_rng([seed, 15])
    light = float((studio.play.sky + sum(l.color for l in studio.play.lights)).mean())
    rgb_sensor = RgbSensor(
        # Like a camera's automatic: bright lights must not burn the parts out.
        exposure=float(settings.uniform(0.36, 0.46)) * min(1.0, _BRIGHT / light),
        blur_px=float(settings.uniform(0.6, 0.9)),
        noise=float(settings.uniform(0.001, 0.002)),
        vignette=float(settings.uniform(0.05, 0.2)),
        contrast=float(settings.uniform(1.05, 1.15)),
        saturation=float(settings.uniform(1.1, 1.25)),
    )
    rgb = photograph(radiance, sensor=rgb_sensor, rng=rng)
    sensor = _depth_sensor(seed, shifted=config.shift)
    depth = measure_depth(picture.depth, picture.albedo, sensor=sensor, rng=rng)
    depth = _rounded(depth, config.depth_step_mm)
    output.write_frame(
        index, true_scene, picture, rgb=rgb, depth=depth, jpeg_quality=config.jpeg_quality
    )


def _depth_sensor(seed: int, *, shifted: bool) -> DepthSensor:
    """The depth camera of a sequence: how it lies to the colour camera does not change in it."""
    sensor = DepthSensor(noise=0.0007)
    if not shifted:
        return sensor
    drawn = random_depth_sensor(np.random.default_rng([seed, 16]), shifted=True)
    return replace(sensor, shift_px=drawn.shift_px, lens=drawn.lens)


def _rounded(depth: Depth, step_mm: int) -> Depth:
    step = step_mm / 1000
    return (np.round(depth / step) * step).astype(np.float32)


def _exposed(index: int, studio: Studio) -> np.ndarray:
    """The mean of pictures over the time of the shutter; the truth is that of its middle."""
    half, count = studio.config.shutter / 2, studio.config.exposures
    total = np.zeros(1, np.float32)
    for time in np.linspace(index - half, index + half, count).tolist():
        picture = render(
            [studio.scene(time).scene],
            studio.assets.bank,
            rng=np.random.default_rng([studio.seed, 13]),
            supersampling=1.0,
        )[0]
        total = total + picture.radiance / count
    return total.astype(np.float32)


def _smeared(index: int, true_scene: TrueScene, picture: Picture, studio: Studio) -> np.ndarray:
    """Smear the hand and what it holds along the way they made since the frame before."""
    now, before = studio.play.moments[index], studio.play.moments[max(index - 1, 0)]
    moving = now.T_world_hand if now.held is None else now.T_world_part[now.held]
    earlier = before.T_world_hand if now.held is None else before.T_world_part[now.held]
    if moving is None or earlier is None:
        return picture.radiance
    views = Views.of([true_scene.scene], scale=1.0, device="cpu")
    ends = np.stack([earlier[:3, 3], moving[:3, 3]]).astype(np.float32)
    p = ends @ views.R[0].numpy().T + views.t[0].numpy()
    if p[:, 2].min() < 0.05:
        return picture.radiance  # The hand comes from behind the camera.
    px = p[:, :2] / p[:, 2:] * float(views.K[0, 0, 0])
    motion = (px[1] - px[0]) * studio.config.shutter
    if float(np.hypot(*motion)) < 1.2:
        return picture.radiance
    names = {now.held} if now.held != studio.assets.assembly.base else set(now.attached)
    placed = true_scene.scene.placed
    blurred = [
        i for i, thing in enumerate(placed) if thing.name in names or i in studio.carrying(now)
    ]
    return blur_moving(
        picture.radiance, np.isin(picture.ids, blurred), (float(motion[0]), float(motion[1]))
    )
