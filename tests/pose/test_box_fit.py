from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.transforms import apply
from asdfviz.pose.box_fit import BoxFitConfig, fit_to_box

SIZE = (640, 360)


def slid(T: np.ndarray, factor: float) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] *= factor
    return moved


def middle(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2


def test_hull_corners_span_the_part_from_every_side(box_view: Callable) -> None:
    rng = np.random.default_rng(4)
    inside = rng.uniform(-0.9, 0.9, (500, 3)) * [0.05, 0.03, 0.015]
    vertices = np.concatenate([inside, box_view().corners])
    kept = hull_corners(vertices)
    assert len(kept) == 8
    assert {tuple(p) for p in kept} == {tuple(p) for p in box_view().corners}


@pytest.mark.parametrize("factor", [0.6, 1.6, 3.0])
def test_a_wrong_distance_is_corrected_along_the_ray(box_view: Callable, factor: float) -> None:
    view = box_view()
    fitted = fit_to_box(
        slid(view.T_camera_part, factor),
        view.corners,
        box_xyxy=view.box_xyxy,
        K=view.K,
        size_wh=SIZE,
        config=BoxFitConfig(),
    )
    offset = np.linalg.norm(fitted[:3, 3] - view.T_camera_part[:3, 3])
    assert offset < 0.03 * view.T_camera_part[2, 3]
    assert (fitted[:3, :3] == view.T_camera_part[:3, :3]).all()


def test_the_part_keeps_its_place_in_the_image_wherever_its_frame_lies(box_view: Callable) -> None:
    view = box_view()
    corners = view.corners + np.array([0.3, 0.0, 0.0])  # a CAD frame far outside the part
    T_far = view.T_camera_part.copy()
    T_far[:3, 3] += 0.5 * middle(apply(T_far, corners))
    before = project(middle(apply(T_far, corners))[None], view.K)
    box = project(apply(view.T_camera_part, corners), view.K)
    fitted = fit_to_box(
        T_far,
        corners,
        box_xyxy=np.concatenate([box.min(axis=0), box.max(axis=0)]),
        K=view.K,
        size_wh=(2000, 2000),
        config=BoxFitConfig(border_px=-1000.0),
    )
    after = project(middle(apply(fitted, corners))[None], view.K)
    assert np.abs(after - before).max() < 1e-6
    assert np.linalg.norm(fitted[:3, 3] - view.T_camera_part[:3, 3]) < 0.02


@pytest.mark.parametrize(
    ("factor", "config", "cut_off"),
    [
        (1.1, BoxFitConfig(), False),
        (3.0, BoxFitConfig(enabled=False), False),
        (3.0, BoxFitConfig(), True),
    ],
    ids=["sizes agree", "switched off", "box cut off by the border"],
)
def test_where_the_pose_stays(box_view: Callable, factor, config, cut_off) -> None:
    view = box_view()
    T_camera_part = slid(view.T_camera_part, factor)
    box = view.box_xyxy
    if cut_off:
        box[0] = 0.0
    fitted = fit_to_box(
        T_camera_part, view.corners, box_xyxy=box, K=view.K, size_wh=SIZE, config=config
    )
    assert (fitted == T_camera_part).all()
