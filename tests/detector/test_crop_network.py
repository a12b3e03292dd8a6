from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.detector.crop_cut import CONTEXT, CROP_PIXELS, crop_camera, cut
from asdfviz.detector.crop_looker import CropLooker, CropLookerConfig
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.detector.crop_weights import load_crop_network, save_crop_network
from asdfviz.errors import WeightsError
from asdfviz.geometry.camera import project
from asdfviz.geometry.rotation_grid import rotations_of
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import apply, inverse, transform_from

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
SMALL = {"grid": 120, "widths": (8, 8, 16, 16, 16), "hidden": 32, "own": 16}


STATES = {"a//group": ("bare", "joined"), "b//group": ("bare", "joined", "wrong")}


def network(classes: int = 2, seed: int = 0, states: int = 0, names: bool = False) -> CropNetwork:
    torch.manual_seed(seed)
    return CropNetwork(classes=classes, states=states, names=names, **SMALL).eval()


def test_outputs_depend_on_the_part_and_have_the_promised_shapes() -> None:
    net = network()
    crop = torch.rand(1, 3, CROP_PIXELS, CROP_PIXELS).expand(2, -1, -1, -1) - 0.5
    with torch.inference_mode():
        out = net(crop, torch.tensor([0, 1]))
    assert out.rotations.shape == (2, 120)
    assert out.place.shape == (2, 3)
    assert out.outline.shape == (2, 24, 24)
    assert out.states.shape == (2, 0)
    assert net.names(crop, torch.ones(2)).shape == (2, 0)
    assert not torch.allclose(out.rotations[0], out.rotations[1])


def test_names_are_those_of_the_classes_and_nothing() -> None:
    net = network(names=True)
    with torch.inference_mode():
        names = net.names(torch.rand(4, 3, CROP_PIXELS, CROP_PIXELS) - 0.5, torch.full((4,), 0.1))
    assert names.shape == (4, 3)


def test_a_name_depends_on_the_size_where_it_is_known() -> None:
    net = network(names=True)
    assert net.name is not None
    torch.nn.init.normal_(net.name.know_size.weight)
    crop = (torch.rand(1, 3, CROP_PIXELS, CROP_PIXELS) - 0.5).expand(4, -1, -1, -1)
    sizes = torch.tensor([0.02, 0.1, torch.nan, torch.nan])
    with torch.inference_mode():
        small, large, unknown, again = net.names(crop, sizes)
    assert not torch.allclose(small, large)
    assert bool(torch.isfinite(unknown).all())
    assert torch.equal(unknown, again)


def test_the_full_network_fits_the_weight_limit(tmp_path: Path) -> None:
    path = tmp_path / "crops.safetensors"
    names = [f"a/{i}" for i in range(28)]
    states = {"a//group": [f"state {i}" for i in range(36)]}
    save_crop_network(
        CropNetwork(classes=28, states=36, names=True), path, classes=names, states=states
    )
    assert path.stat().st_size < 4.2e6


def test_weights_come_back(tmp_path: Path) -> None:
    net, path = network(states=5, names=True), tmp_path / "crops.safetensors"
    save_crop_network(net, path, classes=["a//group", "b//group"], states=STATES)
    loaded = load_crop_network(path)
    assert loaded.classes == ("a//group", "b//group")
    assert loaded.states == STATES
    assert loaded.spans == {"a//group": slice(0, 2), "b//group": slice(2, 5)}
    crops, part = torch.rand(2, 3, CROP_PIXELS, CROP_PIXELS) - 0.5, torch.tensor([0, 1])
    with torch.inference_mode():
        want, got = net(crops, part), loaded.network(crops, part)
    assert torch.allclose(want.rotations, got.rotations, atol=0.02)
    assert torch.allclose(want.outline, got.outline, atol=0.02)
    assert torch.allclose(want.states, got.states, atol=0.02)
    with torch.inference_mode():
        sizes = torch.tensor([0.05, torch.nan])
        want, got = net.names(crops, sizes), loaded.network.names(crops, sizes)
        assert torch.allclose(want, got, atol=0.02)


FAULTS = ["missing", "cut short", "text", "other classes", "other states", "bias", "weight"]


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_weights_are_refused(tmp_path: Path, fault: str) -> None:
    path = tmp_path / "crops.safetensors"
    net = network()
    if fault in ("bias", "weight"):
        getattr(net.to_place, fault).data[1] = torch.nan
    classes = ["a/x"] if fault == "other classes" else ["a/x", "a/y"]
    states = STATES if fault == "other states" else {}
    save_crop_network(net, path, classes=classes, states=states)
    if fault == "missing":
        path.unlink()
    elif fault == "cut short":
        path.write_bytes(path.read_bytes()[:1000])
    elif fault == "text":
        path.write_text("no weights")
    with pytest.raises(WeightsError, match=r"crops\.safetensors"):
        load_crop_network(path)


def test_a_detector_is_no_crop_network(tmp_path: Path) -> None:
    from asdfviz.detector.network import Network
    from asdfviz.detector.weights import save_network

    path = tmp_path / "weights.safetensors"
    save_network(Network("n", classes=1), path, classes=["x"], image_size=640)
    with pytest.raises(WeightsError, match="asdfviz-crops-2"):
        load_crop_network(path)


def test_a_crop_shows_the_box_in_its_middle_at_the_promised_size() -> None:
    box = np.array([200.0, 20, 300, 80])
    camera = crop_camera(box, K)
    T_crop_camera = inverse(transform_from(camera.R_camera_crop, np.zeros(3)))
    edges = np.array([[200.0, 50, 1], [300, 50, 1], [250, 50, 1]]) @ np.linalg.inv(K).T
    pixels = project(apply(T_crop_camera, edges), camera.K)
    assert pixels[2] == pytest.approx([(CROP_PIXELS - 1) / 2] * 2, abs=1e-6)
    width = np.linalg.norm(pixels[1] - pixels[0])
    assert width == pytest.approx(CROP_PIXELS / CONTEXT, rel=0.05)


@pytest.mark.parametrize("extent", [24.0, 200.0])
def test_the_picture_follows_the_crops_camera(extent: float) -> None:
    rgb = np.zeros((240, 320, 3), np.uint8)
    rgb[:, :160] = (250, 10, 10)
    box = np.array([160 - extent / 2, 100, 160 + extent / 2, 140])
    camera = crop_camera(box, K)
    picture = cut(rgb, camera, K)
    assert picture.shape == (CROP_PIXELS, CROP_PIXELS, 3)
    edge = int((picture[48, :, 0] > 125).sum())
    assert edge == pytest.approx(CROP_PIXELS / 2, abs=2)


def test_looking_answers_for_known_classes_alone(tmp_path: Path) -> None:
    path = tmp_path / "crops.safetensors"
    save_crop_network(network(), path, classes=["a/x", "a/y"], states={})
    looker = CropLooker(path, config=CropLookerConfig(count=5))
    rgb = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    box = np.array([100.0, 100, 150, 160])
    answers = looker.look(rgb, K, {"one": ("a/y", box), "two": ("b/z", box)})
    assert set(answers) == {"one"}
    answer = answers["one"]
    assert 1 <= len(answer.rotations) <= 5
    assert np.all(np.diff(answer.probabilities) <= 0)
    assert answer.outline.shape == (24, 24)
    assert looker.look(rgb, K, {}) == {}
    far, near = (replace(answer, place=np.array([0, 0, size])) for size in (-0.1, 0.1))
    assert far.distance(0.1) > near.distance(0.1) > 0


def test_a_group_is_told_its_own_states_alone(tmp_path: Path) -> None:
    path = tmp_path / "crops.safetensors"
    net = network(classes=3, states=5)
    assert net.to_states is not None
    net.to_states.weight.data.zero_()
    net.to_states.bias.data = torch.tensor([9.0, 9.0, 0.0, 1.0, 2.0])
    save_crop_network(net, path, classes=["a//group", "b//group", "b/x"], states=STATES)
    looker = CropLooker(path)
    rgb = np.zeros((240, 320, 3), np.uint8)
    box = np.array([100.0, 100, 150, 160])
    answers = looker.look(rgb, K, {"group": ("b//group", box), "part": ("b/x", box)})
    odds = np.exp([0.0, 1.0, 2.0])
    assert answers["group"].states == pytest.approx(odds / odds.sum(), abs=1e-3)
    assert len(answers["part"].states) == 0


def test_boxes_are_named_among_the_classes_in_question(tmp_path: Path) -> None:
    path = tmp_path / "crops.safetensors"
    net = network(classes=3, names=True)
    assert net.name is not None
    net.name.to_names.weight.data.zero_()
    net.name.to_names.bias.data = torch.tensor([1.0, 9.0, 2.0, 0.0])
    save_crop_network(net, path, classes=["a/x", "a/y", "b/z"], states={})
    looker = CropLooker(path)
    rgb = np.zeros((240, 320, 3), np.uint8)
    boxes = [np.array([100.0, 100, 150, 160]), np.array([10.0, 10, 30, 40])]
    named = looker.names(rgb, K, boxes, ["b/z", "c/new", "a/x"], distances=[0.5, None])
    odds = np.exp([2.0, 1.0, 0.0])  # the last for nothing
    assert named == pytest.approx(
        np.tile([odds[0], 0.0 * odds.sum(), odds[1]], (2, 1)) / odds.sum()
    )
    assert looker.names(rgb, K, [], ["a/x"], distances=[]).shape == (0, 1)
    assert not looker.names(rgb, K, boxes, ["c/new"], distances=[0.5, 0.5]).any()
    save_crop_network(network(), path, classes=["a/x", "a/y"], states={})
    untaught = CropLooker(path)
    assert not untaught.tells_names
    assert not untaught.names(rgb, K, boxes, ["a/x"], distances=[0.5, 0.5]).any()


def test_the_looker_tells_the_network_how_large_things_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "crops.safetensors"
    save_crop_network(network(names=True), path, classes=["a/x", "a/y"], states={})
    looker, told = CropLooker(path), []
    monkeypatch.setattr(
        CropNetwork, "names", lambda self, crops, sizes: (told.append(sizes), torch.zeros(3, 3))[1]
    )
    box = np.array([140.0, 100, 180, 130])  # 40 px at f 300 px
    aside = np.array([0.0, 0, 40, 30])
    looker.names(
        np.zeros((240, 320, 3), np.uint8), K, [box, box, aside], ["a/x"], distances=[0.6, None, 0.6]
    )
    assert float(told[0][0]) == pytest.approx(0.08, rel=0.01)
    assert bool(told[0][1].isnan())
    assert float(told[0][2]) == pytest.approx(0.08, rel=0.12), "off the axis nearly the same"


def test_an_answer_tells_how_likely_any_rotation_is(tmp_path: Path) -> None:
    path = tmp_path / "crops.safetensors"
    save_crop_network(network(seed=3), path, classes=["a/x", "a/y"], states={})
    looker = CropLooker(path, config=CropLookerConfig(count=5))
    rgb = np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    answer = looker.look(rgb, K, {"x": ("a/x", np.array([240.0, 30, 300, 90]))})["x"]
    assert answer.distribution.sum() == pytest.approx(1.0)
    best, second = (answer.camera.R_camera_crop @ R for R in rotations_of(answer.rotations)[:2])
    none = Symmetries()
    assert answer.likelihood(best, none) == pytest.approx(1.0, abs=0.25)
    expected = answer.probabilities[1] / answer.probabilities[0]
    assert answer.likelihood(second, none) == pytest.approx(expected, abs=0.25)
    faint = rotations_of(answer.grid[answer.distribution.argmin()][None])[0]
    faint = answer.camera.R_camera_crop @ faint
    assert answer.likelihood(faint, none) < answer.likelihood(best, none)
    turn = transform_from(faint.T @ best, np.zeros(3))  # as if the part looked the same so turned
    alike = Symmetries(discrete=(turn,))
    assert answer.likelihood(faint, alike) == pytest.approx(answer.likelihood(best, none))
    assert answer.likelihood(best, alike) == pytest.approx(answer.likelihood(best, none))
