"""What is remembered of the turns of a part, and that no verdict is final."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from
from asdfviz.methods import tracking
from asdfviz.methods.drawn_looks import DrawnConfig
from asdfviz.methods.refinding import turned
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_memory import SPUN, TURNS, TurnMemory
from asdfviz.methods.turn_table import TurnTableConfig
from asdfviz.track.confidence import Evidence
from asdfviz.track.presets import FINE
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

BEGUN = transform_from(np.diag([1.0, -1, -1]), np.array([0.0, 0.0, 0.74]))


def test_turns_that_are_behind_or_were_wrong_are_out() -> None:
    odd = rotation_about(np.array([0.0, 0, 1]), 0.8)
    memory = TurnMemory(BEGUN, (*TURNS, odd))
    np.testing.assert_array_equal(memory.out(0.35), odd[None])
    memory.lead[[2, 4, 5]] = -0.4, -0.3, -np.inf
    np.testing.assert_array_equal(memory.out(0.35), np.stack([TURNS[2], odd]))
    assert memory.wrong == (odd,)


def test_liking_counts_up_to_a_limit_and_what_is_seen_without_it() -> None:
    memory = TurnMemory(BEGUN)
    given = [memory.like(3, -0.2, 0.5) for _ in range(4)]
    np.testing.assert_allclose(given, [-0.2, -0.2, -0.1, 0.0])
    memory.lead[3] = 0.25 + sum(given)
    assert memory.seen[3] == pytest.approx(0.25)
    assert memory.ahead_seen == pytest.approx(0.25)
    config = TurnConfig(lead=0.35, lead_seen=0.2, disliked=0.0)
    assert memory.next(config) == [3]
    assert memory.rightness(3, config=config) == pytest.approx(0.05)
    # A share of what the crop network has against it is asked besides.
    config = TurnConfig(lead=0.35, lead_seen=0.2, disliked=0.5)
    assert memory.rightness(3, config=config) == pytest.approx(0.05 - 0.5 * 0.5)
    liked = TurnMemory(BEGUN)
    liked.lead[3] = 0.25 + liked.like(3, 0.05, 0.5)
    assert liked.rightness(3, config=config) == pytest.approx(0.05)
    memory.rule_out([3], lead=0.35)
    assert memory.seen[3] == memory.lead[3] == -0.35


def test_at_first_what_is_hardly_behind_is_tried_again_each_time() -> None:
    memory, config = TurnMemory(BEGUN), TurnConfig(at_first=3, near=0.1)
    assert memory.next(config) == [0, 1, 2]
    memory.last, memory.lead[:3], memory.tried[:3] = 2, [-0.08, -0.05, -0.5], True
    assert memory.next(config) == [1, 3, 4]
    assert memory.next(TurnConfig(at_first=3)) == [3, 4, 5]
    memory.tried[:] = True
    assert memory.next(config) == [3]


def test_what_is_tried_out_of_turn_passes_over_none() -> None:
    memory, config = TurnMemory(BEGUN), TurnConfig(at_first=2)
    memory.lead[2] = 0.1
    assert memory.next(config) == [2]
    memory.last, memory.lead[2], memory.tried[2] = 2, -0.3, True
    assert memory.next(config) == [0, 1]
    memory.last, memory.tried[:2] = 1, True
    assert memory.next(config) == [3, 4]


def angle(T_a: Transform, T_b: Transform) -> float:
    return rotation_angle(T_a[:3, :3].T @ T_b[:3, :3])


@pytest.mark.usefixtures("small_models")
@pytest.mark.parametrize("remembered", [6, 0])
def test_what_was_taken_for_wrong_is_tried_again(
    toy, monkeypatch: pytest.MonkeyPatch, *, remembered: int
) -> None:
    """No turn that all parts have leads back from end for end and turned besides."""
    parts = {"base": replace(toy.assembly.parts["base"])}
    bodies = tracking.load_bodies(replace(toy.assembly, parts=parts))
    frame = toy.frame(0, {})
    centre = bodies["base"].balance
    spun = turned(BEGUN, SPUN[5], centre=centre)
    seen = {"best": spun, "nearly": turned(BEGUN, TURNS[0], centre=centre)}

    def trials(_: Frame, name: str, starts: list[Transform], **__: object) -> list[Trial]:
        def fits(T: Transform) -> float:
            good = {"best": 0.9, "nearly": 0.7}
            return max([0.3, *(good[k] for k, best in seen.items() if angle(T, best) < 0.1)])

        return [Trial(T, Evidence(0.5, 0.5, 1.0), 0.5, sharp=fits(T)) for T in starts]

    tracker = Tracker(bodies, frame.camera, FINE)
    monkeypatch.setattr(tracker, "trials", trials)
    config = TurnConfig(
        remembered=remembered,
        table=TurnTableConfig(enabled=False),
        drawn=DrawnConfig(enabled=False),
    )
    checks = TurnChecks(parts, bodies, config=config)
    pose = BEGUN
    for _ in range(20):
        pose = checks.step(frame, tracker, {"base": pose}).get("base", pose)
    assert angle(pose, spun) < 0.1
    seen = {"best": BEGUN}
    for _ in range(40):
        pose = checks.step(frame, tracker, {"base": pose}).get("base", pose)
    assert (angle(pose, BEGUN) < 0.1) == (remembered > 0)


@pytest.mark.parametrize("at_first", [0, -1])
def test_how_many_turns_are_tried_at_first_must_be_some(at_first: int) -> None:
    with pytest.raises(MethodError, match="at_first"):
        TurnConfig(at_first=at_first)


@pytest.mark.parametrize("option", ["lead_seen", "near", "was", "liked_most"])
def test_leads_are_not_negative(option: str) -> None:
    with pytest.raises(MethodError, match=rf"{option} (is )?-0.1"):
        TurnConfig(**{option: -0.1})  # pyright: ignore[reportArgumentType]
