from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from box_refined import error_mm, refined

from asdfviz.geometry.transforms import transform_from
from asdfviz.pose.translation import TranslationConfig, refine_translation


def slid(T: np.ndarray, shift: float) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] += shift * moved[:3, 3] / np.linalg.norm(moved[:3, 3])
    return moved


@pytest.mark.parametrize("shift", [0.0, 0.01, -0.015, 0.05, -0.06, 0.12, -0.1])
def test_it_meets_the_measured_surface(box_view: Callable, shift: float) -> None:
    view = box_view()
    found = refined(view, slid(view.T_camera_part, shift), view.depth(table=0.68))
    assert error_mm(found, view) < 3.0
    assert found is not None
    assert (found[:3, :3] == view.T_camera_part[:3, :3]).all()


def test_the_part_moves_along_its_viewing_ray(box_view: Callable) -> None:
    view = box_view(position=(0.12, -0.06, 0.6))
    T_off = slid(view.T_camera_part, 0.04)
    found = refined(view, T_off, view.depth(table=0.7))
    assert found is not None
    moved = found[:3, 3] - T_off[:3, 3]
    ray = T_off[:3, 3] / np.linalg.norm(T_off[:3, 3])
    assert abs(moved @ ray) > 0.035
    assert np.linalg.norm(moved - (moved @ ray) * ray) < 0.002


def test_a_wide_first_error_needs_the_coarse_step(box_view: Callable) -> None:
    view = box_view()
    T_off = slid(view.T_camera_part, 0.14)
    depth = view.depth(table=0.68)
    assert error_mm(refined(view, T_off, depth), view) < 3.0
    fine_only = refined(view, T_off, depth, coarse=False, steps=1)
    assert fine_only is None or error_mm(fine_only, view) > 20


def test_a_hand_in_front_is_ignored(box_view: Callable) -> None:
    view = box_view()
    hand = transform_from(np.eye(3), view.T_camera_part[:3, 3] + [-0.02, 0.0, -0.06])
    depth = view.depth(table=0.68, others=((hand, np.array([0.02, 0.1, 0.01])),))
    assert error_mm(refined(view, slid(view.T_camera_part, 0.01), depth), view) < 4.0


def test_noise_holes_and_some_pixels_of_misalignment_are_borne(box_view: Callable) -> None:
    view = box_view()
    rng = np.random.default_rng(3)
    depth = view.depth(table=0.68)
    depth += rng.normal(size=depth.shape).astype(np.float32) * 0.002
    depth[rng.random(depth.shape) < 0.4] = 0
    depth = np.roll(depth, 3, axis=1)
    assert error_mm(refined(view, slid(view.T_camera_part, 0.05), depth), view) < 6.0


def test_without_depth_nothing_is_said(box_view: Callable) -> None:
    view = box_view()
    nothing = np.zeros((360, 640), dtype=np.float32)
    assert refined(view, view.T_camera_part, None) is None
    assert refined(view, view.T_camera_part, nothing) is None
    assert refined(view, view.T_camera_part, view.depth(), enabled=False) is None


def test_depth_that_lies_too_far_away_moves_nothing(box_view: Callable) -> None:
    view = box_view()
    wall = np.full((360, 640), 1.8, dtype=np.float32)
    assert refined(view, view.T_camera_part, wall) is None


def test_a_box_outside_the_image_or_empty_moves_nothing(box_view: Callable) -> None:
    view = box_view()
    for box in ([-90.0, -90, -10, -10], [700, 100, 900, 300], [300, 100, 300, 100]):
        found = refine_translation(
            view.T_camera_part,
            view.surface,
            box_xyxy=np.array(box, dtype=float),
            depth=view.depth(table=0.68),
            K=view.K,
            config=TranslationConfig(),
        )
        assert found is None


def test_the_input_pose_is_not_changed(box_view: Callable) -> None:
    view = box_view()
    T_off = slid(view.T_camera_part, 0.05)
    before = T_off.copy()
    refined(view, T_off, view.depth(table=0.68))
    assert (T_off == before).all()
