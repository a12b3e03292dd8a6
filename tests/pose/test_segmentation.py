from __future__ import annotations

from collections.abc import Callable

import numpy as np
from box_refined import error_mm, refined

from asdfviz.geometry.boxes import BoxMask
from asdfviz.geometry.transforms import transform_from
from asdfviz.pose.segmentation import refine_in_mask
from asdfviz.pose.translation import TranslationConfig


def slid(T: np.ndarray, shift: float) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] += shift * moved[:3, 3] / np.linalg.norm(moved[:3, 3])
    return moved


def mask_of(view, shown: np.ndarray) -> BoxMask:
    """Of the pixels that show the part, those of its box."""
    left, top = np.ceil(view.box_xyxy[:2]).astype(int)
    right, bottom = np.floor(view.box_xyxy[2:]).astype(int)
    return BoxMask(int(left), int(top), shown[top : bottom + 1, left : right + 1])


def in_mask(view, T_camera_part, depth, mask):
    return refine_in_mask(
        T_camera_part,
        view.surface,
        mask=mask,
        box_xyxy=view.box_xyxy,
        depth=depth,
        K=view.K,
        config=TranslationConfig(),
    )


def test_what_stands_in_front_pulls_the_box_and_not_the_mask(box_view: Callable) -> None:
    view = box_view()
    alone = view.depth(table=0.68)
    # A plate with the part's own tilt, 40 mm nearer, over three quarters of it.
    plate = view.T_camera_part.copy()
    plate[:3, 3] += [-0.015, -0.004, -0.04]
    depth = view.depth(table=0.68, others=((plate, np.array([0.05, 0.04, 0.004])),))
    shown = (depth == alone) & (alone < 0.67)
    mask = mask_of(view, shown)
    assert 0.05 < mask.pixels.mean() < 0.5
    T_off = slid(view.T_camera_part, -0.012)
    assert error_mm(in_mask(view, T_off, depth, mask), view) < 3.0
    assert error_mm(refined(view, T_off, depth), view) > 15.0


def test_the_rotation_stays_and_the_shift_is_along_the_ray(box_view: Callable) -> None:
    view = box_view(position=(0.12, -0.06, 0.6))
    depth = view.depth(table=0.7)
    T_off = slid(view.T_camera_part, 0.04)
    found = in_mask(view, T_off, depth, mask_of(view, depth < 0.69))
    assert found is not None
    assert error_mm(found, view) < 3.0
    assert (found[:3, :3] == T_off[:3, :3]).all()
    moved, ray = found[:3, 3] - T_off[:3, 3], T_off[:3, 3] / np.linalg.norm(T_off[:3, 3])
    assert np.linalg.norm(moved - (moved @ ray) * ray) < 0.002


def test_a_mask_of_everything_says_what_the_box_says(box_view: Callable) -> None:
    view = box_view()
    hand = transform_from(np.eye(3), view.T_camera_part[:3, 3] + [-0.02, 0.0, -0.06])
    depth = view.depth(table=0.68, others=((hand, np.array([0.02, 0.1, 0.01])),))
    T_off = slid(view.T_camera_part, 0.02)
    everything = BoxMask(0, 0, np.ones(depth.shape, bool))
    same = refined(view, T_off, depth, coarse_area=1.0)
    found = in_mask(view, T_off, depth, everything)
    assert same is not None
    assert found is not None
    np.testing.assert_allclose(found, same, atol=1e-12)


def test_pixels_beside_an_edge_do_not_count_at_the_rim_of_a_mask(box_view: Callable) -> None:
    """Flying pixels: without the outside to tell them by, a mask of them alone would be believed."""
    view = box_view()
    depth = view.depth(table=0.68)
    on_part = (depth < 0.67).astype(np.uint8)
    import cv2

    rim = (on_part - cv2.erode(on_part, np.ones((3, 3), np.uint8))).astype(bool)
    flying = np.where(rim, depth + np.float32(0.03), depth)
    assert in_mask(view, view.T_camera_part, flying, mask_of(view, rim)) is None


def test_without_mask_or_depth_nothing_is_said(box_view: Callable) -> None:
    view = box_view()
    depth = view.depth(table=0.68)
    mask = mask_of(view, depth < 0.67)
    assert in_mask(view, view.T_camera_part, None, mask) is None
    assert in_mask(view, view.T_camera_part, depth, None) is None
    empty = BoxMask(mask.left, mask.top, np.zeros_like(mask.pixels))
    assert in_mask(view, view.T_camera_part, depth, empty) is None
