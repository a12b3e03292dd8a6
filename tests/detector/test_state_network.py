"""The state network: its file, what it is shown in use, and what it tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.data.resources import models_folder
from asdfviz.datatypes import Assembly
from asdfviz.detector.state_cut import MARGIN, STATE_SIZE, BasePoses, seen_by, state_cameras
from asdfviz.detector.state_looker import StateLooker
from asdfviz.detector.state_network import StateNetwork
from asdfviz.detector.state_weights import load_state_network, save_state_network, states_known
from asdfviz.errors import WeightsError
from asdfviz.geometry.transforms import rotation_about, transform_from

STATES = {"corner_clamp//group": ("base", "jaw", "bolt"), "other//group": ("a", "b")}
K = np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]])


@pytest.fixture(scope="module")
def network() -> StateNetwork:
    torch.manual_seed(1)
    normals = torch.nn.functional.normalize(torch.randn(2, 20, 3), dim=2)
    axes = torch.tensor([[1.0, 0, 0], [0, 1.0, 0]])
    points = 0.03 * torch.randn(2, 20, 3)
    return StateNetwork(points=points, normals=normals, axes=axes, states=5).eval()


@pytest.fixture(scope="module")
def file(network: StateNetwork, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "states.safetensors"
    save_state_network(network, path, states=STATES)
    return path


@pytest.fixture(scope="module")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


def shown(
    count: int,
) -> tuple[torch.Tensor, torch.Tensor, BasePoses, torch.Tensor]:
    torch.manual_seed(2)
    t = torch.tensor([0.0, 0.0, 0.6]).expand(count, 3)
    poses = BasePoses(torch.eye(3).expand(count, 3, 3), t)
    crops = torch.rand(count, 3, *STATE_SIZE[::-1]) - 0.5
    return crops, torch.arange(count) % 2, poses, torch.full((count,), 500.0)


def test_weights_come_back_from_a_small_file(network: StateNetwork, file: Path) -> None:
    loaded = load_state_network(file)
    assert loaded.states == states_known(file) == STATES
    assert loaded.spans == {"corner_clamp//group": slice(0, 3), "other//group": slice(3, 5)}
    assert torch.equal(loaded.network.points, network.points)
    with torch.inference_mode():
        before, after = network(*shown(4)), loaded.network(*shown(4))
    assert torch.allclose(before, after, atol=0.03)
    count = sum(p.numel() for p in network.parameters())
    assert file.stat().st_size < 1.15 * count + 40_000


def test_a_state_depends_on_the_pose_and_on_what_stands_there(network: StateNetwork) -> None:
    crops, groups, poses, focal = shown(1)
    moved = replace(poses, t=poses.t + torch.tensor([0.03, 0.0, 0.0]))
    other = crops.clone()
    other[:, :, 48:80, 96:128] = 0.4  # the points are seen there
    with torch.inference_mode():
        told = network(crops, groups, poses, focal)
        assert not torch.allclose(told, network(crops, groups, moved, focal), atol=1e-6)
        assert not torch.allclose(told, network(other, groups, poses, focal), atol=1e-6)


@pytest.mark.parametrize("damage", ["cut", "format", "nan", "names"])
def test_what_is_no_state_network_is_refused(
    network: StateNetwork, tmp_path: Path, damage: str
) -> None:
    path = tmp_path / "states.safetensors"
    broken = load_state_network(_saved(network, path)).network
    if damage == "nan":
        with torch.no_grad():
            broken.mix.bias[0] = torch.nan
        save_state_network(broken, path, states=STATES)
    elif damage == "names":
        save_state_network(broken, path, states={"corner_clamp//group": ("base",)})
    else:
        whole = path.read_bytes()
        path.write_bytes(
            whole[:300]
            if damage == "cut"
            else whole.replace(b"asdfviz-states-2", b"asdfviz-crops-02")
        )
    with pytest.raises(WeightsError, match=r"states\.safetensors"):
        load_state_network(path)


def _saved(network: StateNetwork, path: Path) -> Path:
    save_state_network(network, path, states=STATES)
    return path


def test_missing_weights_say_how_to_get_some(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="train-states"):
        load_state_network(tmp_path / "states.safetensors")


@pytest.mark.parametrize("turn", [0.0, 1.2, 2.9])
def test_the_crop_is_level_and_holds_all_places_of_parts(
    network: StateNetwork, turn: float
) -> None:
    R = rotation_about(np.array([0.0, 0.0, 1.0]), turn) @ rotation_about(np.array([1.0, 0, 0]), 0.4)
    T = torch.tensor(transform_from(R, np.array([0.08, -0.05, 0.6])), dtype=torch.float32)[None]
    poses = BasePoses(T[:, :3, :3], T[:, :3, 3])
    cameras = state_cameras(network.points[:1], network.axes[:1], poses)
    there = seen_by(cameras, poses)
    seen = network.points[0] @ there.R[0].T + there.t[0]
    flat = cameras.focal * seen[:, :2] / seen[:, 2:]
    low, high = flat.amin(0), flat.amax(0)
    room = torch.tensor(STATE_SIZE) / MARGIN
    assert (low + high).abs().max() < 0.06 * STATE_SIZE[0]  # perspective shifts the middle a little
    assert float(((high - low) / room).max()) == pytest.approx(1.0, rel=0.03)
    right, down, _ = (there.R[0] @ network.axes[0]).tolist()
    assert right > 0.5
    assert abs(down) < 0.1


def test_a_group_behind_the_camera_shows_nothing(clamp: Assembly, file: Path) -> None:
    behind = transform_from(np.eye(3), np.array([0.0, 0.0, -0.5]))
    rgb = np.zeros((360, 640, 3), np.uint8)
    assert StateLooker(file).look(rgb, K, clamp, behind) is None


def test_a_looker_tells_a_groups_own_states(clamp: Assembly, file: Path) -> None:
    looker = StateLooker(file)
    assert looker.states == STATES
    rgb = np.random.default_rng(0).integers(0, 255, (360, 640, 3), np.uint8)
    told = looker.look(rgb, K, clamp, transform_from(np.eye(3), np.array([0.0, 0.0, 0.5])))
    assert told is not None
    assert told.shape == (3,)
    assert told.sum() == pytest.approx(1)
    elsewhere = looker.look(rgb, K, clamp, transform_from(np.eye(3), np.array([0.1, 0.0, 0.5])))
    assert elsewhere is not None
    assert np.abs(told - elsewhere).max() > 1e-4


def test_the_bundled_network_tells_the_paper_s_four_apart() -> None:
    states = load_state_network(models_folder() / "gbot" / "states.safetensors").states
    counts = {name: len(of) for name, of in states.items()}
    assert counts == {
        "gbot_nanovise//group": 10,
        "gbot_cornerclamp//group": 5,
        "gbot_gearedcaliper//group": 7,
        "gbot_screwclamp//group": 15,
    }
