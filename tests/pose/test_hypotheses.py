from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from asdfviz.geometry.boxes import middle_of_points
from asdfviz.geometry.camera import project
from asdfviz.geometry.rotation_grid import even_rotations, rotation_of, rotation_to_ray
from asdfviz.geometry.sampling import oriented_surface_points
from asdfviz.geometry.shapes import Rotation
from asdfviz.geometry.transforms import (
    apply,
    inverse,
    rotation_about,
    rotation_angle,
    transform_from,
)
from asdfviz.pose.hypotheses import (
    Candidates,
    HypothesisConfig,
    settle,
)
from asdfviz.pose.hypothesis_kernels import slid
from asdfviz.pose.part_view import PartView, Surface, sampled_depth
from asdfviz.pose.table import SunkConfig, Table

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
SIDE = 40
# An L: no symmetry at all.
BLOCKS = (
    (np.array([0.0, 0, 0]), np.array([0.05, 0.02, 0.012])),
    (np.array([0.035, 0.01, 0.03]), np.array([0.012, 0.01, 0.02])),
)
UNIT = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    dtype=np.int32,
)  # fmt: skip
VERTICES = np.concatenate([UNIT * half + middle for middle, half in BLOCKS])
ALL_FACES = np.concatenate([FACES, FACES + 8])
POINTS, NORMALS = oriented_surface_points(VERTICES, ALL_FACES, 1500)
SURFACE = Surface(POINTS, NORMALS, VERTICES, middle_of_points(VERTICES))
T_TRUE = transform_from(
    rotation_about(np.array([1.0, 0.3, -0.4]), 2.2), np.array([0.08, -0.05, 0.55])
)


def depth_image(T_camera_part: np.ndarray, *, behind: float = 0.7) -> np.ndarray:
    v, u = np.mgrid[:240, :320]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
    T_part_camera = inverse(T_camera_part)
    depth = np.full(u.shape, behind)
    directions = rays @ T_part_camera[:3, :3].T + 1e-12
    for middle, half in BLOCKS:
        a = (middle - half - T_part_camera[:3, 3]) / directions
        b = (middle + half - T_part_camera[:3, 3]) / directions
        enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
        depth = np.where((enter < leave) & (enter > 0), np.minimum(depth, enter), depth)
    return depth.astype(np.float32)


def view(*, with_depth: bool, T_camera_part: np.ndarray = T_TRUE) -> PartView:
    pixels = project(apply(T_camera_part, VERTICES), K)
    box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    middle = (box[:2] + box[2:]) / 2
    R_camera_view = rotation_to_ray(np.linalg.solve(K, np.array([*middle, 1.0])))
    focal = 300.0 * SIDE / (1.25 * float((box[2:] - box[:2]).max()))
    depth = depth_image(T_camera_part)
    seen = sampled_depth(depth, K, R_camera_view, focal=focal, side=SIDE)
    corners = np.array([[*box[:2], 1.0], [*box[2:], 1.0]]) @ np.linalg.inv(K).T @ R_camera_view
    flat = focal * corners[:, :2] / corners[:, 2:] + (SIDE - 1) / 2
    return PartView(
        focal,
        R_camera_view,
        (seen < 0.66).astype(np.float64),
        seen if with_depth else np.zeros((SIDE, SIDE)),
        flat.reshape(4),
    )


def candidates(*, off_deg: float) -> Candidates:
    """Nineteen wrong rotations and, last, one that is near."""
    wrong = [rotation_of(q) for q in even_rotations(400)]
    wrong = [R for R in wrong if rotation_angle(R.T @ T_TRUE[:3, :3]) > np.deg2rad(40)][::20][:19]
    near = rotation_about(np.array([0.2, -1.0, 0.5]), np.deg2rad(off_deg)) @ T_TRUE[:3, :3]
    return rotations(*wrong, near)


def rotations(*Rs: Rotation, probability: float = 0.05) -> Candidates:
    return Candidates(np.stack(Rs), np.full(len(Rs), probability), np.full(len(Rs), np.nan))


def some(of: Candidates, which: slice) -> Candidates:
    return Candidates(of.Rs_camera_part[which], of.probabilities[which], of.distances[which])


def error_deg(T: np.ndarray) -> float:
    return float(np.degrees(rotation_angle(T[:3, :3].T @ T_TRUE[:3, :3])))


def test_depth_and_outline_find_and_refine_the_near_rotation() -> None:
    settled, *others = settle(
        candidates(off_deg=10), SURFACE, view(with_depth=True), config=HypothesisConfig()
    )
    assert others
    assert settled.likely == 1
    assert settled.refined
    assert error_deg(settled.T_camera_part) < 4
    assert np.linalg.norm(settled.T_camera_part[:3, 3] - T_TRUE[:3, 3]) < 0.004
    assert 0.6 < settled.agreement <= 1


def test_a_box_that_is_off_does_not_move_what_lies_flat() -> None:
    T_flat = transform_from(np.eye(3), np.array([0.02, -0.01, 0.5]))
    seen = view(with_depth=True, T_camera_part=T_flat)
    turned = rotation_about(np.array([0.0, 0.0, 1.0]), np.deg2rad(4))
    found: list[tuple[float, float]] = []
    for x, y in product((1.6, 2.0, 2.4), (-1.5, 1.5)):
        off = replace(seen, box_xyxy=seen.box_xyxy + np.array([x, y, x, y]))
        T = settle(rotations(turned), SURFACE, off, config=HypothesisConfig())[0].T_camera_part
        shift = float(np.linalg.norm(T[:3, 3] - T_flat[:3, 3]))
        found.append((shift, float(np.degrees(rotation_angle(T[:3, :3])))))
    shift, turn = np.mean(found, axis=0)
    assert shift < 0.002
    assert turn < 2


def test_a_part_slides_along_the_ray_of_its_middle_wherever_its_origin_is() -> None:
    here = view(with_depth=True)
    T_off = transform_from(here.R_camera_view.T, np.zeros(3)) @ T_TRUE
    T_off[:3, 3] *= 1.05
    found: list[np.ndarray] = []
    for along_z in (0.0, 2.0, -2.0):  # of the last two one lies behind the camera
        away = transform_from(np.eye(3), np.array([0.3, 0.0, along_z]) * abs(np.sign(along_z)))
        (moved,) = slid(
            apply(away, POINTS),
            (T_off @ inverse(away))[None],
            here.focal,
            here.outline,
            here.measured,
            0.25,
            away[:3, 3],
        )
        found.append(moved @ away)
    assert np.linalg.norm(here.R_camera_view @ found[0][:3, 3] - T_TRUE[:3, 3]) < 0.004
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)
    np.testing.assert_allclose(found[2], found[0], atol=1e-9)


def test_the_outline_alone_finds_it_too() -> None:
    settled, *_ = settle(
        candidates(off_deg=8), SURFACE, view(with_depth=False), config=HypothesisConfig()
    )
    assert not settled.refined
    assert error_deg(settled.T_camera_part) < 12
    assert np.linalg.norm(settled.T_camera_part[:3, 3] - T_TRUE[:3, 3]) < 0.03


def test_a_pose_in_the_table_loses_to_one_on_it() -> None:
    here, config = view(with_depth=False), HypothesisConfig(prior_weight=0.0)
    wrong = some(candidates(off_deg=10), slice(-1))

    def deepest(seen: PartView, sunk: SunkConfig | None) -> float:
        settled, *_ = settle(wrong, SURFACE, seen, config=config, sunk=sunk)
        T_view_part = here.R_camera_view.T @ settled.T_camera_part[:3]
        return float((VERTICES @ T_view_part[:, :3].T + T_view_part[:, 3])[:, 2].max())

    told = SunkConfig(weight=2.0)
    free = deepest(here, None)
    table = Table(np.array([0.0, 0.0, -1.0]), free - 0.02)
    assert deepest(replace(here, table=table), None) == free
    assert deepest(here, told) == free
    assert deepest(replace(here, table=table), told) < free - 0.005


def test_a_probable_rotation_wins_among_equals() -> None:
    here, config = view(with_depth=False), HypothesisConfig()
    near = candidates(off_deg=0).Rs_camera_part[-1]
    twin = rotation_about(np.array([0.0, 0, 1]), 0.02) @ near
    both = replace(rotations(twin, near), probabilities=np.array([0.001, 0.9]))
    settled, *_ = settle(both, SURFACE, here, config=config)
    assert error_deg(settled.T_camera_part) < 8


def test_nothing_is_said_where_nothing_agrees() -> None:
    empty = replace(view(with_depth=False), outline=np.zeros((SIDE, SIDE)))
    assert settle(candidates(off_deg=5), SURFACE, empty, config=HypothesisConfig()) == []
    assert (
        settle(some(candidates(off_deg=5), slice(0)), SURFACE, empty, config=HypothesisConfig())
        == []
    )


def test_a_wrong_pose_agrees_less() -> None:
    here, config = view(with_depth=True), HypothesisConfig(steps=0)
    right = settle(some(candidates(off_deg=0), slice(-1, None)), SURFACE, here, config=config)
    wrong = settle(some(candidates(off_deg=0), slice(1)), SURFACE, here, config=config)
    assert right
    assert not wrong or wrong[0].agreement < 0.75 * right[0].agreement


def test_readings_are_taken_along_the_view() -> None:
    depth = np.full((240, 320), 0.8, np.float32)
    depth[:, :160] = 0.0
    R = rotation_to_ray(np.array([0.2, 0.0, 1.0]))
    seen = sampled_depth(depth, K, R, focal=200.0, side=9)
    v, u = 4, 4
    assert seen[v, u] == pytest.approx(0.8 * np.hypot(1, 0.2), rel=1e-2)
    beyond = sampled_depth(depth, K, rotation_to_ray(np.array([2.0, 0, 1.0])), focal=200.0, side=9)
    assert not beyond.any()
