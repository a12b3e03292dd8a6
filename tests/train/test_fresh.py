"""Pictures rendered by processes while a network trains."""

from __future__ import annotations

import multiprocessing
import os
import queue
from pathlib import Path

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.errors import AsdfvizError, SequenceError
from asdfviz.synth.assets import Assets
from asdfviz.train import fresh
from asdfviz.train.config import Stage
from asdfviz.train.fresh import Feeder, Feeding, FreshConfig, Painter, fed, feed
from asdfviz.train.loader import Recipe

SMALL = FreshConfig(kept=4, draws=3, width=128, height=96)
RECIPE = Recipe(stage=Stage(1.0, 96, 64, 2, 0.5), spread=1.0)


def job(**more: object) -> Feeding:
    given: dict[str, object] = {"fresh": SMALL, "seed": 3, "image_size": 128, "side": 128, **more}
    return Feeding(assemblies=("corner_clamp",), **given)  # type: ignore[arg-type]


def test_a_picture_depends_on_seed_and_number_alone() -> None:
    clamp = load_assembly("corner_clamp")
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
        assert feeder.batch(step, RECIPE).images.shape == (2, 64, 96, 3)
    # Four are there to begin with; the last of eight batches of two comes after 14 inputs.
    assert painted == 5


def test_what_ends_a_process_ends_the_training(tmp_path: Path) -> None:
    with (
        fed(job(data=(tmp_path,)), lambda _: RECIPE, first=0) as stream,
        pytest.raises(SequenceError, match="rgb"),
    ):
        next(stream)


def test_a_process_that_is_killed_ends_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fresh, "PATIENCE_S", 0.05)
    monkeypatch.setattr(fresh, "feed", _killed)
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
        fresh._next_of(_Gone(), [ended])


def _killed(*_: object) -> None:
    os._exit(3)


def test_a_failing_renderer_tells_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Painter, number: int) -> None:
        raise ValueError(f"picture {number} cannot be drawn")

    monkeypatch.setattr(Painter, "draw", fail)
    monkeypatch.setattr(fresh, "LINGERS_S", 0.0)
    told: queue.Queue[Exception] = queue.Queue()
    feed(job(first=7), 0, queue.Queue(), told)
    error = told.get()
    assert str(error) == "picture 7 cannot be drawn"
    assert "in fail" in error.__notes__[0]


def test_an_error_that_cannot_travel_is_told_in_words() -> None:
    error = ValueError("odd", lambda: None)
    assert str(fresh._sendable(error)).startswith("ValueError: ('odd', ")


def test_every_process_shows_every_assembly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers of one process go up in steps, which may share a factor with the assemblies."""
    shown: set[str] = set()

    def drawn(assets: Assets, *, rng: np.random.Generator, config: object) -> None:
        shown.add(assets.assembly.name)
        raise _NotDrawn

    monkeypatch.setattr(fresh, "draw_picture", drawn)
    two = [load_assembly(name) for name in ("corner_clamp", "vise")]
    painter = Painter(two, SMALL, seed=3)
    for number in range(0, 24, 2):
        with pytest.raises(_NotDrawn):
            painter.draw(number)
    assert shown == {"corner_clamp", "vise"}


class _NotDrawn(Exception):
    pass
