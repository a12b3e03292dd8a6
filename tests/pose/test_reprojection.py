from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.pose.reprojection import minimize_reprojection


def disturbed(T: np.ndarray, *, turn: float, shift: tuple[float, float, float]) -> np.ndarray:
    R = rotation_about(np.array([1.0, -2.0, 0.5]), turn) @ T[:3, :3]
    return transform_from(R, T[:3, 3] + np.array(shift))


def test_it_returns_to_the_true_pose(box_view: Callable) -> None:
    view = box_view()
    start = disturbed(view.T_camera_part, turn=0.3, shift=(0.02, -0.01, 0.08))
    found = minimize_reprojection([start], view.keypoints, view.keypoints_px, view.K, scale_px=5.0)
    assert found is not None
    assert np.abs(found - view.T_camera_part).max() < 1e-4


def test_the_best_of_several_starts_wins(box_view: Callable) -> None:
    view = box_view()
    upside_down = disturbed(view.T_camera_part, turn=np.pi, shift=(0.0, 0.0, 0.0))
    near = disturbed(view.T_camera_part, turn=0.1, shift=(0.0, 0.0, 0.02))
    for starts in ([upside_down, near], [near, upside_down]):
        found = minimize_reprojection(
            starts, view.keypoints, view.keypoints_px, view.K, scale_px=5.0
        )
        assert found is not None
        assert np.abs(found - view.T_camera_part).max() < 1e-4


def test_starts_behind_the_camera_are_dropped(box_view: Callable) -> None:
    view = box_view()
    behind = view.T_camera_part.copy()
    behind[2, 3] *= -1
    near = disturbed(view.T_camera_part, turn=0.1, shift=(0.0, 0.0, 0.02))
    arguments = (view.keypoints, view.keypoints_px, view.K)
    assert minimize_reprojection([behind], *arguments, scale_px=5.0) is None
    assert minimize_reprojection([], *arguments, scale_px=5.0) is None
    assert minimize_reprojection([behind, near], *arguments, scale_px=5.0) is not None


def test_a_wrong_keypoint_is_outvoted(box_view: Callable) -> None:
    view = box_view()
    pixels = view.keypoints_px
    pixels[3] += 80.0
    start = disturbed(view.T_camera_part, turn=0.1, shift=(0.0, 0.0, 0.02))
    found = minimize_reprojection([start], view.keypoints, pixels, view.K, scale_px=2.0)
    assert found is not None
    assert np.abs(found - view.T_camera_part).max() < 2e-3
