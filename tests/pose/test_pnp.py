from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, is_rigid, rotation_angle
from asdfviz.pose.pnp import ROBUST_PNP, PnpConfig, mirrored_twin, solve_pnp

CONFIGS = [pytest.param(PnpConfig(), id="ransac"), pytest.param(ROBUST_PNP, id="robust")]


def turn_deg(T_a: np.ndarray, T_b: np.ndarray) -> float:
    return float(np.degrees(rotation_angle(T_a[:3, :3].T @ T_b[:3, :3])))


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0), (0.9, 0.4, -0.5), (2.0, -1.5, 0.3)])
def test_exact_keypoints_give_the_exact_pose(box_view: Callable, config, rotation) -> None:
    view = box_view(rotation=rotation)
    found = solve_pnp(view.keypoints, view.keypoints_px, view.K, config=config, image_width=640)
    assert found is not None
    assert found.inliers == 17
    assert found.reprojection_px < 0.01
    assert np.abs(found.T_camera_part - view.T_camera_part).max() < 1e-3
    assert is_rigid(found.T_camera_part, tolerance=1e-9)


@pytest.mark.parametrize("config", CONFIGS)
def test_three_wild_keypoints_do_not_matter(box_view: Callable, config) -> None:
    view = box_view()
    pixels = view.keypoints_px
    pixels[[2, 7, 11]] += [[60, -45], [-50, 40], [0, 70]]
    found = solve_pnp(view.keypoints, pixels, view.K, config=config, image_width=640)
    assert found is not None
    assert found.inliers == 14
    assert np.abs(found.T_camera_part - view.T_camera_part).max() < 5e-3


def test_robust_is_nearer_than_ransac_on_noisy_keypoints(box_view: Callable) -> None:
    rng = np.random.default_rng(5)
    errors: dict[str, list[float]] = {"ransac": [], "robust": []}
    for _ in range(25):
        view = box_view(rotation=tuple(rng.uniform(-2, 2, 3)))
        pixels = view.keypoints_px + rng.normal(size=(17, 2)) * rng.uniform(0.5, 4, (17, 1))
        pixels[rng.choice(17, 3, replace=False)] += rng.uniform(-30, 30, (3, 2))
        for name, config in (("ransac", PnpConfig()), ("robust", ROBUST_PNP)):
            found = solve_pnp(view.keypoints, pixels, view.K, config=config, image_width=640)
            assert found is not None
            offset = found.T_camera_part[:3, 3] - view.T_camera_part[:3, 3]
            errors[name].append(float(np.linalg.norm(offset)))
    assert np.median(errors["robust"]) < np.median(errors["ransac"])
    assert np.median(errors["robust"]) < 0.02


def test_scores_tell_the_robust_solver_whom_to_trust(box_view: Callable) -> None:
    view = box_view()
    rng = np.random.default_rng(2)
    pixels, scores = view.keypoints_px, np.ones(17)
    doubtful = rng.choice(17, 8, replace=False)
    pixels[doubtful] += rng.normal(size=(8, 2)) * 5
    scores[doubtful] = 0.05
    blind = solve_pnp(view.keypoints, pixels, view.K, config=ROBUST_PNP)
    told = solve_pnp(view.keypoints, pixels, view.K, config=ROBUST_PNP, scores=scores)
    assert blind is not None
    assert told is not None

    def error(T: np.ndarray) -> float:
        return float(np.linalg.norm(T[:3, 3] - view.T_camera_part[:3, 3]))

    assert error(told.T_camera_part) < 0.5 * error(blind.T_camera_part)


@pytest.mark.parametrize("config", CONFIGS)
def test_collapsed_keypoints_give_no_pose(box_view: Callable, config) -> None:
    view = box_view()
    center = view.keypoints_px.mean(axis=0)
    shrunken = center + 0.2 * (view.keypoints_px - center)
    found = solve_pnp(view.keypoints, shrunken, view.K, config=config, box_xyxy=view.box_xyxy)
    assert found is None


@pytest.mark.parametrize("config", CONFIGS)
def test_keypoints_that_agree_on_nothing_give_no_pose(box_view: Callable, config) -> None:
    view = box_view()
    rng = np.random.default_rng(0)
    scattered = rng.uniform([0, 0], [640, 360], (17, 2))
    assert solve_pnp(view.keypoints, scattered, view.K, config=PnpConfig(min_inliers=10)) is None


def test_a_pose_too_far_or_too_near_is_not_found(box_view: Callable) -> None:
    view = box_view()
    too_far = PnpConfig(farthest=0.5)
    too_near = PnpConfig(nearest=0.7)
    for config in (too_far, too_near):
        assert solve_pnp(view.keypoints, view.keypoints_px, view.K, config=config) is None


@pytest.mark.parametrize("config", CONFIGS)
def test_keypoints_that_were_not_seen_are_left_out(box_view: Callable, config) -> None:
    view = box_view()
    pixels = view.keypoints_px
    pixels[:5] = np.nan
    found = solve_pnp(view.keypoints, pixels, view.K, config=config, scores=np.ones(17))
    assert found is not None
    assert found.inliers == 12
    pixels[:13] = np.nan
    assert solve_pnp(view.keypoints, pixels, view.K, config=config) is None


def test_the_threshold_of_the_paper_scales_with_the_image(box_view: Callable) -> None:
    view = box_view()
    pixels = view.keypoints_px
    pixels[::2] += 5.0
    pixels[1::2] -= 5.0
    wide = solve_pnp(view.keypoints, pixels, view.K, config=PnpConfig(), image_width=1280)
    narrow = solve_pnp(view.keypoints, pixels, view.K, config=PnpConfig(), image_width=320)
    assert wide is not None
    assert wide.inliers == 17
    assert narrow is None or narrow.inliers < 17


def test_the_mirrored_twin_of_a_plane_looks_nearly_the_same(box_view: Callable) -> None:
    view = box_view(half=(0.05, 0.03, 0.0001), rotation=(0.6, 0.3, 0.0), position=(0.1, 0.05, 0.9))
    normal, middle = np.array([0.0, 0.0, 1.0]), view.keypoints.mean(axis=0)
    T_twin = mirrored_twin(view.T_camera_part, middle, normal)
    assert is_rigid(T_twin, tolerance=1e-9)
    assert turn_deg(T_twin, view.T_camera_part) > 60
    twin_px = project(apply(T_twin, view.keypoints), view.K)
    assert np.linalg.norm(twin_px - view.keypoints_px, axis=1).max() < 4.0


def test_the_robust_solver_finds_the_right_tilt_of_a_plane(box_view: Callable) -> None:
    rng = np.random.default_rng(7)
    right = 0
    for _ in range(20):
        view = box_view(half=(0.06, 0.04, 0.001), rotation=(*rng.uniform(0.4, 0.9, 2), 0.3))
        pixels = view.keypoints_px + rng.normal(size=(17, 2)) * 0.5
        found = solve_pnp(view.keypoints, pixels, view.K, config=ROBUST_PNP)
        assert found is not None
        right += turn_deg(found.T_camera_part, view.T_camera_part) < 20
    assert right >= 18
