"""Photos of the user's own table as grounds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from asdfviz.datatypes import Assembly
from asdfviz.errors import AsdfvizError, InputError
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Ground, Photo
from asdfviz.synth.grounds import ground_looks
from asdfviz.synth.images import draw_picture, generate_images
from asdfviz.synth.looks import any_grounds, linear
from asdfviz.synth.packs import PackConfig
from asdfviz.synth.photo_grounds import Photos, choose_grounds, find_photos, photographed
from asdfviz.synth.scene import SceneConfig

RED, GREEN, BLUE, WHITE = (200, 40, 40), (40, 200, 40), (40, 40, 200), (220, 220, 220)
POINTS = np.array([[0.0, 0.0], [0.1, 0.1], [-0.1, 0.05]])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One photo of 400 x 200 pixels: red and green above, blue and white below."""
    above = np.repeat(np.array([[RED, GREEN]], np.uint8), 200, axis=1)
    below = np.repeat(np.array([[BLUE, WHITE]], np.uint8), 200, axis=1)
    rows = [np.repeat(half, 100, axis=0) for half in (above, below)]
    made = tmp_path / "bench"
    made.mkdir()
    cv2.imwrite(str(made / "a.png"), np.concatenate(rows)[:, :, ::-1])
    (made / "notes.txt").write_text("mine")
    return made


@pytest.fixture
def plain() -> Ground:
    return replace(any_grounds(POINTS, np.random.default_rng(1))[0], angle=0.0, offset=(0.0, 0.0))


def seen(ground: Ground, x: float, y: float, footprint: float = 0.0005) -> np.ndarray:
    at_x, at_y = torch.tensor([x], dtype=torch.float32), torch.tensor([y], dtype=torch.float32)
    albedo, normal = ground_looks(ground, at_x, at_y, footprint)
    assert normal.tolist() == [[0, 0, 1]]
    return albedo[0].numpy()


def test_a_photo_lies_on_the_plane_as_seen_from_above(folder: Path, plain: Ground) -> None:
    lying = replace(plain, photo=Photo(str(folder / "a.png"), 0.4, np.ones(3)))
    for (x, y), color in {
        (-0.1, 0.05): RED, (0.1, 0.05): GREEN, (-0.1, -0.05): BLUE, (0.1, -0.05): WHITE,
        (-0.29, 0.05): RED, (-0.1, 0.17): RED, (-0.29, -0.17): BLUE,
    }.items():  # fmt: skip
        assert seen(lying, x, y) == pytest.approx(linear(color), abs=1e-3), (x, y)
    # A quarter turn brings what lay to the right to where y is larger.
    turned = replace(lying, angle=np.pi / 2)
    assert seen(turned, -0.05, 0.1) == pytest.approx(linear(GREEN), abs=1e-3)


def test_from_far_away_a_photo_is_seen_coarsely(folder: Path, plain: Ground) -> None:
    lying = replace(plain, photo=Photo(str(folder / "a.png"), 0.4, np.array([0.5, 1.0, 1.0])))
    mean = np.mean([linear(c) for c in (RED, GREEN, BLUE, WHITE)], axis=0) * [0.5, 1, 1]
    assert seen(lying, 0.0, 0.0, footprint=0.3) == pytest.approx(mean, abs=0.02)


def test_black_and_white_tables_are_lit_like_any_other(tmp_path: Path, plain: Ground) -> None:
    for name, shade, least, most in (("black", 8, 0.05, 0.4), ("white", 255, 0.3, 0.95)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((80, 80, 3), shade, np.uint8))
        photos = Photos((str(tmp_path / f"{name}.png"),))
        ground = photographed(plain, photos, np.random.default_rng(3))
        assert least < seen(ground, 0.01, 0.02).mean() < most
        assert ground.colors.mean() == pytest.approx(seen(ground, 0.01, 0.02).mean(), rel=0.02)


def test_without_photos_every_throw_is_as_ever(folder: Path) -> None:
    rng, other = np.random.default_rng(5), np.random.default_rng(5)
    drawn = choose_grounds(POINTS, rng, theatre_share=None, photos=Photos())
    assert len(drawn) == len(any_grounds(POINTS, other))
    assert rng.random() == other.random()
    assert all(ground.photo is None for ground in drawn)
    told: list[tuple[int, int]] = []
    photos = find_photos(folder, width=0.5, share=0.5, progress=lambda *at: told.append(at))
    count = len(photos.files)
    assert told == [(k, count) for k in range(1, count + 1)]
    tops = [
        choose_grounds(POINTS, rng, theatre_share=0.5, photos=photos)[0].photo for _ in range(200)
    ]
    assert 70 < sum(photo is not None for photo in tops) < 130
    widths = [photo.width for photo in tops if photo is not None]
    assert 0.3 < min(widths) < 0.5 < max(widths) < 0.8


@pytest.mark.parametrize(
    "config", [SceneConfig(width=128, height=80), PackConfig(width=128, height=80)]
)
def test_pictures_show_the_photo_behind_the_parts(
    tmp_path: Path, toy_assets: Assets, config: SceneConfig | PackConfig
) -> None:
    cv2.imwrite(str(tmp_path / "g.jpg"), np.full((90, 120, 3), GREEN[::-1], np.uint8))
    photos = find_photos(tmp_path, width=0.6, share=1.0)
    with_photo = replace(config, photos=photos)
    # Some tables end within the picture, and then the floor is seen too.
    without, with_it = (
        np.mean([_green(toy_assets, seed, drawn) for seed in range(2)])
        for drawn in (config, with_photo)
    )
    assert with_it > without + 0.25


def _green(assets: Assets, seed: int, config: SceneConfig | PackConfig) -> float:
    """Share of the ground that is green."""
    _, picture = draw_picture(assets, rng=np.random.default_rng(seed), config=config)
    behind = picture.radiance[picture.ids == -1]
    return float((behind.argmax(axis=1) == 1).mean())


@pytest.mark.usefixtures("toy_loaded_once")
def test_a_folder_notes_the_names_of_photos_and_goes_on_with_the_same(
    tmp_path: Path, folder: Path, toy: Assembly
) -> None:
    config = SceneConfig(width=128, height=80, photos=find_photos(folder, width=0.5, share=1.0))
    for count in (1, 2):
        made = generate_images(toy, count=count, seed=3, folder=tmp_path / "new", config=config)
        assert made == count
    noted = json.loads((tmp_path / "new" / "sequence.json").read_text())["config"]["photos"]
    assert noted == {"files": ["a.png"], "width": 0.5, "share": 1.0}
    with pytest.raises(InputError, match="config"):
        generate_images(
            toy, count=2, seed=3, folder=tmp_path / "new", config=replace(config, photos=Photos())
        )


def test_what_is_no_photo_is_named(tmp_path: Path, folder: Path) -> None:
    def said(path: Path, width: float = 0.6, share: float = 0.7) -> str:
        with pytest.raises(AsdfvizError) as caught:
            find_photos(path, width=width, share=share)
        return str(caught.value)

    assert "nowhere is no folder; give one with photos" in said(tmp_path / "nowhere")
    assert "has no .jpg or .png file" in said(tmp_path)
    assert "ground_width is 600, give the metres" in said(folder, width=600.0)
    assert "ground_width is nan" in said(folder, width=float("nan"))
    assert "ground_share is 0, give one above 0" in said(folder, share=0.0)
    cv2.imwrite(str(folder / "b.png"), np.zeros((40, 90, 3), np.uint8))
    assert "b.png is 90 x 40 pixels, give photos of 64 or more" in said(folder)
    (folder / "b.png").write_bytes((folder / "a.png").read_bytes()[:200])
    assert "b.png is truncated" in said(folder)
