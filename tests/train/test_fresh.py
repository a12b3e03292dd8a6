"""Pictures rendered by processes while a network trains."""

from __future__ import annotations

import multiprocessing
import os
import queue
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.errors import AsdfvizError, SequenceError
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.train import feeding, fresh
from asdfviz.train.config import Stage
from asdfviz.train.device_cut import PicturePool
from asdfviz.train.feeding import Feeder, Feeding, fed, feed
from asdfviz.train.fresh import FreshConfig, Painter
from asdfviz.train.loader import Batch, Recipe
from asdfviz.train.packing import AugmentConfig
from asdfviz.train.patches import ColorConfig

SMALL = FreshConfig(kept=4, draws=3, width=128, height=96)
RECIPE = Recipe(stage=Stage(1.0, 96, 64, 2, 0.5), spread=1.0)


load_once = cache(load_assembly)


@pytest.fixture(scope="module", autouse=True)
def loaded_once() -> Iterator[None]:
    """Meshes and resting faces are the same for all feeders of this process; others load their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(feeding, "load_assembly", load_once)
        patch.setattr(fresh, "load_assets", cache(load_assets))
        yield


def job(**more: object) -> Feeding:
    given: dict[str, object] = {"fresh": SMALL, "seed": 3, "image_size": 128, "side": 128, **more}
    return Feeding(assemblies=("corner_clamp",), **given)  # type: ignore[arg-type]


def test_a_picture_depends_on_seed_and_number_alone() -> None:
    clamp = load_once("corner_clamp")
    painter = Painter([clamp], SMALL, seed=3)
    first, second, again = (painter.draw(number) for number in (0, 1, 0))
    assert np.array_equal(first.rgb, again.rgb)
    assert not np.array_equal(first.rgb, second.rgb)
    assert first.objects


def test_shares_say_what_is_rendered() -> None:
    kinds = dict.fromkeys(("scenes", "packs", "groups"), 0.0)
    for name, (share, _) in zip(
        kinds, FreshConfig(10, scenes=0.4, grouped=0.25).kinds(), strict=True
    ):
        kinds[name] = share
    assert kinds == pytest.approx({"scenes": 0.4, "packs": 0.45, "groups": 0.15})


def test_each_picture_is_drawn_from_so_often_in_the_mean() -> None:
    feeder = Feeder(job(), 0)
    painted = 0
    for step in range(8):
        while feeder.wants_pictures:
            feeder.paint()
            painted += 1
        batch = feeder.batch(step, RECIPE)
        assert isinstance(batch, Batch)
        assert batch.images.shape == (2, 64, 96, 3)
    # Four are there to begin with; the last of eight batches of two comes after 14 inputs.
    assert painted == 5


def test_a_batch_that_is_cut_where_the_training_is_is_the_one_of_its_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every picture is renewed here; what a plan names is there when it comes."""
    quiet = AugmentConfig(colors=ColorConfig(noise=0.0))
    small = FreshConfig(kept=2, draws=2, width=128, height=96)
    made = Feeder(job(fresh=small, augment=quiet), 0)
    told: queue.Queue[object] = queue.Queue()
    planning = Feeder(job(fresh=small, augment=quiet, cut_on="cpu"), 0)
    pool = PicturePool("cpu")
    for step in range(5):
        while planning.wants_pictures:
            told.put(planning.paint())
        told.put(planning.batch(step, RECIPE))
        while made.wants_pictures:
            made.paint()
        monkeypatch.setattr(feeding, "RENEW_EVERY", 1)
        wanted = made.batch(step, RECIPE)
        found = feeding._next_of(_Told(told), [], pool)
        assert isinstance(wanted, Batch)
        assert torch.equal(found.targets.boxes, wanted.targets.boxes)
        assert torch.equal(found.rotations, wanted.rotations)
        assert (found.images.float() - wanted.images.float()).abs().mean() < 0.5
    assert len(pool._places) == 2


class _Told:
    """A queue of this process."""

    def __init__(self, told: queue.Queue[object]) -> None:
        self._told = told

    def get(self, timeout: float) -> object:
        return self._told.get_nowait()


def test_processes_feed_a_training_that_cuts_its_inputs() -> None:
    with fed(job(cut_on="cpu", processes=2), lambda _: RECIPE, first=0) as stream:
        batches = [next(stream) for _ in range(6)]
    assert {tuple(batch.images.shape) for batch in batches} == {(2, 64, 96, 3)}
    assert len({batch.images.numpy().tobytes() for batch in batches}) == 6


def test_what_ends_a_process_ends_the_training(tmp_path: Path) -> None:
    with (
        fed(job(data=(tmp_path,)), lambda _: RECIPE, first=0) as stream,
        pytest.raises(SequenceError, match="rgb"),
    ):
        next(stream)


def test_a_process_that_is_killed_ends_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeding, "PATIENCE_S", 0.05)
    monkeypatch.setattr(feeding, "feed", _killed)
    with (
        fed(job(), lambda _: RECIPE, first=0) as stream,
        pytest.raises(AsdfvizError, match=r"exit code 3\): with fewer loaders"),
    ):
        next(stream)


class _Gone:
    """A queue whose sender is no more."""

    def get(self, timeout: float) -> None:
        raise ConnectionRefusedError(111, "Connection refused")


def test_what_a_killed_process_left_in_the_queue_does_not_hide_it() -> None:
    ended = multiprocessing.get_context("spawn").Process()  # never begun is not alive, too
    with pytest.raises(AsdfvizError, match="with fewer loaders"):
        feeding._next_of(_Gone(), [ended])


def _killed(*_: object) -> None:
    os._exit(3)


def test_a_failing_renderer_tells_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Painter, number: int) -> None:
        raise ValueError(f"picture {number} cannot be drawn")

    monkeypatch.setattr(Painter, "draw", fail)
    monkeypatch.setattr(feeding, "LINGERS_S", 0.0)
    told: queue.Queue[Exception] = queue.Queue()
    feed(job(first=7), 0, queue.Queue(), told)
    error = told.get()
    assert str(error) == "picture 7 cannot be drawn"
    assert "in fail" in error.__notes__[0]


def test_an_error_that_cannot_travel_is_told_in_words() -> None:
    error = ValueError("odd", lambda: None)
    assert str(feeding._sendable(error)).startswith("ValueError: ('odd', ")


def test_every_process_shows_every_assembly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers of one process go up in steps, which may share a factor with the assemblies."""
    shown: set[str] = set()

    def drawn(assets: Assets, *, rng: np.random.Generator, config: object) -> None:
        shown.add(assets.assembly.name)
        raise _NotDrawn

    monkeypatch.setattr(fresh, "draw_picture", drawn)
    two = [load_once(name) for name in ("corner_clamp", "vise")]
    painter = Painter(two, SMALL, seed=3)
    for number in range(0, 24, 2):
        with pytest.raises(_NotDrawn):
            painter.draw(number)
    assert shown == {"corner_clamp", "vise"}


class _NotDrawn(Exception):
    pass
