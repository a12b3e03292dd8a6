from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.geometry.transforms import apply, rotation_angle
from asdfviz.synth.assets import Assets
from asdfviz.synth.joint_motion import joined_poses
from asdfviz.synth.packs import PackConfig, make_pack
from asdfviz.synth.scene import SceneConfig, TrueScene, make_scene
from asdfviz.synth.strays import displacement, stray


def test_a_stray_part_is_out_of_place_beyond_what_its_joint_allows(toy: Assembly) -> None:
    state = toy.states[2]
    for seed in range(200):
        rng = np.random.default_rng(seed)
        poses = joined_poses(state, rng)
        for name in ("block", "bar"):
            moved = displacement(toy, state, name, poses[name], rng)
            mesh = toy.parts[name].mesh.vertices
            middle = apply(poses[name], (mesh.min(axis=0) + mesh.max(axis=0))[None] / 2)
            offset = (apply(moved, middle) - middle)[0]
            assert 0.005 <= np.linalg.norm(offset) <= 0.03
            angle = np.rad2deg(rotation_angle(moved[:3, :3]))
            assert angle < 1e-3 or 10 - 1e-6 <= angle <= 40 + 1e-6
            if name in state.joints:
                assert abs(offset @ state.joints[name].axis) < 1e-9


def test_a_wrong_assembly_is_none_that_a_state_lists(toy: Assembly) -> None:
    kinds: set[str] = set()
    for seed in range(300):
        rng = np.random.default_rng(seed)
        state = toy.states[seed % len(toy.states)]
        wrong = stray(toy, state, state.T_base_part, rng)
        if state.index == 0:
            assert wrong is None
            continue
        assert wrong is not None
        if set(wrong) != set(state.T_base_part):
            kinds.add("missing")
            assert set(wrong) == {"plate", "bar"}
            assert frozenset(wrong) not in {frozenset(s.T_base_part) for s in toy.states}
        else:
            kinds.add("offset")
            changed = [n for n, T in wrong.items() if not np.allclose(T, state.T_base_part[n])]
            assert len(changed) == 1
            assert changed[0] != "plate"
    assert kinds == {"missing", "offset"}


COUNT = 160


@pytest.fixture(scope="module")
def drawn(toy_assets: Assets) -> list[TrueScene]:
    config = SceneConfig(distractors=0, duplicates=0, carried=0.0)
    return [
        make_scene(toy_assets, rng=np.random.default_rng([4, seed]), config=config)
        for seed in range(COUNT)
    ]


def test_scenes_show_every_state_and_strays_have_no_group(
    toy_assets: Assets, drawn: list[TrueScene]
) -> None:
    states = {scene.groups[scene.main].state.index for scene in drawn if scene.main is not None}
    assert states == {s.index for s in toy_assets.assembly.states}
    strays = [scene for scene in drawn if scene.main is None]
    assert all(scene.groups == () for scene in strays)
    assert 0.03 * COUNT < len(strays) < 0.2 * COUNT


def test_stray_groups_of_packs_are_no_groups(toy_assets: Assets) -> None:
    always = PackConfig(groups=1.0, strays=1.0, coverage=0.3)
    pack = make_pack(toy_assets, rng=np.random.default_rng(1), config=always)
    assert {g.state.index for g in pack.groups} <= {0}
    never = PackConfig(groups=1.0, strays=0.0, coverage=0.3)
    pack = make_pack(toy_assets, rng=np.random.default_rng(1), config=never)
    assert {g.state.index for g in pack.groups} == {0, 1, 2, 3}


def test_half_of_the_scenes_turn_the_base_over_the_whole_sphere(drawn: list[TrueScene]) -> None:
    ups: list[np.ndarray] = []
    for scene in drawn:
        base = scene.scene.placed[0]
        assert base.name == "plate"
        up = base.T_world_mesh[2, :3]
        # A plate at rest has one of its axes upright.
        if np.abs(up).max() < np.cos(np.deg2rad(2)):
            ups.append(up)
    assert len(ups) >= 0.5 * COUNT
    octants = np.bincount((np.array(ups) > 0) @ [1, 2, 4], minlength=8) / len(ups)
    assert octants.min() > 0.03
    assert octants.max() < 0.25
    heights = np.sort(np.abs(np.array(ups)[:, 2]))
    # Even over the sphere: the share of |z| below h is h (Archimedes).
    assert np.abs(heights - np.linspace(0, 1, len(ups))).max() < 0.17


def test_no_part_hangs_over_the_edge_of_its_table(
    toy_assets: Assets, drawn: list[TrueScene]
) -> None:
    bounded = 0
    for scene in drawn:
        top = scene.scene.grounds[0]
        assert top.height == 0
        parts = [p for p in scene.scene.placed if p.kind == "part"]
        meshes = toy_assets.assembly.parts
        xy = np.concatenate([apply(p.T_world_mesh, meshes[p.name].mesh.vertices) for p in parts])
        assert (xy[:, :2] @ top.edges[:, :2].T <= top.edges[:, 2] - 0.015).all()
        if top.circle is not None:
            x, y, radius = top.circle
            assert np.hypot(xy[:, 0] - x, xy[:, 1] - y).max() < radius - 0.015
        bounded += top.circle is not None or len(top.edges) > 0
    assert bounded > 0.5 * COUNT


def test_hands_carry_loose_parts_and_nothing_else_changes(toy_assets: Assets) -> None:
    carried = 0
    for seed in range(40):
        without, with_one = (
            make_scene(
                toy_assets,
                rng=np.random.default_rng([9, seed]),
                config=SceneConfig(distractors=0, carried=share),
            )
            for share in (0.0, 1.0)
        )
        before, after = without.scene.placed, with_one.scene.placed
        assert [g.members for g in with_one.groups] == [g.members for g in without.groups]
        moved = [
            i
            for i, (a, b) in enumerate(zip(before, after, strict=False))
            if not np.array_equal(a.T_world_mesh, b.T_world_mesh)
        ]
        joined = {i for group in with_one.groups for i in group.members}
        assert len(moved) <= 1
        assert np.array_equal(without.scene.T_camera_world, with_one.scene.T_camera_world)
        if not moved:
            assert len(before) == len(after)
            continue
        carried += 1
        part = after[moved[0]]
        assert part.kind == "part"
        assert moved[0] not in joined
        points = apply(part.T_world_mesh, toy_assets.assembly.parts[part.name].mesh.vertices)
        assert points[:, 2].min() >= 0.0
        hands = after[len(before) :]
        assert hands
        assert {p.kind for p in hands} == {"hand"}
        grasp = hands[0].T_world_mesh[:3, 3]
        assert np.linalg.norm(points - grasp, axis=1).min() < 0.03
        # It is where nothing else stands.
        for other in (p for i, p in enumerate(after) if p.kind == "part" and i != moved[0]):
            mesh = toy_assets.assembly.parts[other.name].mesh.vertices
            apart = points.mean(axis=0) - apply(other.T_world_mesh, mesh).mean(axis=0)
            assert np.linalg.norm(apart) > 0.01
    assert carried > 20


def test_nobody_carries_anything_where_hands_are_left_out(toy_assets: Assets) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        scene = make_scene(toy_assets, rng=rng, config=SceneConfig(carried=1.0), hands=False)
        assert not [p for p in scene.scene.placed if p.kind == "hand"]
