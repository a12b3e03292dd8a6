"""Cameras of other image sizes, and hands that hold parts with few corners."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.camera import scaled_intrinsics
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.description import Finish, Placed
from asdfviz.synth.images import TEST_SEEDS, check_seed
from asdfviz.synth.kinect import KINECT, camera_for
from asdfviz.synth.layout import holding_hand


@pytest.mark.parametrize("size", [(640, 480), (1024, 1024), (720, 1280), (96, 64)])
def test_pixels_are_square_at_any_size(size: tuple[int, int]) -> None:
    camera = camera_for(*size)
    fx, fy = camera.K[0, 0], camera.K[1, 1]
    assert fy / fx == pytest.approx(KINECT.K[1, 1] / KINECT.K[0, 0])
    diagonal = np.hypot(*size) / fx
    assert diagonal == pytest.approx(np.hypot(KINECT.width, KINECT.height) / KINECT.K[0, 0])
    # The principal point is as far from the middle, in shares of the focal length.
    middle = (np.array(size) - 1) / 2
    off = (camera.K[:2, 2] - middle) / fx
    full = (np.array([KINECT.width, KINECT.height]) - 1) / 2
    np.testing.assert_allclose(off, (KINECT.K[:2, 2] - full) / KINECT.K[0, 0])


def test_the_same_shape_is_the_whole_view_to_the_last_bit() -> None:
    for width in range(64, 4097, 16):
        height = width * 9 // 16
        whole = scaled_intrinsics(KINECT.K, width / 1280, height / 720)
        np.testing.assert_array_equal(camera_for(width, height).K, whole)


def test_a_hand_holds_a_box_whose_corners_come_once_a_face() -> None:
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners = np.repeat(signs * [0.03, 0.015, 0.01], 3, axis=0)
    assets = object.__new__(Assets)  # of which only the numbers of meshes count here
    object.__setattr__(assets, "hands", range(50))
    object.__setattr__(assets, "sleeves", range(500))
    for seed in range(40):
        placed = holding_hand(assets, corners, np.random.default_rng(seed))
        assert all(np.isfinite(one.T_world_mesh).all() for one in placed)


def test_nothing_is_placed_nowhere() -> None:
    finish = Finish(np.full(3, 0.5))
    assert Placed(0, np.eye(4), finish, "part").name == ""
    with pytest.raises(AssertionError, match="a hand stands nowhere"):
        Placed(0, np.full((4, 4), np.nan), finish, "hand")


def test_seeds_of_test_sets_are_theirs() -> None:
    check_seed(1)
    check_seed(TEST_SEEDS.start, of_test_set=True)
    with pytest.raises(InputError, match="seed 7000000 belongs to test sets"):
        check_seed(TEST_SEEDS.start)
    with pytest.raises(InputError, match="seed is -5, use 0 or more"):
        check_seed(-5, of_test_set=True)


def test_parts_that_are_there_already_are_not_rolled_again(
    toy: Assembly, toy_assets: Assets, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asdfviz.synth.assets.resting_faces", None)
    again = load_assets(toy).resting
    assert all(again[name] is toy_assets.resting[name] for name in toy.parts)
