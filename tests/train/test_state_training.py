"""Training of the state network: what it is shown, what it takes over, and whole runs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.data.images import read_rgb
from asdfviz.data.scene_files import find_scene_files
from asdfviz.datatypes import Assembly
from asdfviz.detector.crop_classes import crop_classes, group_states
from asdfviz.detector.crop_cut import CropCamera, cut
from asdfviz.detector.crop_maps import MAPS
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.detector.crop_weights import save_crop_network
from asdfviz.detector.state_cut import STATE_SIZE, BasePoses, seen_by, state_cameras
from asdfviz.detector.state_network import StateNetwork
from asdfviz.detector.state_weights import load_state_network, save_state_network
from asdfviz.errors import InputError, WeightsError
from asdfviz.geometry.transforms import apply
from asdfviz.train.crop_data import CropMaker
from asdfviz.train.crop_found import found_crops
from asdfviz.train.crop_pool import CropPool
from asdfviz.train.log import Meter
from asdfviz.train.state_checkpoint import begin_states_from
from asdfviz.train.state_config import StateTrainConfig
from asdfviz.train.state_session import DRAWN, StateSession
from asdfviz.train.state_views import STORED_STATE_PIXELS, StateViewMaker, group_points


def toy_network(assembly: Assembly) -> StateNetwork:
    views = StateViewMaker([assembly], crop_classes([assembly]))
    torch.manual_seed(0)
    network = StateNetwork(
        points=views.points[:, ::4],
        normals=views.normals[:, ::4],
        axes=views.axes,
        states=len(assembly.states),
    )
    return network.eval()


def test_points_lie_on_every_part_where_states_have_it(assembly: Assembly) -> None:
    points, normals = group_points(assembly, count=12)
    assert points.shape == normals.shape == (12, 3)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(12), abs=1e-5)
    T_body_bar = assembly.states[1].T_base_part["bar"]
    for part, T, own in (("body", np.eye(4), points[:6]), ("bar", T_body_bar, points[6:])):
        placed = apply(T, assembly.parts[part].mesh.vertices)
        low, high = placed.min(axis=0) - 1e-6, placed.max(axis=0) + 1e-6
        assert ((own >= low) & (own <= high)).all()
        assert np.isclose(np.minimum(own - low, high - own).min(axis=1), 0, atol=1e-5).all()


def test_views_show_what_methods_will_cut(scene: Path, assembly: Assembly) -> None:
    classes = crop_classes([assembly])
    found = found_crops(
        [scene], [assembly], classes, pixels=STORED_STATE_PIXELS, only_groups=True
    ).crops
    assert found.states.tolist() == [0, 1] * 4
    assert found.pictures.shape[2:] == (STORED_STATE_PIXELS, STORED_STATE_PIXELS)
    views = StateViewMaker([assembly], classes)
    shown = views.views(found, rng=np.random.default_rng(0), jitter=0.0)
    truth = json.loads((scene / "scene_gt.json").read_text())["0"]
    camera = json.loads((scene / "scene_camera.json").read_text())["0"]
    K = np.array(camera["cam_K"]).reshape(3, 3)
    body = next(item for item in truth if item["obj_id"] == "body")
    R, t = np.array(body["cam_R_m2c"]).reshape(3, 3), np.array(body["cam_t_m2c"]) / 1000
    poses = BasePoses(
        torch.tensor(R, dtype=torch.float32)[None], torch.tensor(t, dtype=torch.float32)[None]
    )
    cameras = state_cameras(views.points, views.axes, poses)
    wanted = seen_by(cameras, poses)
    assert shown.focal[0].item() == pytest.approx(cameras.focal.item(), rel=1e-3)
    assert shown.poses.R[0].numpy() == pytest.approx(wanted.R[0].numpy(), abs=1e-3)
    assert shown.poses.t[0].numpy() == pytest.approx(wanted.t[0].numpy(), abs=1e-4)
    width, height = STATE_SIZE
    focal = cameras.focal.item()
    K_crop = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    cutting = CropCamera(K_crop, cameras.R_camera_crop[0].double().numpy())
    picture = cut(read_rgb(find_scene_files(scene).rgb[0]), cutting, K, size=STATE_SIZE)
    mine = ((shown.pictures[0] + 0.5) * 255).permute(1, 2, 0).numpy()
    assert np.abs(mine - picture)[height // 4 : -height // 4, width // 4 : -width // 4].mean() < 4


def test_poses_are_off_as_those_that_are_found(scene: Path, assembly: Assembly) -> None:
    classes = crop_classes([assembly])
    found = found_crops(
        [scene], [assembly], classes, pixels=STORED_STATE_PIXELS, only_groups=True
    ).crops
    many = found.taken(torch.arange(400) % len(found))
    views = StateViewMaker([assembly], classes)
    exact = views.views(many, rng=np.random.default_rng(0), jitter=0.0)
    shown = views.views(many, rng=np.random.default_rng(0))
    far = (shown.poses.t.norm(dim=1) / exact.poses.t.norm(dim=1) - 1).abs()
    assert 0.003 < float(far.median()) < 0.03
    # A turn about the optical axis is lost in the roll: what is left is how the base is tilted.
    ahead = torch.einsum("bij,j->bi", shown.poses.R, torch.tensor([0.0, 0.0, 1.0]))
    before = torch.einsum("bij,j->bi", exact.poses.R, torch.tensor([0.0, 0.0, 1.0]))
    tilted = torch.rad2deg((ahead[:, 2] - before[:, 2]).abs())
    assert 0 < float(tilted.median()) < 10
    assert float(tilted.max()) > 20  # end for end, now and then


def test_the_maps_of_a_crop_network_are_taken_over(tmp_path: Path, assembly: Assembly) -> None:
    classes = crop_classes([assembly])
    states, names = group_states(classes), [c.name for c in classes]
    crops = CropNetwork(classes=len(names), grid=120, states=2, names=True)
    start = tmp_path / "crops.safetensors"
    save_crop_network(crops, start, classes=names, states=states)
    network = toy_network(assembly)
    before = {k: v.clone() for k, v in network.state_dict().items()}
    begin_states_from(network, start, states=states)
    after, learned = network.state_dict(), crops.state_dict()
    row = names.index("toy//group")
    for name, value in after.items():
        if name.split(".")[0] not in MAPS:
            assert torch.equal(value, before[name])
        elif ".table." in name:
            assert value[0] == pytest.approx(learned[name][row], abs=1e-3)
        elif value.is_floating_point():
            assert torch.allclose(value, learned[name], atol=1e-2)


def test_a_network_goes_on_only_for_the_same_states(tmp_path: Path, assembly: Assembly) -> None:
    states = group_states(crop_classes([assembly]))
    network, file = toy_network(assembly), tmp_path / "states.safetensors"
    save_state_network(network, file, states=states)
    other = toy_network(assembly)
    torch.nn.init.zeros_(other.to_states.weight)
    begin_states_from(other, file, states=states)
    assert torch.allclose(other.to_states.weight, network.to_states.weight, atol=1e-2)
    with pytest.raises(WeightsError, match="other states"):
        begin_states_from(other, file, states={"toy//group": ("start", "else")})
    with pytest.raises(WeightsError, match="no weights to begin with at"):
        begin_states_from(other, tmp_path / "nothing.safetensors", states=states)
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(WeightsError, match="not a whole safetensors file"):
        begin_states_from(other, file, states=states)


def run_config(folder: Path, **values: object) -> StateTrainConfig:
    chosen: dict[str, object] = {
        "assemblies": ("corner_clamp",),
        "output": folder,
        "steps": 4,
        "batch": 8,
        "generators": 0,
        "validation_crops": 2,
        "bfloat16": False,
        "first_shards": 1,
    } | values
    return StateTrainConfig(**chosen)  # pyright: ignore[reportArgumentType]


def test_a_run_trains_stops_goes_on_and_exports(tmp_path: Path) -> None:
    (tmp_path / "pool").mkdir()
    clamp = CropMaker([load_assembly("corner_clamp")], config=DRAWN)
    clamp.make(16, rng=np.random.default_rng(0)).save(tmp_path / "pool" / "shard_1.npz")
    session = StateSession(run_config(tmp_path))
    assert not session.go(lambda report: None, lambda: session.progress.step >= 2)
    assert json.loads((tmp_path / "states.json").read_text())["steps"] == 2
    before = {k: v.clone() for k, v in session.network.state_dict().items()}
    again = StateSession(run_config(tmp_path))
    assert again.progress.step == 2
    assert all(torch.equal(v, before[k]) for k, v in again.network.state_dict().items())
    steps: list[int] = []
    assert again.go(lambda report: steps.append(report.step), lambda: False)
    assert steps[-1] == 4
    found = again.validate()
    assert [one.name for one in found] == ["crops"]
    assert "corner_clamp//group" in found[0].line()
    loaded = load_state_network(tmp_path / "states.safetensors")
    assert loaded.states == {"corner_clamp//group": ("base", "jaw", "bolt", "jaw_reversed")}
    record = json.loads((tmp_path / "states.json").read_text(), parse_constant=pytest.fail)
    assert record["validation"][0]["right"].keys() == loaded.states.keys()
    assert (tmp_path / "curve.png").is_file()
    with pytest.raises(WeightsError, match="another run folder"):
        StateSession(run_config(tmp_path, assemblies=("vise",)))


def test_steps_lower_the_loss_of_what_they_show(tmp_path: Path) -> None:
    clamp = CropMaker([load_assembly("corner_clamp")], config=DRAWN)
    made = clamp.make(12, rng=np.random.default_rng(0))
    session = StateSession(run_config(tmp_path, steps=40, batch=12, warmup_steps=1))
    pool = CropPool(1)
    pool.add(made)
    first, last = Meter(), Meter()
    for number in range(40):
        session.step(pool, first if number < 5 else last if number >= 35 else Meter())
    assert last.means()[0] < 0.7 * first.means()[0]


def test_scenes_are_shown_beside_crops(
    tmp_path: Path, scene: Path, assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asdfviz.train.state_session.load_assembly", lambda name: assembly)
    (tmp_path / "pool").mkdir()
    made = CropMaker([assembly], config=DRAWN).make(8, rng=np.random.default_rng(0))
    made.save(tmp_path / "pool" / "shard_1.npz")
    session = StateSession(run_config(tmp_path, scenes=(scene,), validation=(scene,), steps=2))
    assert session.found is not None
    assert len(session.found) == 8
    assert session.go(lambda report: None, lambda: False)
    assert [one.name for one in session.validate()] == ["crops", "scenes"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"minutes": 0.0},
        {"batch": 1},
        {"assemblies": ()},
        {"learning_rate": 0.0},
        {"scene_share": 1.0},
    ],
)
def test_impossible_runs_are_refused(tmp_path: Path, wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        StateSession(run_config(tmp_path, **wrong))


def test_what_stands_at_a_point_is_read_there(assembly: Assembly) -> None:
    network = toy_network(assembly)
    poses = BasePoses(torch.eye(3)[None], torch.tensor([[0.0, 0.0, 0.5]]))
    width, height = STATE_SIZE
    pictures = torch.zeros(1, 3, height, width, requires_grad=True)
    read, _ = network._read(  # pyright: ignore[reportPrivateUsage]
        torch.nn.functional.avg_pool2d(pictures, 4),
        torch.tensor([0]),
        poses,
        torch.tensor([[300.0 / (width / 2), 300.0 / (height / 2)]]),
    )
    read[0, 3, 0].backward()  # the first channel at the fourth point
    assert pictures.grad is not None
    v, u = np.argwhere(pictures.grad[0, 0].numpy() > 0).mean(axis=0)
    x, y, z = network.points[0, 3].numpy() + np.array([0.0, 0.0, 0.5])
    there = (300 * x / z + (width - 1) / 2, 300 * y / z + (height - 1) / 2)
    assert (u, v) == pytest.approx(there, abs=2.5)
