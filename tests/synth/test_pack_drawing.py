from __future__ import annotations

import numpy as np
import torch

from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, is_rigid
from asdfviz.synth.assets import Assets
from asdfviz.synth.packs import PackConfig, draw_pack
from asdfviz.synth.textures import macro_map, micro_map

SMALL = PackConfig(width=224, height=126, sizes_px=(16.0, 50.0), hand=0.0, occluders=0.0)


def test_a_pack_is_drawn_in_memory_with_poses_that_meet_its_picture(toy_assets: Assets) -> None:
    seen = 0
    for seed in range(3):
        rgb, truth = draw_pack(toy_assets, rng=np.random.default_rng(seed), config=SMALL)
        assert (rgb.shape, rgb.dtype) == ((126, 224, 3), np.uint8)
        assert rgb.std() > 10
        for thing in truth.objects:
            assert is_rigid(thing.T_camera_part)
            assert 0 <= thing.visible <= 1
            vertices = toy_assets.assembly.parts[thing.name].mesh.vertices
            pixels = project(apply(thing.T_camera_part, vertices), truth.K)
            x, y, width, height = thing.box
            ends = np.array([x, y, x + width - 1, y + height - 1])
            # A sharp corner may cover no pixel's centre.
            assert np.abs(np.r_[pixels.min(axis=0), pixels.max(axis=0)] - ends).max() < 2.5
            seen += thing.visible > 0.95
        for state, members in truth.groups:
            assert [truth.objects[i].name for i in members] == list(state.attached)
    assert seen > 20


def test_rendering_makes_every_tensor_on_the_device_of_its_meshes(toy_assets: Assets) -> None:
    """Tensors without a named device would land on "meta" here, and mix with none on the CPU."""
    expected = draw_pack(toy_assets, rng=np.random.default_rng(4), config=SMALL)[0]
    macro_map.cache_clear()
    micro_map.cache_clear()
    with torch.device("meta"):
        rgb = draw_pack(toy_assets, rng=np.random.default_rng(4), config=SMALL)[0]
    assert np.array_equal(rgb, expected)


def test_the_same_seed_gives_the_same_pack(toy_assets: Assets) -> None:
    a, b, c = (
        draw_pack(toy_assets, rng=np.random.default_rng(seed), config=SMALL)[0]
        for seed in (1, 1, 2)
    )
    assert np.array_equal(a, b)
    assert np.abs(a.astype(int) - c.astype(int)).mean() > 3
