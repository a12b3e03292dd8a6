from __future__ import annotations

import csv
import dataclasses
import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from asdfviz.datatypes import Assembly, Detection
from asdfviz.detector.crop_weights import load_crop_network
from asdfviz.detector.detector import Detector, DetectorConfig
from asdfviz.detector.network import Network
from asdfviz.detector.weights import load_network
from asdfviz.errors import InputError, SequenceError, WeightsError
from asdfviz.pose.labels import LabelledObject
from asdfviz.train.augment import marks_in
from asdfviz.train.checkpoint import (
    begin_from,
    keep_average,
    load_checkpoint,
    write_checkpoint,
)
from asdfviz.train.config import Stage, TrainConfig
from asdfviz.train.dataset import LabelledImage, load_images
from asdfviz.train.inputs import input_stream
from asdfviz.train.loader import Recipe
from asdfviz.train.loop import TrainResult, export_weights, train
from asdfviz.train.packing import AugmentConfig
from asdfviz.train.schedule import rate_at, stage_at
from asdfviz.train.session import Session, TrainReport
from asdfviz.train.validation import Validation, validate
from asdfviz.train.world import World


@pytest.fixture
def config(new_config: Callable[..., TrainConfig]) -> TrainConfig:
    stages = (Stage(0.5, 96, 96, 2, 1.0), Stage(0.5, 160, 96, 2, 0.5))
    return new_config(steps=6, image_size=320, stages=stages, warmup_steps=2)


def weights_of(result: TrainResult) -> dict[str, torch.Tensor]:
    return load_checkpoint(result.output / "last.pt")["network"]


def test_a_run_leaves_everything_behind(
    config: TrainConfig, scene: Path, assembly: Assembly
) -> None:
    reports: list[TrainReport] = []
    whole = dataclasses.replace(config, validation=(scene,))
    result = train(whole, assemblies=(assembly,), progress=reports.append)
    assert result.finished
    assert result.steps == 6
    assert reports[-1].step == 6
    assert all(np.isfinite(v) for v in reports[-1].losses.values())
    names = {p.name for p in config.output.iterdir()}
    assert names >= {
        "last.pt",
        "best.pt",
        "weights.safetensors",
        "log.csv",
        "curve.png",
        "config.json",
        "validation.csv",
    }
    with (config.output / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[-1]["step"] == "6"
    assert result.validation is not None
    assert [c.label for c in result.validation.classes] == list(assembly.detector_classes)
    assert "rot deg" in result.validation.table()


def test_the_keypoint_gain_weighs_keypoints_alone(config: TrainConfig, assembly: Assembly) -> None:
    losses: dict[float, dict[str, float]] = {}
    for gain in (1.0, 0.25):
        reports: list[TrainReport] = []
        one = dataclasses.replace(
            config, steps=1, keypoint_gain=gain, output=config.output / str(gain)
        )
        train(one, assemblies=(assembly,), progress=reports.append)
        losses[gain] = reports[-1].losses
    assert losses[0.25]["keypoint"] == pytest.approx(0.25 * losses[1.0]["keypoint"], rel=1e-4)
    assert losses[0.25]["classes"] == pytest.approx(losses[1.0]["classes"], rel=1e-4)


def test_weights_are_exported_and_detect(
    config: TrainConfig, assembly: Assembly, tmp_path: Path
) -> None:
    result = train(config, assemblies=(assembly,))
    path = export_weights(result.output / "best.pt", tmp_path / "weights.safetensors")
    record = json.loads(path.with_suffix(".json").read_text())
    assert record["classes"] == list(assembly.detector_classes)
    assert record["steps"] == 6
    assert record["config"]["seed"] == 0
    assert load_network(path).keypoint_width == 64
    detector = Detector(path, config=DetectorConfig(image_size=160))
    assert isinstance(detector.detect(np.zeros((90, 160, 3), np.uint8)), tuple)


def test_a_stopped_run_goes_on_as_if_nothing_had_happened(
    config: TrainConfig, assembly: Assembly, tmp_path: Path
) -> None:
    straight = train(config, assemblies=(assembly,))
    broken = dataclasses.replace(config, output=tmp_path / "broken")
    calls = iter(range(100))
    first = train(broken, assemblies=(assembly,), stop=lambda: next(calls) >= 3)
    assert (first.finished, first.steps) == (False, 3)
    assert json.loads(first.weights.with_suffix(".json").read_text())["steps"] == 3
    with pytest.raises(WeightsError, match=r"a checkpoint, .* give the \.safetensors"):
        load_network(broken.output / "last.pt")
    with pytest.raises(WeightsError, match="leaves one beside it"):
        load_crop_network(broken.output / "last.pt")
    log = broken.output / "log.csv"
    with log.open("a") as file:
        file.write("5,1.0\n")  # of steps after the checkpoint, which a kill lost
    content = load_checkpoint(broken.output / "last.pt")
    del content["trainer"]["warm_from"]  # as older checkpoints are
    write_checkpoint(broken.output / "last.pt", content)
    second = train(broken, assemblies=(assembly,))
    assert (second.finished, second.steps) == (True, 6)
    assert [row.split(",")[0] for row in log.read_text().splitlines()] == ["step", "3", "6"]
    one, other = weights_of(straight), weights_of(second)
    for name in one:
        torch.testing.assert_close(one[name], other[name], msg=name)


def test_a_carried_run_that_stops_in_its_warm_up_goes_on_in_it(
    config: TrainConfig, assembly: Assembly
) -> None:
    slow = dataclasses.replace(config, warmup_steps=8, stages=(Stage(1.0, 64, 64, 1, 1.0),))
    run = Session(slow, [assembly])
    run.progress.step = 3
    run.checkpoint()
    keep_average(run.last, run.last)
    carried = Session(slow, [assembly])
    carried.progress.step = 4
    carried.checkpoint()
    again = Session(slow, [assembly])
    stops = iter((False, True))
    again.go(lambda _: None, lambda: next(stops))
    assert again.progress.step == 5
    # The second step since the optimiser was new.
    assert again.optimizer.param_groups[0]["lr"] == pytest.approx(rate_at(slow, 1, 4 / 6))


@pytest.mark.parametrize(("best", "kept_step"), [(0.5, 2), (0.7, 1)])
def test_the_best_weights_are_chosen_by_scores_of_the_same_frames(
    config: TrainConfig,
    scene: Path,
    assembly: Assembly,
    monkeypatch: pytest.MonkeyPatch,
    best: float,
    kept_step: int,
) -> None:
    scores, counts = iter((0.9, best, 0.6)), []

    def judge(
        network: Network, images: Sequence[LabelledImage], *_: object, **__: object
    ) -> Validation:
        counts.append(len(images))
        return Validation(next(scores), ())

    monkeypatch.setattr("asdfviz.train.session.validate", judge)
    run = Session(dataclasses.replace(config, validation=(scene,)), [assembly])
    run.progress.step = 1
    run.validate(2)
    run.progress.step = 2
    run.finish()
    assert counts == [2, 8, 8]
    step, _, score = load_checkpoint(config.output / "best.pt")["progress"]
    assert (step, score) == (kept_step, max(best, 0.6))
    assert run.progress.best == score
    assert json.loads((config.output / "validation.json").read_text())["score"] == score


def test_a_run_of_another_assembly_is_not_gone_on_with(
    config: TrainConfig, assembly: Assembly
) -> None:
    train(dataclasses.replace(config, steps=1), assemblies=(assembly,))
    other = dataclasses.replace(assembly, detector_classes=("bar", "body", "toy:joined"))
    with pytest.raises(WeightsError, match="another run folder"):
        train(config, assemblies=(other,))


def test_a_run_of_another_size_is_not_gone_on_with(config: TrainConfig, assembly: Assembly) -> None:
    train(dataclasses.replace(config, steps=1), assemblies=(assembly,))
    wider = dataclasses.replace(config, keypoint_width=config.keypoint_width + 8)
    with pytest.raises(WeightsError, match=r"'n', 64, 320\), asked .*72, 320\): take another"):
        train(wider, assemblies=(assembly,))
    larger = dataclasses.replace(config, image_size=640)
    with pytest.raises(WeightsError, match=r"'n', 64, 320\), asked .*64, 640\): take another"):
        train(larger, assemblies=(assembly,))


def test_a_few_pictures_are_learned(config: TrainConfig, assembly: Assembly) -> None:
    """Thirty steps on eight pictures bring keypoints and rotations well down."""
    reports: list[TrainReport] = []
    longer = dataclasses.replace(config, stages=(Stage(1.0, 96, 96, 2, 1.0),), final_rate=1.0)
    # Each session reports its own mean: steps 1 to 4, then 5 to 24, then 25 to 30.
    for steps in (4, 24, 30):
        session = dataclasses.replace(longer, steps=steps)
        train(session, assemblies=(assembly,), progress=reports.append)
    early, late = reports[0].losses, reports[-1].losses
    for name, share in (("keypoint", 0.7), ("visibility", 0.95), ("rotation", 0.99)):
        assert late[name] < share * early[name], (name, early, late)


def test_a_loss_that_blows_up_is_named(config: TrainConfig, assembly: Assembly) -> None:
    wild = dataclasses.replace(config, learning_rate=1e30, warmup_steps=0, steps=20, clip=1e30)
    with pytest.raises(InputError, match="not finite at step"):
        train(wild, assemblies=(assembly,))


@pytest.mark.parametrize(("share", "width"), [(0.0, 96), (0.49, 96), (0.51, 160), (1.0, 160)])
def test_stages_follow_each_other(config: TrainConfig, share: float, width: int) -> None:
    assert stage_at(config.stages, share).width == width


@pytest.mark.parametrize(
    ("change", "sizes_wh"),
    [
        ({}, [(320, 192), (640, 384)]),
        ({"image_size": 320}, [(160, 96), (320, 192)]),
        ({"image_size": 480}, [(256, 160), (480, 288)]),
        ({"image_size": 480, "scale": "x-p6"}, [(256, 192), (512, 320)]),
        ({"image_size": 1280, "scale": "x-p6"}, [(640, 384), (1280, 768)]),
    ],
)
def test_stages_end_at_the_image_size(
    change: dict[str, Any], sizes_wh: list[tuple[int, int]]
) -> None:
    config = TrainConfig(assemblies=("toy",), data=(), output=Path("run"), **change)
    assert [(stage.width, stage.height) for stage in config.stages] == sizes_wh
    assert [(s.share, s.batch, s.packed) for s in config.stages] == [(0.3, 16, 1.0), (0.7, 8, 0.6)]


@pytest.mark.parametrize("sizes", [(320, 160), (160, 320)])
def test_every_picture_is_shown_as_large_as_a_detector_shows_it(
    config: TrainConfig, scene: Path, assembly: Assembly, sizes: tuple[int, int]
) -> None:
    images = [load_images([scene], (assembly,), image_size=s, limit=1)[0] for s in sizes]
    still = dataclasses.replace(
        config,
        stages=(Stage(1.0, 320, 192, 8, 0.0),),
        augment=AugmentConfig(roll_deg=0.0, zoom=1.0, shift=0.0),
    )
    recipe = Recipe(still.stages[0], spread=1.0)
    stream = input_stream(
        still, [assembly], images, world=World(), recipe=lambda _: recipe, first=0
    )
    with stream as batches:
        targets = next(batches).targets
    body = targets.boxes[targets.labels.eq(0) & targets.present]
    assert len(body) == 8
    wanted = next(o for i in images for o in i.objects if o.label == 0 and i.rgb.shape[1] == 320)
    side = np.ptp(wanted.outline, axis=0)
    np.testing.assert_allclose((body[:, 2:] - body[:, :2]).numpy(), [side] * 8, atol=1e-2)


def test_the_rate_warms_up_and_falls(config: TrainConfig) -> None:
    rates = [rate_at(config, step, step / 100) for step in range(101)]
    assert rates[0] == pytest.approx(config.learning_rate / 2, rel=1e-3)
    assert rates[1] == max(rates)
    assert rates[100] == pytest.approx(config.learning_rate * config.final_rate)


def test_objects_at_the_border_are_judged_as_they_are_taught(
    assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what is 45 % inside the part inside is wanted; what is 30 % inside may be found or not."""
    square = np.array([[0, 100], [100, 100], [100, 200], [0, 200]], np.float32)
    items = tuple(
        LabelledObject(
            0,
            square + np.array([x, 0], np.float32),
            np.ones((17, 3), np.float32),
            1.0,
            "body",
            None,
        )
        for x in (-55.0, 200.0, 610.0)
    )
    K = np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]])
    image = LabelledImage("border", "toy", np.zeros((360, 640, 3), np.uint8), K, items)
    taught = marks_in(image, np.eye(3), width=640, height=360, angle=0.0).boxes - 0.5
    assert len(taught) == 2
    boxes = [*taught, np.array([609.5, 99.5, 639.5, 199.5])]
    found = tuple(
        Detection("body", box.astype(np.float64), np.zeros((17, 2)), np.ones(17), 0.9)
        for box in boxes
    )
    scores = []
    for answer in (found, found[:2]):
        monkeypatch.setattr("asdfviz.train.validation.detect", lambda *_, a=answer, **__: a)
        network = Network("n", classes=3)
        result = validate(network, [image], [assembly], image_size=640)
        scores.append(result.classes[0])
    assert [(s.objects, s.recall, s.precision) for s in scores] == [(2, 1.0, 1.0)] * 2


def test_a_perfect_network_validates_perfectly(
    scene: Path, assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Feed the labels back as detections: recall 1, no pixel error, small pose errors."""
    from asdfviz.train import validation

    images = load_images([scene], (assembly,), image_size=640)
    by_picture = {image.rgb.tobytes(): image for image in images}

    def answer(network: object, rgb: np.ndarray, **_: object) -> tuple[Detection, ...]:
        return tuple(
            Detection(
                label=assembly.detector_classes[o.label],
                box_xyxy=np.concatenate([o.outline.min(0), o.outline.max(0)]).astype(np.float64),
                keypoints_px=o.keypoints[:, :2].astype(np.float64),
                keypoint_scores=np.ones(17),
                score=0.9,
            )
            for o in by_picture[rgb.tobytes()].objects
        )

    monkeypatch.setattr(validation, "detect", answer)
    found = validate(Network("n", classes=3), images, (assembly,), image_size=640)
    assert found.score == pytest.approx(1.0, abs=1e-3)
    for score in found.classes:
        assert (score.recall, score.precision) == (1.0, 1.0)
    body, bar, joined = found.classes
    assert (body.objects, bar.objects, joined.objects) == (8, 12, 4)
    for score in (body, bar):
        assert score.keypoint_px == pytest.approx(0.0, abs=1e-3)
        assert score.rotation_deg is not None
        assert score.rotation_deg < 0.5
    assert joined.keypoint_px is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"minutes": -1.0}, "minutes is -1, give a budget above 0"),
        ({"minutes": float("nan")}, "minutes is nan"),
        ({"keypoint_gain": -0.1}, "keypoint_gain is -0.1, give 0 or more"),
        ({"threads": 0}, "threads is 0, use 1 or more"),
        ({"image_size": 0}, "image_size is 0, use 32 or more"),
        ({"image_size": 96}, "a stage is 160 pixels wide, image_size is 96"),
        ({"keypoint_width": -4}, "keypoint_width is -4, use 0 or more"),
    ],
)
def test_an_impossible_figure_is_refused_before_the_work(
    config: TrainConfig, assembly: Assembly, change: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        train(dataclasses.replace(config, **change), assemblies=(assembly,))
    assert not (config.output / "last.pt").exists()


def test_one_network_learns_two_assemblies(
    config: TrainConfig, scene: Path, assembly: Assembly, tmp_path: Path
) -> None:
    other = dataclasses.replace(assembly, name="other")
    scenes: list[Path] = []
    for name in ("toy", "other"):
        copied = Path(shutil.copytree(scene, tmp_path / name))
        (copied / "sequence.json").write_text(json.dumps({"assembly": name}))
        scenes.append(copied)
    both = (assembly, other)
    images = load_images(scenes, both, image_size=320)
    labels = {
        name: {o.label for i in images if i.assembly == name for o in i.objects}
        for name in ("toy", "other")
    }
    assert labels["other"] == {label + 3 for label in labels["toy"]}
    joint = dataclasses.replace(config, data=tuple(scenes), validation=tuple(scenes), steps=1)
    result = train(joint, assemblies=both)
    assert result.validation is not None
    assert [c.label for c in result.validation.classes][3:] == [
        "other/body",
        "other/bar",
        "other/toy:joined",
    ]
    (scenes[0] / "sequence.json").write_text('{"assembly": "third"}')
    with pytest.raises(SequenceError, match=r"one of the assemblies that are trained: toy, other"):
        load_images(scenes, both, image_size=320)


def test_a_run_begins_from_another(config: TrainConfig, assembly: Assembly, tmp_path: Path) -> None:
    first = train(dataclasses.replace(config, steps=2), assemblies=(assembly,))
    network = Network("n", classes=6, keypoint_width=64)
    classes = [f"{name}/{c}" for name in ("new", "toy") for c in ("bar", "body", "toy:joined")]
    taken = begin_from(network, first.output / "last.pt", classes=classes)
    assert taken > 300
    learned = load_checkpoint(first.output / "last.pt")["average"]
    own = network.state_dict()
    assert torch.equal(own["model.0.conv.weight"], learned["model.0.conv.weight"])
    last = "model.22.cv3.0.2.weight"
    assert torch.equal(own[last][[0, 1, 2]], learned[last][[1, 0, 2]])
    again = Network("n", classes=6, keypoint_width=64)
    weights = export_weights(first.output / "last.pt", tmp_path / "weights.safetensors")
    assert begin_from(again, weights, classes=classes) == taken
    rows = [tensors[last][[0, 1, 2]].half() for tensors in (again.state_dict(), own)]
    assert torch.equal(*rows)
    with pytest.raises(WeightsError, match="of size n, asked for was x"):
        begin_from(Network("x", classes=2), first.output / "last.pt", classes=["a", "b"])


def test_what_is_no_checkpoint_is_said_to_be_none(tmp_path: Path) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("learn from this")
    with pytest.raises(WeightsError, match=r"notes\.txt' is no checkpoint") as told:
        load_checkpoint(text)
    assert "weights_only" not in str(told.value)  # torch would have it unpickled whatever it does


def test_data_of_another_assembly_are_refused(
    config: TrainConfig, scene: Path, assembly: Assembly, tmp_path: Path
) -> None:
    packs = Path(shutil.copytree(scene, tmp_path / "packs"))
    given = dataclasses.replace(config, data=(packs,), steps=1)
    hook = dataclasses.replace(assembly.parts["bar"], name="hook", detector_class="hook")
    other = dataclasses.replace(
        assembly, parts={"hook": hook}, detector_classes=("hook",), states=()
    )
    with pytest.raises(SequenceError, match="no part of toy is seen in"):
        train(given, assemblies=(other,))
    about = packs / "sequence.json"
    about.write_text(json.dumps({"assembly": "my_clip"}))
    with pytest.raises(SequenceError, match=r"packs is of my_clip, not of .* trained: toy"):
        train(given, assemblies=(assembly,))
    here = dataclasses.replace(assembly, path=str(tmp_path / "toy" / "assembly.yaml"))
    for place in ("../toy", "/on/another/machine/toy/assembly.yaml"):  # where it lies, where it lay
        about.write_text(json.dumps({"assembly": place}))
        assert load_images((packs,), assemblies=(here,), image_size=64)
    assert train(given, assemblies=(here,)).finished


def test_nothing_to_train_on_is_refused(config: TrainConfig) -> None:
    with pytest.raises(InputError, match="nothing to train on"):
        train(dataclasses.replace(config, data=()))
