"""Inputs that are cut on a torch device."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from asdfviz.train.dataset import LabelledImage
from asdfviz.train.device_cut import PatchTable, PicturePool
from asdfviz.train.packing import AugmentConfig, Packer
from asdfviz.train.patches import ColorConfig, InputPlan, cut_input
from tests.train.test_augment import K_TILTED, dotted

WIDTH, HEIGHT = 320, 192


def photo(seed: int, width: int, height: int) -> LabelledImage:
    """Smooth colours, with the dotted picture's object."""
    coarse = np.random.default_rng(seed).integers(0, 256, (height // 8, width // 8, 3), np.uint8)
    rgb = np.repeat(np.repeat(coarse, 8, axis=0), 8, axis=1)
    return LabelledImage(f"photo {seed}", "toy", rgb, K_TILTED, dotted().objects)


def planned(colors: ColorConfig, *, count: int = 4) -> tuple[Packer, list[InputPlan]]:
    images = [photo(0, 96, 64), photo(1, 96, 64), photo(2, 80, 72)]
    packer = Packer(images, side=128, config=AugmentConfig(colors=colors))
    plans: list[InputPlan] = []
    for seed in range(count):
        draw = packer.packed if seed % 2 else packer.frame
        plans.append(draw(np.random.default_rng(seed), width=WIDTH, height=HEIGHT, spread=1.0))
    return packer, plans


def cut(packer: Packer, plans: list[InputPlan]) -> np.ndarray:
    keys = [7 * i + 3 for i in range(len(packer.images))]
    pool = PicturePool("cpu")
    for key, image in zip(keys, packer.images, strict=True):
        pool.add(key, image.rgb)
    return pool.cut(PatchTable.of(plans, keys)).numpy()


@pytest.mark.parametrize("blur", [0.0, 1.0])
def test_a_device_cuts_what_the_cpu_cuts(blur: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asdfviz.train.device_cut.AT_ONCE", 3)
    packer, plans = planned(ColorConfig(blur=blur, noise=0.0))
    wanted = np.stack([cut_input(packer.images, plan).rgb for plan in plans]).astype(int)
    off = np.abs(cut(packer, plans) - wanted)
    # OpenCV places samples to 1/32 of a pixel; at the photo's edges that is a few grey levels.
    assert off.mean() < 0.4
    assert np.percentile(off, 99.9) <= 8
    assert len(plans[1].patches) > 4


def test_the_grain_has_its_strength() -> None:
    packer, plans = planned(ColorConfig(blur=0.0, noise=1.0), count=2)
    clean = [
        dataclasses.replace(
            plan,
            patches=tuple(
                dataclasses.replace(p, colors=dataclasses.replace(p.colors, noise=0.0))
                for p in plan.patches
            ),
        )
        for plan in plans
    ]
    noisy, still = cut(packer, plans).astype(float), cut(packer, clean).astype(float)
    for i, plan in enumerate(plans):
        for p in plan.patches:
            window = np.s_[i, p.y : p.y + p.height, p.x : p.x + p.width]
            middle = (still[window] > 60) & (still[window] < 195)
            if middle.sum() > 2000:
                spread = (noisy[window] - still[window])[middle].std()
                assert spread == pytest.approx(p.colors.noise, rel=0.1)


def test_the_next_picture_takes_the_place_of_one_that_is_gone() -> None:
    packer, plans = planned(ColorConfig(noise=0.0), count=1)
    keys = [0, 1, 2]
    pool = PicturePool("cpu")
    for key in keys:
        pool.add(key, packer.images[(key + 1) % 2].rgb)
    pool.drop(0)
    with pytest.raises(KeyError):
        pool.cut(PatchTable.of(plans, [0, 0, 0]))
    room = len(pool._pixels)
    for key in keys[1:]:
        pool.drop(key)
    for key, image in zip(keys[:2], packer.images, strict=False):
        pool.add(key, image.rgb)
    assert len(pool._pixels) == room
    pool.add(2, packer.images[2].rgb)
    np.testing.assert_array_equal(pool.cut(PatchTable.of(plans, keys)).numpy(), cut(packer, plans))
