from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from asdfviz.cli.learn import Train
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError, WeightsError
from asdfviz.train.checkpoint import load_checkpoint
from asdfviz.train.config import Stage, TrainConfig
from asdfviz.train.dataset import load_images
from asdfviz.train.loop import train
from asdfviz.train.presets import EPOCHS, IMAGES, paper_preset
from asdfviz.train.session import Session
from asdfviz.train.split import hold_out
from asdfviz.train.validation import Validation


@pytest.fixture
def config(new_scene: Callable[[int], Path], tmp_path: Path) -> TrainConfig:
    return paper_preset(
        TrainConfig(
            assemblies=("toy",),
            data=(new_scene(10),),
            output=tmp_path / "run",
            image_size=64,
            stages=(Stage(1.0, 64, 64, 4, 0.5),),
            keypoint_width=64,
            minutes=1000.0,
        )
    )


def answers(monkeypatch: pytest.MonkeyPatch, scores: Sequence[float]) -> list[tuple[str, ...]]:
    """Let validations answer with these scores; returns the pictures that each was asked for."""
    asked: list[tuple[str, ...]] = []
    left: Iterator[float] = iter(scores)

    def judge(_: object, images: Sequence[Any], *__: object, **___: object) -> Validation:
        asked.append(tuple(image.name for image in images))
        return Validation(next(left), ())

    monkeypatch.setattr("asdfviz.train.session.validate", judge)
    return asked


def test_one_picture_in_five_is_held_out_and_stays_so_while_the_folder_grows(
    new_scene: Callable[[int], Path], assembly: Assembly
) -> None:
    images = load_images([new_scene(20)], (assembly,), image_size=64)
    kept, held = hold_out(images, every=5, seed=3)
    assert (len(kept), len(held)) == (16, 4)
    assert {image.name for image in (*kept, *held)} == {image.name for image in images}
    assert sorted(int(image.name[-6:]) // 5 for image in held) == [0, 1, 2, 3]
    names = [image.name for image in held]
    assert [image.name for image in hold_out(images[:10], every=5, seed=3)[1]] == names[:2]
    others = [[i.name for i in hold_out(images, every=5, seed=s)[1]] for s in range(4)]
    assert len({tuple(other) for other in others}) > 1
    with pytest.raises(InputError, match="left to validate on: give more pictures"):
        hold_out([image for image in images if image not in held], every=5, seed=3)


def test_the_preset_is_the_papers(config: TrainConfig) -> None:
    assert config.losses.keypoints == "l2"
    assert (config.epochs, config.held_out, config.rotation_gain) == (300, 5, 0.0)


@pytest.mark.parametrize(("field", "value"), [("fresh", 10), ("validation", (Path("other"),))])
def test_the_preset_has_pictures_of_its_own(config: TrainConfig, field: str, value: object) -> None:
    with pytest.raises(InputError, match="leave validation and fresh out"):
        paper_preset(dataclasses.replace(config, **{field: value}))


def test_a_run_stops_early_and_says_what_ran(
    config: TrainConfig, assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight pictures are two steps: validations after epochs 1 to 4, of which the second is best."""
    asked = answers(monkeypatch, (0.1, 0.3, 0.2, 0.2, 0.3, 0.2))
    short = dataclasses.replace(config, patience=2)
    result = train(short, assemblies=(assembly,))
    assert result.finished
    assert result.ran is not None
    assert (result.ran.images, result.ran.of_epochs) == ({"toy": 10}, EPOCHS)
    assert 4 <= result.ran.epochs <= 4.5  # the step after the validation is the last one
    assert result.ran.text() == (
        f"paper preset: 10 of {IMAGES:,} images an assembly, 4.5 of 300 epochs, "
        "stopped early, 2 epochs without a better validation"
    )
    held = {name for names in asked for name in names}
    assert len(held) == 2
    assert load_checkpoint(config.output / "best.pt")["progress"][0] == 4
    record = json.loads(result.weights.with_suffix(".json").read_text())
    assert record["ran"]["text"] == result.ran.text()
    assert record["ran"]["of_images"] == IMAGES
    answers(monkeypatch, (0.3, 0.2))
    again = train(short, assemblies=(assembly,))
    assert (again.finished, again.steps) == (True, result.steps)


def test_early_stopping_goes_on_counting_where_a_run_was_interrupted(
    config: TrainConfig, assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, (0.3, 0.2, 0.2, 0.2, 0.3, 0.2))
    short = dataclasses.replace(config, patience=3)
    calls = iter(range(100))
    first = train(short, assemblies=(assembly,), stop=lambda: next(calls) >= 5)
    assert first.ran is not None
    assert (first.ran.epochs, first.ran.ended) == (2.5, "interrupted")
    second = train(short, assemblies=(assembly,))
    assert second.ran is not None
    assert second.ran.epochs == 4.5
    assert second.ran.ended.startswith("stopped early")


def test_a_run_ends_after_its_epochs_or_at_its_limit(
    config: TrainConfig, assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, (0.1,) * 9)
    ended = {}
    for name, change in (("all", {"epochs": 1}), ("steps", {"steps": 1}), ("time", {})):
        one = dataclasses.replace(config, output=config.output / name, **change)
        if name == "time":
            one = dataclasses.replace(one, minutes=1e-6)
        ran = train(one, assemblies=(assembly,)).ran
        assert ran is not None
        ended[name] = (ran.epochs, ran.ended)
    assert ended["all"] == (1.0, "to the end")
    assert ended["steps"] == (0.5, "ended by the limit of 1 steps")
    assert ended["time"][1] == "ended by the limit of 1e-06 minutes"


def test_pictures_that_were_learnt_are_not_held_out_later(
    config: TrainConfig, assembly: Assembly
) -> None:
    Session(dataclasses.replace(config, held_out=0, epochs=None), [assembly]).checkpoint()
    with pytest.raises(WeightsError, match="may have learnt pictures that are to be held out"):
        Session(config, [assembly])
    content = dataclasses.replace(config, output=config.output / "new")
    Session(content, [assembly]).checkpoint()
    Session(content, [assembly])
    with pytest.raises(WeightsError, match="keep preset and seed"):
        Session(dataclasses.replace(content, seed=1), [assembly])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"epochs": 0}, "epochs is 0, patience 50, give 1 or more of each"),
        ({"patience": 0}, "patience 0, give 1 or more"),
        ({"held_out": 1}, "held_out is 1, give 0 or one in 2 to 100"),
        ({"fresh": 4}, "leave fresh out"),
        ({"validation": (Path("other"),)}, "leave validation out"),
    ],
)
def test_an_impossible_figure_is_refused(
    config: TrainConfig, assembly: Assembly, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        train(dataclasses.replace(config, **change), assemblies=(assembly,))


def test_the_command_line_says_what_share_of_the_paper_ran(
    new_scene: Callable[[int], Path],
    assembly: Assembly,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("asdfviz.train.loop.load_assembly", lambda _: assembly)
    command = Train(
        assembly=("toy",),
        out=tmp_path / "run",
        data=(new_scene(10),),
        preset="paper",
        minutes=1e-6,
        image_size=64,
    )
    command()
    said = "paper preset: 10 of 20,000 images an assembly, 0.0 of 300 epochs, ended by the limit of"
    assert said in capsys.readouterr().err
    with pytest.raises(InputError, match="leave --loss oks out"):
        dataclasses.replace(command, loss="oks")()
