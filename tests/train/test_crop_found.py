"""Training crops that are cut out of scenes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.datatypes import Assembly
from asdfviz.detector.crop_classes import crop_classes
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.errors import InputError, SequenceError
from asdfviz.geometry.transforms import apply
from asdfviz.train.crop_config import CropTrainConfig, check_crop_config
from asdfviz.train.crop_data import CropMaker
from asdfviz.train.crop_found import FoundCrops, found_crops, mixed
from asdfviz.train.crop_losses import crop_losses
from asdfviz.train.crop_pool import CropPool
from asdfviz.train.crop_views import ViewMaker

FRAMES = 8


@pytest.fixture(scope="module")
def found(scene: Path, assembly: Assembly) -> FoundCrops:
    return found_crops([scene], [assembly], crop_classes([assembly]))


def test_every_part_and_the_base_parts_group_are_cut_out(
    found: FoundCrops, assembly: Assembly
) -> None:
    names = [c.name for c in crop_classes([assembly])]
    counts = dict.fromkeys(names, 0)
    for label in found.crops.labels[found.crops.names != len(names)].tolist():
        counts[names[label]] += 1
    # Every frame shows a body and a loose bar, every other one a joined bar besides.
    assert counts == {"toy/body": 8, "toy/bar": 12, "toy//group": FRAMES}
    states = found.crops.states[found.crops.labels == names.index("toy//group")]
    assert states.tolist() == [0, 1] * (FRAMES // 2)
    is_part = (found.crops.states < 0) & (found.crops.names != len(names))
    is_group = found.crops.states >= 0
    assert torch.equal(found.crops.names[is_part], found.crops.labels[is_part])
    assert (found.crops.names[is_group] == -1).all()
    assert not found.crops.outlined.any()


def test_a_place_that_the_next_state_fills_is_cut_out_while_it_is_empty(
    found: FoundCrops, assembly: Assembly
) -> None:
    crops = found.crops
    is_empty = crops.names == 3
    # In every other frame the bar is joined; what lies loose beside is not in its place.
    assert int(is_empty.sum()) == FRAMES // 2
    assert (crops.labels[is_empty] == 1).all()
    T_body_bar = assembly.states[1].T_base_part["bar"]
    bodies = [T for T, label in zip(crops.T_crop_part, crops.labels, strict=True) if label == 0]
    assert len(bodies) == FRAMES
    drawn = found.draw(np.full(40, 1), rng=np.random.default_rng(0), empty=0.5)
    assert 10 < int((drawn.names == 3).sum()) < 30
    assert not (found.draw(np.full(40, 1), rng=np.random.default_rng(0)).names == 3).any()
    # Both seen from the camera: the place is as far from the body as the state says.
    apart = [
        float((a[:3, 3].norm() - b[:3, 3].norm()).abs())
        for a, b in zip(crops.T_crop_part[is_empty], bodies[::2], strict=True)
    ]
    assert max(apart) <= float(np.linalg.norm(T_body_bar[:3, 3])) + 1e-6


def test_a_place_with_a_like_part_in_it_is_not_empty(
    scene: Path, assembly: Assembly, tmp_path: Path
) -> None:
    taken = shutil.copytree(scene, tmp_path / "taken")
    truth = json.loads((taken / "scene_gt.json").read_text())
    for frame in truth.values():
        loose, body = frame[0], frame[1]
        R = np.reshape(body["cam_R_m2c"], (3, 3))
        place = R @ assembly.states[1].T_base_part["bar"][:3, 3] * 1e3
        loose |= {"cam_R_m2c": body["cam_R_m2c"], "cam_t_m2c": [*(place + body["cam_t_m2c"])]}
    (taken / "scene_gt.json").write_text(json.dumps(truth))
    found = found_crops([taken], [assembly], crop_classes([assembly]))
    assert not (found.crops.names == 3).any()


def test_a_place_is_not_empty_where_a_part_was_not_checked(
    scene: Path, assembly: Assembly, found: FoundCrops, tmp_path: Path
) -> None:
    partly = shutil.copytree(scene, tmp_path / "partly")
    (partly / "unchecked.json").write_text(json.dumps({str(i): ["bar"] for i in range(FRAMES)}))
    others = found_crops([partly], [assembly], crop_classes([assembly]))
    assert not (others.crops.names == 3).any()
    assert len(others.crops) == int((found.crops.names != 3).sum())


def test_where_a_cut_out_shows_a_part_its_pose_projects_to(
    found: FoundCrops, assembly: Assembly
) -> None:
    side = found.crops.pictures.shape[3]
    body = assembly.parts["body"]
    for i in np.flatnonzero(found.crops.labels.numpy() == 0):
        T = found.crops.T_crop_part[i].double().numpy()
        corners = apply(T, body.mesh.vertices[body.mesh.faces].mean(axis=1))
        a, b, c = (apply(T, body.mesh.vertices[body.mesh.faces[:, k]]) for k in range(3))
        faces_us = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
        nearest = corners[faces_us][corners[faces_us][:, 2].argmin()]
        u, v = np.rint(nearest[:2] / nearest[2] * float(found.crops.focal[i]) + (side - 1) / 2)
        color = found.crops.pictures[i, :3, int(v), int(u)].float()
        # Faces are painted in strong colours, the ground is grey.
        assert float(color.max() - color.min()) > 60


def test_unseen_outlines_teach_nothing_and_rolled_ones_do(
    found: FoundCrops, assembly: Assembly
) -> None:
    views = ViewMaker(crop_classes([assembly]), grid=600)
    rendered = CropMaker([assembly]).make(8, rng=np.random.default_rng(0))
    shown = views.views(rendered, rng=np.random.default_rng(1))
    assert not shown.outline.isnan().any()
    cut_out = views.views(found.crops, rng=np.random.default_rng(1))
    assert cut_out.outline.isnan().all()
    network = CropNetwork(classes=3, grid=600, states=2, names=True).eval()
    out = network(cut_out.pictures, cut_out.labels)
    losses = crop_losses(
        out,
        network.names(cut_out.pictures, cut_out.sizes),
        cut_out,
        target=views.targets(cut_out.quaternions, cut_out.labels),
        views=views,
    )
    assert losses.isfinite().all()
    assert losses[2] == 0
    assert losses[0] > 0
    assert losses[3] > 0


def test_a_batch_is_mixed_by_its_share(found: FoundCrops, assembly: Assembly) -> None:
    maker, pool = CropMaker([assembly]), CropPool(1)
    rng = np.random.default_rng(0)
    pool.add(maker.make(16, rng=rng))
    config = CropTrainConfig(assemblies=("toy",), output=Path(), batch=20, scene_share=0.3)
    batch = mixed(pool, found, maker=maker, config=config, rng=rng)
    assert len(batch) == 20
    assert int((~batch.outlined).sum()) == 6
    assert len(found.draw(np.array([], np.int64), rng=rng)) == 0
    alone = mixed(pool, None, maker=maker, config=config, rng=rng)
    assert bool(alone.outlined.all())


def test_classes_that_no_scene_shows_are_replaced(found: FoundCrops) -> None:
    rng = np.random.default_rng(0)
    drawn = found.draw(np.array([1, 1, 7]), rng=rng)
    assert drawn.labels[:2].tolist() == [1, 1]
    assert int(drawn.labels[2]) in (0, 1, 2)


def test_what_is_hidden_is_not_cut_out(scene: Path, assembly: Assembly, tmp_path: Path) -> None:
    hidden = shutil.copytree(scene, tmp_path / "hidden")
    info = json.loads((hidden / "scene_gt_info.json").read_text())
    nothing = {k: [{"visib_fract": 0.1} for _ in v] for k, v in info.items()}
    (hidden / "scene_gt_info.json").write_text(json.dumps(nothing))
    with pytest.raises(SequenceError, match="no part is seen in"):
        found_crops([hidden], [assembly], crop_classes([assembly]))


def test_a_share_of_all_is_refused() -> None:
    with pytest.raises(InputError, match="scene_share is 1"):
        check_crop_config(CropTrainConfig(assemblies=("a",), output=Path(), scene_share=1.0))
    with pytest.raises(InputError, match=r"empty_share is -0\.1"):
        check_crop_config(CropTrainConfig(assemblies=("a",), output=Path(), empty_share=-0.1))
