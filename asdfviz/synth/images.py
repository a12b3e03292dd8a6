"""Training images: scenes or object packs, each depending on nothing but the seed and its number."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.bop_writer import SceneFolder, require_size
from asdfviz.synth.packs import PackConfig, make_pack
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import SceneConfig, TrueScene, camera_for, make_scene
from asdfviz.synth.sensor import (
    blur_moving,
    measure_depth,
    photograph,
    random_depth_sensor,
    random_rgb_sensor,
)

MERGE_EVERY = 100
"""Images after which the truth files are brought up to date."""
LEAST_VISIBLE = 0.3
"""Share of the base part that must be seen; otherwise the scene is drawn again, at last without hands."""


def generate_images(
    assembly: Assembly,
    *,
    count: int,
    seed: int,
    folder: Path,
    config: SceneConfig | PackConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
    device: str = "cpu",
) -> int:
    """Write `count` training images with truth as a BOP scene folder; what is there already stays.

    Args:
        assembly: parts and states to show.
        count: images in all.
        seed: the same seed and number give the same image, whatever ran before.
        folder: the scene folder to write.
        config: a SceneConfig for scenes (the default), a PackConfig for object packs.
        progress: called with images done and in all.
        stop: asked before every image; true ends the job, which can be taken up later.
        device: where torch renders.

    Returns:
        How many images the folder holds.

    Raises:
        InputError: the count or the size is impossible, or the folder holds images of another kind.
    """
    if count < 1:
        raise InputError(f"count is {count}, use 1 or more")
    chosen = config or SceneConfig()
    require_size(chosen.width, chosen.height)
    camera = camera_for(chosen.width, chosen.height)
    description = {"assembly": assembly.name, "fps": 0, "seed": seed}
    output = SceneFolder(folder)
    output.require_same(sequence=description, camera=camera)
    assets: Assets | None = None
    for index in range(count):
        if stop is not None and stop():
            break
        if not output.has(index):
            assets = assets or load_assets(assembly, device=device)
            _write_one(assets, index, seed, chosen, output)
        if progress is not None:
            progress(index + 1, count)
        if (index + 1) % MERGE_EVERY == 0 and assets is not None:
            output.merge(sequence=description, camera=camera)
    return output.merge(sequence=description, camera=camera)


def _write_one(
    assets: Assets, index: int, seed: int, config: SceneConfig | PackConfig, output: SceneFolder
) -> None:
    rng = np.random.default_rng([seed, index])
    true_scene, picture = draw_picture(assets, rng=rng, config=config)
    radiance = _hand_blur(true_scene, picture, rng)
    setting = random_rgb_sensor(rng)
    rgb = photograph(radiance, sensor=setting, rng=rng)
    depth = None
    if isinstance(config, SceneConfig):
        depth = measure_depth(
            picture.depth,
            picture.albedo,
            sensor=random_depth_sensor(rng, shifted=rng.random() < 0.3),
            rng=rng,
        )
    output.write_frame(
        index, true_scene, picture, rgb=rgb, depth=depth, jpeg_quality=setting.jpeg_quality
    )


def draw_picture(
    assets: Assets, *, rng: np.random.Generator, config: SceneConfig | PackConfig
) -> tuple[TrueScene, Picture]:
    """Draw and render one scene or pack; scenes whose base part is hidden are drawn again."""
    supersampling = 1.5 if rng.random() < 0.4 else 1.0
    if isinstance(config, PackConfig):
        pack = make_pack(assets, rng=rng, config=config)
        return pack, render([pack.scene], assets.bank, rng=rng, supersampling=supersampling)[0]
    attempt = 0
    while True:
        true_scene = make_scene(assets, rng=rng, config=config, hands=attempt < 2)
        picture = render([true_scene.scene], assets.bank, rng=rng, supersampling=supersampling)[0]
        attempt += 1
        seen = int((picture.ids == 0).sum())
        if attempt == 3 or seen >= LEAST_VISIBLE * max(int(picture.silhouette_px[0]), 1):
            return true_scene, picture


def _hand_blur(true_scene: TrueScene, picture: Picture, rng: np.random.Generator) -> np.ndarray:
    """Smear the hands of one picture in three, as moving hands are."""
    hands = [i for i, p in enumerate(true_scene.scene.placed) if p.kind == "hand"]
    if not hands or rng.random() > 0.35:
        return picture.radiance
    width = picture.radiance.shape[1]
    length = rng.uniform(3, 26) * width / 1280
    angle = rng.random() * 2 * np.pi
    motion_px = (float(length * np.cos(angle)), float(length * np.sin(angle)))
    mask = np.isin(picture.ids, hands)
    return blur_moving(picture.radiance, mask, motion_px)
