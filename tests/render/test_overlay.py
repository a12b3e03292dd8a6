from __future__ import annotations

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.render.overlay import draw_outlines, draw_overlay
from asdfviz.render.renderer import Renderer


def at(x: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, 0, z
    return T


@pytest.fixture
def rgb() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 255, (120, 160, 3)).astype(np.uint8)


def test_without_poses_the_picture_is_unchanged(
    renderer: Renderer, assembly: Assembly, K: np.ndarray, rgb: np.ndarray
) -> None:
    drawn = draw_overlay(rgb, {}, assembly, K, renderer=renderer)
    np.testing.assert_array_equal(drawn, rgb)
    assert drawn is not rgb


def test_changes_only_where_the_part_is(
    renderer: Renderer, assembly: Assembly, K: np.ndarray, rgb: np.ndarray
) -> None:
    before = rgb.copy()
    drawn = draw_overlay(rgb, {"red": at(0, 0.4)}, assembly, K, renderer=renderer, outline_px=2)
    np.testing.assert_array_equal(rgb, before)
    _, ids = renderer.depth_and_ids([assembly.parts["red"].mesh], [at(0, 0.4)], K)
    near = cv2.dilate((ids >= 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    changed = (drawn != rgb).any(axis=2)
    assert not changed[~near].any()
    assert changed[ids >= 0].mean() > 0.99


@pytest.mark.parametrize("opacity", [0.0, 0.25, 0.5, 1.0])
def test_opacity_mixes_picture_and_part(
    renderer: Renderer, assembly: Assembly, K: np.ndarray, rgb: np.ndarray, opacity: float
) -> None:
    part, T = assembly.parts["red"], at(0, 0.4)
    drawn = draw_overlay(
        rgb, {"red": T}, assembly, K, renderer=renderer, opacity=opacity, outline_px=0
    )
    _, ids = renderer.depth_and_ids([part.mesh], [T], K)
    shaded = renderer.color([part.mesh], [T], [part.color], K, antialias=False)
    expected = (1 - opacity) * rgb[ids >= 0] + opacity * shaded[ids >= 0]
    assert np.abs(drawn[ids >= 0] - expected).max() <= 0.5
    np.testing.assert_array_equal(drawn[ids < 0], rgb[ids < 0])


def test_a_black_part_shows_on_black(renderer: Renderer, assembly: Assembly, K: np.ndarray) -> None:
    dark = np.zeros((120, 160, 3), dtype=np.uint8)
    drawn = draw_overlay(
        dark, {"black": at(0, 0.4)}, assembly, K, renderer=renderer, outline_px=0, opacity=1.0
    )
    assert drawn[56, 83].max() > 40


def test_colors_can_be_chosen(
    renderer: Renderer, assembly: Assembly, K: np.ndarray, rgb: np.ndarray
) -> None:
    green = {"red": np.array([0, 200, 0], dtype=np.uint8)}
    drawn = draw_overlay(
        rgb, {"red": at(0, 0.4)}, assembly, K, renderer=renderer, opacity=1.0, colors=green
    )
    assert drawn[56, 83, 1] > 3 * drawn[56, 83, 0]


def test_a_part_the_assembly_does_not_know_is_left_out(
    renderer: Renderer, assembly: Assembly, K: np.ndarray, rgb: np.ndarray
) -> None:
    drawn = draw_overlay(rgb, {"cup": at(0, 0.4)}, assembly, K, renderer=renderer)
    np.testing.assert_array_equal(drawn, rgb)


def test_outlines_follow_holes_too() -> None:
    ids = np.full((60, 60), -1, dtype=np.int32)
    ids[10:50, 10:50] = 0
    ids[25:35, 25:35] = -1
    red = [np.array([255, 0, 0], dtype=np.uint8)]
    drawn = draw_outlines(np.zeros((60, 60, 3), dtype=np.uint8), ids, red, width_px=1)
    assert drawn[9:12, 30, 0].max() > 200
    assert drawn[23:26, 30, 0].max() > 200
    assert (drawn[30, 30] == 0).all()
    assert (drawn[15, 15] == 0).all()
