"""Training a mask branch: its pictures, its loss, and a run beside a detector that stays as it is."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.data.images import read_stored
from asdfviz.data.resources import sample_folder
from asdfviz.datatypes import Assembly
from asdfviz.detector.assigner import Assignment, Targets
from asdfviz.detector.mask_branch import RawMasks
from asdfviz.detector.mask_weights import load_masks, save_masks
from asdfviz.errors import InputError, SequenceError, WeightsError
from asdfviz.methods.network import NetworkConfig, weights_path
from asdfviz.train.log import Meter
from asdfviz.train.mask_config import MaskTrainConfig
from asdfviz.train.mask_data import MaskBatch, draw, load_mask_images
from asdfviz.train.mask_losses import mask_losses, shares
from asdfviz.train.mask_session import MaskSession
from asdfviz.train.packing import AugmentConfig

SIZE = {"width": 320, "height": 192}
ASSEMBLIES = ("corner_clamp", "geared_caliper", "vise", "screw_clamp")
"""Which the bundled network knows."""
PARTS = {f"corner_clamp/{name}" for name in ("base", "jaw", "bolt")}


@pytest.fixture(scope="module")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


@pytest.fixture(scope="module")
def packs(clamp: Assembly, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of the sample; the masks are hulls of the parts, near ones before far ones."""
    sample, folder = sample_folder(), tmp_path_factory.mktemp("masks") / "packs"
    (folder / "rgb").mkdir(parents=True)
    (folder / "mask_visib").mkdir()
    truth = json.loads((sample / "scene_gt.json").read_text())
    camera = json.loads((sample / "scene_camera.json").read_text())
    for new, old in enumerate((30, 60)):
        shutil.copy(sample / "rgb" / f"{old:06d}.jpg", folder / "rgb" / f"{new:06d}.jpg")
        K = np.array(camera[str(old)]["cam_K"]).reshape(3, 3)
        owners = np.zeros((360, 640), np.uint8)
        entries = truth[str(old)]
        for k in sorted(range(len(entries)), key=lambda k: -entries[k]["cam_t_m2c"][2]):
            R = np.array(entries[k]["cam_R_m2c"]).reshape(3, 3)
            points = clamp.parts[entries[k]["obj_id"]].mesh.vertices @ R.T
            points = (points + np.array(entries[k]["cam_t_m2c"]) / 1e3) @ K.T
            hull = cv2.convexHull((points[:, :2] / points[:, 2:]).round().astype(np.int32))
            cv2.fillConvexPoly(owners, hull, (k + 1,))
        for k in range(len(entries)):
            mask = (owners == k + 1).astype(np.uint8) * 255
            cv2.imwrite(str(folder / "mask_visib" / f"{new:06d}_{k:06d}.png"), mask)
    (folder / "sequence.json").write_text(json.dumps({"assembly": "corner_clamp"}))
    for name, content in (("scene_gt", truth), ("scene_camera", camera)):
        kept = {"0": content["30"], "1": content["60"]}
        (folder / f"{name}.json").write_text(json.dumps(kept))
    return folder


@pytest.fixture
def config(clamp: Assembly, packs: Path, tmp_path: Path) -> MaskTrainConfig:
    return MaskTrainConfig(
        assemblies=ASSEMBLIES,
        detector=weights_path(NetworkConfig(), clamp),
        data=(packs,),
        validation=(packs,),
        output=tmp_path / "run",
        steps=3,
        batch=2,
        warmup_steps=1,
        width=SIZE["width"],
        height=SIZE["height"],
    )


def test_owners_are_the_visible_pixels_of_each_part(clamp: Assembly, packs: Path) -> None:
    images = load_mask_images([packs], [clamp])
    assert len(images) == 2
    truth = json.loads((packs / "scene_gt.json").read_text())["0"]
    image = images[0]
    assert len(image.labels) == len(truth) == 3
    for k, entry in enumerate(truth):
        mask = read_stored(packs / "mask_visib" / f"000000_{k:06d}.png") > 0
        (owner,) = set(image.owners[mask].tolist())
        assert ((image.owners == owner) == mask).all()
        assert clamp.detector_classes[image.labels[owner - 1]] == entry["obj_id"]


def test_drawn_masks_lie_in_their_boxes(clamp: Assembly, packs: Path) -> None:
    image = load_mask_images([packs], [clamp])[1]
    sample = draw(image, np.random.default_rng(5), **SIZE, config=AugmentConfig())
    assert len(sample.labels) > 1
    for label, place, box in zip(sample.labels, sample.places, sample.boxes, strict=True):
        assert label == image.labels[place - 1]
        rows, columns = np.nonzero(sample.owners == place)
        assert len(rows) > 10
        assert columns.min() >= box[0] - 2
        assert rows.min() >= box[1] - 2
        assert columns.max() <= box[2] + 1
        assert rows.max() <= box[3] + 1


def test_a_folder_without_masks_is_told(clamp: Assembly, packs: Path, tmp_path: Path) -> None:
    shutil.copytree(packs, tmp_path / "bare")
    shutil.rmtree(tmp_path / "bare" / "mask_visib")
    with pytest.raises(SequenceError, match="--masks"):
        load_mask_images([tmp_path / "bare"], [clamp])
    (tmp_path / "bare" / "mask_visib").mkdir()
    with pytest.raises(SequenceError, match="000000_000000"):
        load_mask_images([tmp_path / "bare"], [clamp])


def one_object(logit_inside: float, logit_outside: float) -> tuple[RawMasks, Assignment, MaskBatch]:
    """A 32 px input with one box of 16 px whose left half is the object; one anchor learns it."""
    owners = torch.zeros(1, 32, 32, dtype=torch.uint8)
    owners[0, 8:24, 8:16] = 1
    boxes = torch.tensor([[[8.0, 8.0, 24.0, 24.0]]])
    logits = torch.full((8, 8), logit_outside)
    logits[2:6, 2:4] = logit_inside
    logits[0] = 77.0  # outside the box: nothing is taught there
    masks = RawMasks(logits[None, None], torch.ones(1, 1, 4))
    positive = torch.tensor([[False, True, False, False]])
    assignment = Assignment(positive, torch.zeros(1, 4, dtype=torch.int64), torch.zeros(1, 4, 1))
    targets = Targets(
        torch.zeros(1, 1, dtype=torch.int64), boxes, torch.zeros(1, 1, 17, 3), torch.ones(1, 1) > 0
    )
    images = torch.zeros(1, 32, 32, 3, dtype=torch.uint8)
    return masks, assignment, MaskBatch(images, targets, torch.ones(1, 1).byte(), owners)


def test_the_loss_is_the_formula_s() -> None:
    masks, assignment, batch = one_object(2.0, -1.0)
    entropy, dice = mask_losses(masks, assignment, batch, positives=9, margin=0.0).tolist()
    inside, outside = 1 / (1 + np.exp(-2.0)), 1 / (1 + np.exp(1.0))
    # Half of the box's 16 prototype pixels are the object's.
    assert entropy == pytest.approx(-(np.log(inside) + np.log(1 - outside)) / 2, rel=1e-5)
    both, sizes = 8 * inside, 8 * inside + 8 * outside + 8
    assert dice == pytest.approx(1 - (2 * both + 1) / (sizes + 1), rel=1e-5)


def test_nothing_to_learn_costs_nothing() -> None:
    masks, assignment, batch = one_object(2.0, -1.0)
    none = Assignment(assignment.positive & False, assignment.objects, assignment.scores)
    assert mask_losses(masks, none, batch, positives=9, margin=0.1).tolist() == [0.0, 0.0]


def test_a_pixel_at_the_rim_is_shared() -> None:
    owners = torch.zeros(8, 8, dtype=torch.uint8)
    owners[:3, :4] = 5
    told = shares(owners, torch.tensor([5, 9], dtype=torch.uint8))
    assert told.tolist() == [[[0.75, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.0]]]


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_run_learns_goes_on_and_leaves_the_detector_alone(config: MaskTrainConfig) -> None:
    before = digest(config.detector)
    session = MaskSession(config)
    frozen = {name: value.clone() for name, value in session.detector.state_dict().items()}
    batch = session.batch(0)
    torch.manual_seed(0)
    first = float(session.losses(batch)[0].detach())
    assert session.go(lambda _: None, lambda: session.progress.step == 2) is False
    assert load_masks(config.output / "masks.safetensors", detector=config.detector).classes
    left = json.loads((config.output / "masks.json").read_text())
    assert (left["steps"], left["validation"]) == (2, None)
    gone_on = MaskSession(config)
    assert gone_on.progress.step == 2
    reports = []
    assert gone_on.go(reports.append, lambda: False) is True
    assert reports[-1].share == 1
    torch.manual_seed(0)
    assert float(gone_on.losses(batch)[0].detach()) < 0.9 * first
    for name, value in gone_on.detector.state_dict().items():
        assert torch.equal(value, frozen[name])
    found = gone_on.finish()
    assert found is not None
    assert {c.label for c in found.classes if c.found} == PARTS
    assert sum(c.found for c in found.classes) >= 5
    assert "own" in found.table()
    loaded = load_masks(config.output / "masks.safetensors", detector=config.detector)
    assert set(loaded.classes) == {
        f"{name}/{part.detector_class}"
        for name in ASSEMBLIES
        for part in load_assembly(name).parts.values()
    }
    record = json.loads((config.output / "masks.json").read_text())
    assert record["detector_sha256"] == before == digest(config.detector)
    assert record["steps"] == 3
    assert record["validation"]["iou"] == found.iou
    assert str(config.output.parent) not in json.dumps(record)


def test_no_gradient_reaches_the_detector(config: MaskTrainConfig) -> None:
    session = MaskSession(config)
    session.step(Meter())
    assert all(p.grad is None for p in session.detector.parameters())
    assert all(p.grad is not None for p in session.branch.parameters())


def test_wrong_input_is_told(
    config: MaskTrainConfig, tmp_path: Path, another_file: Callable[[Path, Path], Path]
) -> None:
    for wrong, said in (
        ({"assemblies": ()}, "no assembly"),
        ({"data": ()}, "nothing to train on"),
        ({"minutes": 0.0}, "minutes"),
        ({"batch": 0}, "batch"),
        ({"width": 100}, "width"),
    ):
        with pytest.raises(InputError, match=said):
            MaskSession(replace(config, **wrong))
    with pytest.raises(WeightsError, match="in their order"):
        MaskSession(replace(config, assemblies=("vise",)))
    config.output.mkdir()
    session = MaskSession(config)
    session.checkpoint()
    with pytest.raises(WeightsError, match="another run folder"):
        MaskSession(
            replace(config, detector=another_file(config.detector, tmp_path / "o.safetensors"))
        )


def test_a_run_begins_with_the_branch_of_another_detector(
    config: MaskTrainConfig, tmp_path: Path, another_file: Callable[[Path, Path], Path]
) -> None:
    first = MaskSession(config)
    other = config.output.with_name("other.safetensors")
    detector = another_file(config.detector, tmp_path / "detector.safetensors")
    save_masks(first.branch, other, classes=first.classes, detector=detector)
    begun = MaskSession(replace(config, start=other, output=config.output.with_name("begun")))
    halves = {k: v.half().float() for k, v in first.branch.state_dict().items()}
    for name, value in begun.branch.state_dict().items():
        assert torch.allclose(value.float(), halves[name].float()), name
    assert begun.progress.step == 0
    with pytest.raises(WeightsError, match="gone"):
        MaskSession(replace(config, start=other.with_name("gone.safetensors")))
