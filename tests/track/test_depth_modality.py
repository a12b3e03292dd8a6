from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Camera, Frame
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance, rotation_about, transform_from
from asdfviz.track import depth_kernels
from asdfviz.track.bodies import Body
from asdfviz.track.depth_modality import DepthConfig, DepthModality
from asdfviz.track.optimizer import move
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.tracker import Tracker
from asdfviz.track.visibility import occluded

Draw = Callable[[Mapping[str, Body], Mapping[str, Transform], int], Frame]

T = transform_from(rotation_about(np.array([0.3, -0.8, 0.2]), 0.7), np.array([0.02, -0.03, 0.5]))
LENS = np.array([300.0, 310.0, 79.5, 59.5])


def matches(count: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.05, 0.05, (count, 3))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    measured = points @ T[:3, :3].T + T[:3, 3] + rng.normal(0, 0.005, (count, 3))
    return np.concatenate([points, normals, measured], axis=1)


def test_gradient_is_that_of_the_weighted_squares() -> None:
    found = matches(12)

    def log_likelihood(theta: np.ndarray) -> float:
        T_new = T.copy()
        move(T_new, theta)
        total = 0.0
        for match in found:
            distance = depth_kernels.plane_distance(match, T_new, np.zeros(6))
            total -= 0.5 * (distance / (0.03 * match[8])) ** 2
        return total

    gradient, hessian = np.zeros(6), np.zeros((6, 6))
    depth_kernels.add_matches(found, 12, T, 0.03, gradient, hessian)
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-6
        numeric = (log_likelihood(step) - log_likelihood(-step)) / 2e-6
        assert gradient[i] == pytest.approx(numeric, rel=1e-5, abs=1e-5)
    assert np.linalg.eigvalsh(hessian + np.tril(hessian, -1).T).min() > -1e-6


def test_a_newton_step_on_exact_matches_of_a_moved_part_moves_it_back() -> None:
    found = matches(200)
    theta = np.array([0.02, -0.01, 0.015, 0.003, -0.002, 0.004])
    T_moved = T.copy()
    move(T_moved, theta)
    found[:, 6:9] = found[:, :3] @ T_moved[:3, :3].T + T_moved[:3, 3]
    gradient, hessian = np.zeros(6), np.zeros((6, 6))
    depth_kernels.add_matches(found, 200, T, 0.03, gradient, hessian)
    step = np.linalg.solve(hessian + np.tril(hessian, -1).T, gradient)
    np.testing.assert_allclose(step, theta, atol=6e-4)


def test_nearest_point_equals_a_full_search_where_the_grid_is_full() -> None:
    rng = np.random.default_rng(2)
    depth = rng.uniform(0.45, 0.55, (120, 160)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.3] = 0.0
    v, u = np.nonzero(depth)
    z = depth[v, u].astype(np.float64)
    points = np.stack([(u - LENS[2]) * z / LENS[0], (v - LENS[3]) * z / LENS[1], z], axis=1)
    for target in rng.uniform([-0.08, -0.05, 0.47], [0.08, 0.05, 0.53], (30, 3)):
        out = np.zeros(3)
        # A stride of half a millimetre is less than a pixel here, so every pixel is tried.
        assert depth_kernels.nearest_point(depth, LENS, *target, 0.02, 0.0005, out)
        distances = np.linalg.norm(points - target, axis=1)
        assert np.linalg.norm(out - target) == pytest.approx(distances.min(), rel=1e-5)


def test_no_point_within_reach_is_no_match() -> None:
    depth = np.full((120, 160), 0.9, np.float32)
    out = np.zeros(3)
    assert not depth_kernels.nearest_point(depth, LENS, 0.0, 0.0, 0.5, 0.05, 0.005, out)
    assert not depth_kernels.nearest_point(
        np.zeros_like(depth), LENS, 0.0, 0.0, 0.5, 0.05, 0.005, out
    )
    assert not depth_kernels.nearest_point(depth, LENS, 5.0, 0.0, 0.9, 0.05, 0.005, out)


@pytest.mark.parametrize(("u", "expected"), [(40, False), (76, True), (84, True), (100, False)])
def test_nearer_depth_within_the_radius_occludes(u: int, expected: bool) -> None:
    depth = np.full((120, 160), 0.6, np.float32)
    depth[:, 80] = 0.4
    assert occluded(depth, float(u), 60.0, 0.5, 4.0) == expected
    depth[:, 80] = 0.0
    assert not occluded(depth, float(u), 60.0, 0.5, 4.0)


def test_other_parts_and_hands_leave_points_out() -> None:
    depth = np.full((120, 160), 0.5, np.float32)
    points = np.array([[x, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0] for x in (-0.1, 0.1)], np.float32)
    T_front = transform_from(np.eye(3), np.array([0.0, 0.0, 0.5]))
    ids = np.zeros((120, 160), np.int32)
    out = np.zeros((2, depth_kernels.MATCH_COLUMNS))

    def count(hide: bool, ids: np.ndarray, depth: np.ndarray) -> int:
        return depth_kernels.find_matches(
            depth, points, 2, T_front, LENS, np.array([0.02, 0.005]), False, 0.0,
            hide, np.zeros(2, np.float32), np.array([0.01, 0.03]), ids, np.array([0.0, 0.0, 1.0]), 0, out,
        )  # fmt: skip

    assert count(False, ids, depth) == 2
    ids[:, 80:] = 1
    assert count(False, ids, depth) == 1
    hand = depth.copy()
    hand[:, 60:] = np.where(np.arange(60, 160) % 2 == 0, 0.3, 0.5)
    none = np.zeros((0, 0), np.int32)
    assert count(False, none, hand) == 2
    assert count(True, none, hand) == 1


def smeared(frame: Frame, sigma_px: float) -> Frame:
    """As sensors see depth: edges drawn out into what lies behind."""
    assert frame.depth is not None
    return replace(frame, depth=cv2.GaussianBlur(frame.depth, (0, 0), sigma_px))


def test_smeared_edges_do_not_push_a_part_back(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    T = box_poses[0]
    frame = smeared(draw({"box": box_body}, {"box": T}, 0), 2.0)
    middle = box_body.model.centre
    off: dict[float, float] = {}
    for edge_px in (0.0, 4.0):
        config = TrackerConfig(region=None, depth=DepthConfig(edge_px=edge_px, stride=0.002))
        tracker = Tracker({"box": box_body}, camera, config)
        tracker.start(frame, {"box": T})
        for _ in range(3):
            tracker.update(frame)
        off[edge_px] = point_distance(tracker.poses["box"], T, middle)
    assert off[4.0] < 0.5 * off[0.0]
    assert off[4.0] < 1.5e-3


@pytest.mark.parametrize(("edge_px", "share"), [(0.0, 1.0), (4.0, 0.8), (1000.0, 0.25)])
def test_the_middle_of_a_part_stays_however_thin_it_is_and_weighs_as_much(
    box_body: Body,
    box_poses: list[Transform],
    draw: Draw,
    edge_px: float,
    share: float,
) -> None:
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    assert frame.depth is not None
    T = box_poses[0].copy()
    T[:3, 3] += T[:3, :3] @ box_body.model.centre
    K = frame.camera.K
    modality = DepthModality(
        box_body.model, np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]), DepthConfig(edge_px=edge_px)
    )
    views = box_body.model.views(T)
    modality.calculate_correspondences(frame.depth, T, views=views, iteration=0)
    assert modality.count == pytest.approx(share * modality.wanted, abs=0.15 * modality.wanted)
    gradient, hessian = np.zeros(6), np.zeros((6, 6))
    modality.calculate_gradient_and_hessian(T, gradient=gradient, hessian=hessian)
    whole = 200 / (0.05 * T[2, 3]) ** 2
    # Along the line of sight, which all faces that show lean against.
    z = T[2, :3]
    full = hessian + np.tril(hessian, -1).T
    assert 0.3 * whole < z @ full[3:, 3:] @ z < 1.1 * whole


@pytest.mark.parametrize("sigmas", [(), (0.05, 0.0), (0.05, float("nan"))])
def test_spreads_that_weigh_nothing_are_refused(sigmas: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"sigmas are .*: give one or more, all above 0"):
        DepthConfig(sigmas=sigmas)


@pytest.mark.parametrize(
    ("edge_px", "edge_share"), [(-1.0, 0.5), (float("nan"), 0.5), (3.0, 1.0), (3.0, -0.1)]
)
def test_options_that_would_leave_no_point_are_refused(edge_px: float, edge_share: float) -> None:
    with pytest.raises(InputError, match="edge_"):
        DepthConfig(edge_px=edge_px, edge_share=edge_share)
