from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.train.config import Stage, TrainConfig, check_config
from asdfviz.train.loader import Recipe
from asdfviz.train.loop import train
from asdfviz.train.session import Session


@pytest.fixture
def config(new_config: Callable[..., TrainConfig]) -> TrainConfig:
    stages = (Stage(0.5, 32, 32, 2, 1.0), Stage(0.5, 64, 64, 2, 0.5))
    return new_config(steps=10, closing=0.2, image_size=64, stages=stages)


def test_a_run_ends_on_whole_frames(config: TrainConfig, assembly: Assembly) -> None:
    run = Session(config, [assembly])
    shares = [run.recipe(step).stage.packed for step in range(10)]
    assert shares == [1.0] * 5 + [0.5] * 3 + [0.0] * 2
    assert run.recipe(9).stage.width == 64
    open_end = Session(dataclasses.replace(config, closing=0.0), [assembly])
    assert open_end.recipe(9).stage.packed == open_end.recipe(10).stage.packed == 0.5


def test_a_run_that_goes_on_in_its_end_stays_on_whole_frames(
    config: TrainConfig, assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[int, float]] = []
    first = Session.recipe

    def recipe(run: Session, step: int) -> Recipe:
        found = first(run, step)
        made.append((step, found.stage.packed))
        return found

    calls = iter(range(100))
    assert not train(config, assemblies=(assembly,), stop=lambda: next(calls) >= 9).finished
    monkeypatch.setattr(Session, "recipe", recipe)
    assert train(config, assemblies=(assembly,)).finished
    assert made[0] == (9, 0.0)


def test_of_a_run_by_the_clock_the_last_tenth_is_closed_unless_told_otherwise(
    config: TrainConfig, assembly: Assembly
) -> None:
    timed = TrainConfig(
        ("toy",), config.data, config.output, minutes=100.0, image_size=64, stages=config.stages
    )
    run = Session(timed, [assembly])
    run.progress.seconds = 95 * 60.0
    run._budget.before = 95 * 60.0  # pyright: ignore[reportPrivateUsage] - 95 minutes pass
    run.checkpoint()
    assert Session(timed, [assembly]).recipe(0).stage.packed == 0.0


@pytest.mark.parametrize("closing", [-0.1, 1.1, float("nan")])
def test_a_closing_share_that_is_none_is_refused(config: TrainConfig, closing: float) -> None:
    with pytest.raises(InputError, match=r"closing is .*, give a share from 0 to 1"):
        check_config(dataclasses.replace(config, closing=closing))
