"""The pose of a joined group from the keypoints of all its parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import rotation_angle, transform_from
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.pooled_keypoints import PooledKeypoints
from asdfviz.pose.pnp import ROBUST_PNP, solve_pnp
from asdfviz.pose.translation import TranslationConfig
from tests.methods.test_group_poses import SURE, estimate


def pooled_of(assembly) -> PooledKeypoints:
    shapes = part_shapes(assembly, surface_points=900)
    return PooledKeypoints(assembly, shapes, ROBUST_PNP, TranslationConfig())


def places(toy):
    return toy.assembly.states[1].T_base_part


def turned_deg(T_a: np.ndarray, T_b: np.ndarray) -> float:
    return float(np.rad2deg(rotation_angle(T_a[:3, :3].T @ T_b[:3, :3])))


def test_exact_keypoints_give_the_exact_pose(toy) -> None:
    true = toy.poses(joined=True)
    found = {name: toy.detection(name, T) for name, T in true.items()}
    base = pooled_of(toy.assembly).base(places(toy), found=found, frame=toy.frame(1))
    assert base is not None
    assert (base.part, base.stage) == ("base", "group")
    assert base.score == pytest.approx(0.8)
    assert np.allclose(base.T_camera_part, true["base"], atol=1e-4)


def test_many_noisy_keypoints_tell_more_than_few(toy) -> None:
    true, alone, together = toy.poses(joined=True), list[float](), list[float]()
    for seed in range(12):
        found = {
            name: toy.detection(name, T, noise_px=2.0, seed=7 * seed + k)
            for k, (name, T) in enumerate(true.items())
        }
        base = pooled_of(toy.assembly).base(places(toy), found=found, frame=toy.frame(1))
        own = solve_pnp(
            toy.assembly.parts["base"].keypoints,
            found["base"].keypoints_px,
            toy.frame(1).camera.K,
            config=ROBUST_PNP,
            box_xyxy=found["base"].box_xyxy,
        )
        assert base is not None
        assert own is not None
        together.append(turned_deg(base.T_camera_part, true["base"]))
        alone.append(turned_deg(own.T_camera_part, true["base"]))
    assert np.mean(together) < 0.9 * np.mean(alone)


def test_depth_corrects_the_distance(toy) -> None:
    """Keypoints of boxes that are too small put the group too far away."""
    true = toy.poses(joined=True)
    farther = {name: transform_from(T[:3, :3], T[:3, 3] * 1.05) for name, T in true.items()}
    found = {name: toy.detection(name, T) for name, T in farther.items()}
    pooled = pooled_of(toy.assembly)
    without = pooled.base(places(toy), found=found, frame=toy.frame(1))
    base = pooled.base(places(toy), found=found, frame=toy.frame(1, true))
    assert without is not None
    assert base is not None
    off = [np.linalg.norm(p.T_camera_part[:3, 3] - true["base"][:3, 3]) for p in (without, base)]
    assert off[0] > 0.02
    assert off[1] < 0.006


def test_nothing_is_pooled_of_one_part(toy) -> None:
    true, pooled = toy.poses(joined=True), pooled_of(toy.assembly)
    found = {"block": toy.detection("block", true["block"])}
    assert pooled.base(places(toy), found=found, frame=toy.frame(1, true)) is None
    both = {**found, "base": toy.detection("base", true["base"])}
    parts = dict(toy.assembly.parts)
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    parts["block"] = replace(parts["block"], symmetries=Symmetries(discrete=(half_turn,)))
    alike = pooled_of(replace(toy.assembly, parts=parts))
    assert pooled.base(places(toy), found=both, frame=toy.frame(1, true)) is not None
    assert alike.base(places(toy), found=both, frame=toy.frame(1, true)) is None


@pytest.mark.parametrize("pooled", [True, False])
def test_the_group_is_where_all_its_keypoints_put_it(toy, *, pooled: bool) -> None:
    """Each part's own keypoints have it askew; together they do not."""
    true = toy.poses(joined=True)
    askew = transform_from(np.eye(3), np.array([0.012, 0.0, 0.0])) @ true["base"]
    poses = {"base": estimate("base", askew)}
    found = {name: toy.detection(name, T) for name, T in true.items()}
    shapes = part_shapes(toy.assembly, surface_points=900)
    group = GroupPoses(toy.assembly, shapes, config=GroupConfig(pooled=pooled))
    frame, keypoints = toy.frame(1, true), pooled_of(toy.assembly)
    placed = group.step(
        poses, SURE, frame, pooled=lambda Ts: keypoints.base(Ts, found=found, frame=frame)
    )
    off = np.linalg.norm(placed["block"].T_camera_part[:3, 3] - true["block"][:3, 3])
    assert (off < 0.003) == pooled
