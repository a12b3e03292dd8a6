from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, is_rigid
from asdfviz.synth.assets import Assets
from asdfviz.synth.images import draw_picture, generate_images
from asdfviz.synth.packs import PackConfig, make_pack
from asdfviz.synth.scene import SceneConfig, make_scene

pytestmark = pytest.mark.usefixtures("toy_loaded_once")

SMALL = SceneConfig(width=224, height=126, stray=0.0)
SMALL_PACK = PackConfig(width=224, height=126, sizes_px=(16.0, 50.0))


def convex_outline(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels whose centres lie within the convex hull of projected vertices."""
    planes = ConvexHull(pixels).equations
    v, u = np.mgrid[0:height, 0:width]
    return (u[..., None] * planes[:, 0] + v[..., None] * planes[:, 1] + planes[:, 2] <= 0).all(
        axis=-1
    )


@pytest.mark.parametrize("seed", range(4))
def test_projected_vertices_meet_the_rendered_silhouette(toy_assets: Assets, seed: int) -> None:
    config = SceneConfig(
        width=480,
        height=270,
        hand_when_held=0.0,
        passing_hand=0.0,
        distractors=0,
        distance=(0.42, 0.5),
    )
    true_scene, picture = draw_picture(toy_assets, rng=np.random.default_rng(seed), config=config)
    compared = 0
    for i, thing in enumerate(true_scene.scene.placed):
        if not thing.truth:
            continue
        T = true_scene.scene.T_camera_world @ thing.T_world_mesh
        assert is_rigid(T)
        mesh = toy_assets.assembly.parts[thing.name].mesh
        pixels = project(apply(T, mesh.vertices), true_scene.scene.camera.K)
        mask = picture.ids == i
        # Boxes are convex, so whatever is wholly visible must fill its outline.
        if mask.sum() < 0.999 * picture.silhouette_px[i] or mask.sum() < 300:
            continue
        outline = convex_outline(pixels, 480, 270)
        assert (mask & outline).sum() / (mask | outline).sum() > 0.98
        compared += 1
        box = picture.silhouette_box[i]
        v, u = np.nonzero(mask)
        assert box.tolist() == [u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1]
    assert compared >= 1


def test_ids_depth_and_visibility_agree(toy_assets: Assets) -> None:
    true_scene, picture = draw_picture(toy_assets, rng=np.random.default_rng(5), config=SMALL)
    for i in range(len(true_scene.scene.placed)):
        assert (picture.ids == i).sum() <= picture.silhouette_px[i]
    assert (picture.depth[picture.ids >= 0] > 0).all()
    assert np.isfinite(picture.radiance).all()
    assert picture.radiance.min() >= 0


def test_loose_parts_stand_on_the_table_and_do_not_overlap(toy_assets: Assets) -> None:
    config = SceneConfig(tilted=0.0, held=0.0, distractors=0, stray=0.0)
    for seed in range(12):
        placed = make_scene(toy_assets, rng=np.random.default_rng(seed), config=config).scene.placed
        parts = [p for p in placed if p.kind == "part"]
        for thing in parts:
            mesh = toy_assets.assembly.parts[thing.name].mesh
            assert apply(thing.T_world_mesh, mesh.vertices)[:, 2].min() > -1e-9
        lowest = min(
            apply(p.T_world_mesh, toy_assets.assembly.parts[p.name].mesh.vertices)[:, 2].min()
            for p in parts
        )
        assert abs(lowest) < 1e-9


def test_scene_groups_follow_the_assembly_up_to_their_joints(toy_assets: Assets) -> None:
    for seed in range(20):
        true_scene = make_scene(toy_assets, rng=np.random.default_rng(seed), config=SMALL)
        group = true_scene.groups[0]
        placed = true_scene.scene.placed
        T_world_base = placed[group.members[0]].T_world_mesh
        assert [placed[i].name for i in group.members] == list(group.state.attached)
        for i in group.members:
            T_base_part = np.linalg.inv(T_world_base) @ placed[i].T_world_mesh
            off = T_base_part[:3, 3] - group.state.T_base_part[placed[i].name][:3, 3]
            slack = 0.0101 if placed[i].name in group.state.joints else 1e-9
            assert np.abs(off).max() <= slack


def test_packs_hold_many_objects_with_poses_in_one_camera(toy_assets: Assets) -> None:
    config = PackConfig()
    counts = []
    for seed in range(4):
        pack = make_pack(toy_assets, rng=np.random.default_rng(seed), config=config)
        counts.append(sum(p.truth for p in pack.scene.placed))
        for thing in pack.scene.placed:
            if thing.truth:
                T = pack.scene.T_camera_world @ thing.T_world_mesh
                assert is_rigid(T)
                assert T[2, 3] > 0.1
        assert pack.main is None
    assert np.mean(counts) >= 30


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_stopped_job_goes_on_and_gives_the_same_files(toy: Assembly, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    generate_images(toy, count=3, seed=5, folder=whole, config=SMALL)
    done: list[int] = []
    written = generate_images(
        toy, count=3, seed=5, folder=parts, config=SMALL, stop=lambda: len(done) >= 2,
        progress=lambda i, _: done.extend([i] if i else []),
    )  # fmt: skip
    assert written == 2
    before = (parts / "rgb" / "000000.jpg").stat().st_mtime_ns
    assert generate_images(toy, count=3, seed=5, folder=parts, config=SMALL) == 3
    assert (parts / "rgb" / "000000.jpg").stat().st_mtime_ns == before
    assert folder_bytes(whole) == folder_bytes(parts)


@pytest.mark.usefixtures("shapes_unchecked")
def test_other_seeds_give_other_images(toy: Assembly, tmp_path: Path) -> None:
    for seed in (1, 2):
        generate_images(toy, count=1, seed=seed, folder=tmp_path / str(seed), config=SMALL)
    a, b = (cv2.imread(str(tmp_path / s / "rgb" / "000000.jpg")) for s in ("1", "2"))
    assert a is not None
    assert b is not None
    assert np.abs(a.astype(int) - b.astype(int)).mean() > 3


@pytest.mark.parametrize("config", [SMALL, SMALL_PACK])
def test_bop_folder_has_all_fields(
    toy: Assembly, tmp_path: Path, config: SceneConfig | PackConfig
) -> None:
    generate_images(toy, count=2, seed=3, folder=tmp_path, config=config)
    read = {p.stem: json.loads(p.read_text()) for p in tmp_path.glob("*.json")}
    assert set(read) == {
        "scene_gt",
        "scene_gt_info",
        "scene_camera",
        "states",
        "sequence",
        "camera",
    }
    assert read["sequence"]["assembly"] == "toy"
    assert (read["camera"]["width"], read["camera"]["depth_scale"]) == (224, 1.0)
    for frame in ("0", "1"):
        gt, info, state = (
            read["scene_gt"][frame],
            read["scene_gt_info"][frame],
            read["states"][int(frame)],
        )
        assert len(gt) == len(info) > 0
        assert all(g["obj_id"] in toy.parts and len(g["cam_R_m2c"]) == 9 for g in gt)
        assert all(100 < g["cam_t_m2c"][2] < 1500 for g in gt)
        assert all(0 <= i["visib_fract"] <= 1 and len(i["bbox_obj"]) == 4 for i in info)
        assert len(read["scene_camera"][frame]["cam_K"]) == 9
        rgb = cv2.imread(str(tmp_path / "rgb" / f"{int(frame):06d}.jpg"))
        assert rgb is not None
        assert rgb.shape == (126, 224, 3)
        for group in state["groups"]:
            assert gt[group["gt"][0]]["obj_id"] == "plate"
        if isinstance(config, SceneConfig):
            assert state["state"] in (0, 1, 2)
            assert {gt[i]["obj_id"] for i in state["groups"][0]["gt"]} == set(state["attached"])
            depth = cv2.imread(
                str(tmp_path / "depth" / f"{int(frame):06d}.png"), cv2.IMREAD_UNCHANGED
            )
            assert depth is not None
            assert depth.dtype == np.uint16
        else:
            assert state["state"] is None


def test_a_count_of_nothing_is_refused(toy: Assembly, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="count is 0"):
        generate_images(toy, count=0, seed=1, folder=tmp_path)
