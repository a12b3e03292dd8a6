"""Training images: scenes or object packs, each depending on nothing but the seed and its number."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.bop_writer import SceneFolder, require_size
from asdfviz.synth.depth_sensor import measure_depth, random_depth_sensor
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.packs import PackConfig, render_pack
from asdfviz.synth.photo_grounds import recorded
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import SceneConfig, TrueScene, make_scene
from asdfviz.synth.sensor import blur_moving, photograph, random_rgb_sensor
from asdfviz.synth.workers import Crew, Piece, do_all

MERGE_EVERY = 100
"""Images after which the truth files are brought up to date."""
LEAST_VISIBLE = 0.3
"""Share of the base part that must be seen; otherwise the scene is drawn again, at last without hands."""
TEST_SEEDS = range(7_000_000, 8_000_000)
"""Seeds of test sets. Nothing is ever trained on them: `generate_images` refuses them."""


def generate_images(
    assembly: Assembly,
    *,
    count: int,
    seed: int,
    folder: Path,
    config: SceneConfig | PackConfig | None = None,
    masks: bool = False,
    shift: bool = False,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
    device: str = "cpu",
    crew: Crew | None = None,
) -> int:
    """Write `count` training images with truth as a BOP scene folder; what is there already stays.

    Args:
        assembly: parts and states to show.
        count: images in all.
        seed: the same seed and number give the same image, whatever ran before and wherever it runs.
        folder: the scene folder to write.
        config: a SceneConfig for scenes (the default), a PackConfig for object packs.
        masks: write BOP's masks too.
        shift: every depth image is misregistered against colour, as in the paper's real frames.
        progress: called with images done and in all; first with those that were there.
        stop: asked before every image; true ends the job, which can be taken up later.
        device: where torch renders.
        crew: other processes or machines that share the work; by default this process alone.

    Returns:
        How many images the folder holds.

    Raises:
        InputError: the count, the seed, the size or the crew is impossible, or the folder holds
            something else.
    """
    chosen = config or SceneConfig()
    _check(count, seed, chosen, crew)
    output = SceneFolder(folder)
    kind = "scenes" if isinstance(chosen, SceneConfig) else "packs"
    about = {"fps": 0, "seed": seed, "kind": kind, "masks": masks, "shift": shift}
    camera = camera_for(chosen.width, chosen.height)
    drawn = recorded(asdict(chosen), chosen.photos)
    output.begin(assembly, sequence={**about, "config": drawn}, camera=camera)
    missing = [index for index in range(count) if not output.has(index)]
    merged = 0

    def tick(done: int) -> None:
        nonlocal merged
        if progress is not None:
            progress(count - len(missing) + done, count)
        if done - merged >= MERGE_EVERY:
            merged = done
            output.merge()

    tick(0)
    work = ImageWork(assembly, seed, folder, chosen, masks, shift, device)
    do_all(work, missing, crew=crew, tick=tick, stop=stop)
    return output.merge()


def check_seed(seed: int, *, of_test_set: bool = False) -> None:
    """Refuse what is no seed and, but for test sets, what is theirs.

    Raises:
        InputError: with the seed and what would be right.
    """
    if seed < 0:
        raise InputError(f"seed is {seed}, use 0 or more")
    if seed in TEST_SEEDS and not of_test_set:
        raise InputError(
            f"seed {seed} belongs to test sets ({TEST_SEEDS.start} to {TEST_SEEDS.stop - 1}); "
            "train on another one"
        )


def _check(count: int, seed: int, config: SceneConfig | PackConfig, crew: Crew | None) -> None:
    if count < 1:
        raise InputError(f"count is {count}, use 1 or more")
    check_seed(seed)
    require_size(config.width, config.height)
    if isinstance(config, PackConfig):
        config.check()
    (crew or Crew()).check()


@dataclass(frozen=True, slots=True, eq=False)
class ImageWork:
    """The images of one job, for `workers.do_all`."""

    assembly: Assembly
    seed: int
    folder: Path
    config: SceneConfig | PackConfig
    masks: bool = False
    shift: bool = False
    device: str = "cpu"
    token: str = field(default_factory=lambda: secrets.token_hex(8))

    def open(self) -> Piece:
        """Load meshes and hands; each piece then is one image."""
        assets = load_assets(self.assembly, device=self.device)
        output = SceneFolder(self.folder, assets=assets, masks=self.masks)
        return lambda number, stop: self._write(number, assets, output)

    def _write(self, index: int, assets: Assets, output: SceneFolder) -> None:
        rng = np.random.default_rng([self.seed, index])
        true_scene, picture = draw_picture(assets, rng=rng, config=self.config)
        radiance = _hand_blur(true_scene, picture, rng)
        setting = random_rgb_sensor(rng)
        rgb = photograph(radiance, sensor=setting, rng=rng)
        depth = None
        if isinstance(self.config, SceneConfig):
            depth = measure_depth(
                picture.depth,
                picture.albedo,
                sensor=random_depth_sensor(rng, shifted=self.shift),
                rng=rng,
            )
        output.write_frame(
            index, true_scene, picture, rgb=rgb, depth=depth, jpeg_quality=setting.jpeg_quality
        )


def draw_picture(
    assets: Assets, *, rng: np.random.Generator, config: SceneConfig | PackConfig
) -> tuple[TrueScene, Picture]:
    """Draw and render one scene or pack; scenes whose base part is hidden are drawn again."""
    if isinstance(config, PackConfig):
        return render_pack(assets, rng=rng, config=config)
    supersampling = 1.5 if rng.random() < 0.4 else 1.0
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
