"""Parts that were found loose, and then by no one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.state.fusion import FusionConfig, Pose2State
from asdfviz.state.held_back import held_back
from asdfviz.state.lately_loose import LatelyLoose, LatelyLooseConfig

Place = Callable[[Mapping[str, Transform]], dict[str, PoseEstimate]]


def at(x: float, y: float, z: float) -> Transform:
    return transform_from(np.eye(3), np.array([x, y, z]))


HOLE, WRONG, TABLE = at(0, 0.1, 0), at(0, -0.1, 0), at(0.2, 0.2, 0)
BASE = np.eye(4)


def told(likely: np.ndarray | None, state: int) -> float:
    """How likely a state is against the most likely one."""
    return 1.0 if likely is None else float(likely[state] / likely.max())


def follow(
    lately: LatelyLoose,
    place: Place,
    *shown: tuple[Mapping[str, Transform], int],
    score: float = 1.0,
) -> np.ndarray | None:
    """Show these poses for so many frames each; what it says in the last one."""
    said = None
    for places, frames in shown:
        poses = {n: replace(p, score=score) for n, p in place({"base": BASE, **places}).items()}
        for _ in range(frames):
            said = lately.step(poses, None)
    return said


def test_what_lies_loose_is_not_joined(assembly: Assembly, place: Place) -> None:
    said = follow(LatelyLoose(assembly, config=LatelyLooseConfig()), place, ({"pin": TABLE}, 12))
    assert said is not None
    assert said.sum() == pytest.approx(1.0)
    assert [told(said, k) for k in (0, 1)] == [1.0, 1.0]
    assert all(told(said, k) < 0.15 for k in (2, 3, 4))  # the error joins it, too


def test_what_nobody_sees_arrives_in_time(assembly: Assembly, place: Place) -> None:
    lately = LatelyLoose(assembly, config=LatelyLooseConfig())
    follow(lately, place, ({"pin": TABLE}, 12))
    chances = [told(follow(lately, place, ({}, 1)), 2) for _ in range(40)]
    assert chances[0] < 0.3
    assert all(a <= b for a, b in pairwise(chances))
    assert chances[-1] == 1.0
    assert follow(lately, place, ({}, 1)) is None


def test_one_false_sighting_says_nothing(assembly: Assembly, place: Place) -> None:
    lately = LatelyLoose(assembly, config=LatelyLooseConfig())
    assert follow(lately, place, ({}, 20), ({"pin": TABLE}, 1)) is None


@pytest.mark.parametrize("hole", [HOLE, WRONG])
def test_what_is_seen_in_a_place_is_joined(
    assembly: Assembly, place: Place, hole: Transform
) -> None:
    lately = LatelyLoose(assembly, config=LatelyLooseConfig())
    assert follow(lately, place, ({"pin": TABLE}, 12), ({"pin": hole}, 3)) is None


@pytest.mark.parametrize(
    ("found", "score", "stage"),
    [
        ({"pin": at(0, 0.13, 0)}, 1.0, "refined"),
        ({"pin": TABLE}, 0.3, "refined"),
        ({"pin": TABLE}, 1.0, "group"),
    ],
    ids=["near its place", "unsure", "told by the state"],
)
def test_what_may_be_joined_says_nothing(
    assembly: Assembly, place: Place, found: dict[str, Transform], score: float, stage: str
) -> None:
    lately = LatelyLoose(assembly, config=LatelyLooseConfig())
    poses = {
        n: replace(p, score=score, stage=stage) for n, p in place({"base": BASE, **found}).items()
    }
    for _ in range(20):
        assert lately.step(poses, None) is None


def test_without_the_base_nothing_is_counted(assembly: Assembly, place: Place) -> None:
    poses = place({"pin": TABLE})
    lately = LatelyLoose(assembly, config=LatelyLooseConfig())
    assert all(lately.step(poses, None) is None for _ in range(20))
    off = LatelyLoose(assembly, config=LatelyLooseConfig(enabled=False))
    poses = place({"base": BASE, "pin": TABLE})
    assert all(off.step(poses, None) is None for _ in range(20))


@pytest.mark.parametrize("slow", [True, False])
def test_the_steps_before_tell_how_long_a_part_is_on_its_way(
    assembly: Assembly, place: Place, slow: bool
) -> None:
    lately, poses = LatelyLoose(assembly, config=LatelyLooseConfig()), place({"base": BASE})
    loose = place({"base": BASE, "lid": TABLE})
    for frame in range(90 if slow else 15):
        lately.step(loose, np.eye(5)[min(frame // (45 if slow else 5), 2)])
    said = [told(lately.step(poses, np.eye(5)[2]), 3) for _ in range(10)]
    assert (0.4 < said[-1] < 0.8) if slow else (said[-1] == 1.0)


def test_twins_count_together(assembly: Assembly, place: Place) -> None:
    """Two blocks that go in one after the other: one of them on the table says that not both are in."""
    block = assembly.parts["block"]
    parts = {**assembly.parts, "twin": replace(block, name="twin")}
    states = [
        replace(s, T_base_part={**s.T_base_part, "twin": WRONG}) if s.index == 3 else s
        for s in assembly.states
    ]
    twins = replace(assembly, parts=parts, states=tuple(states))
    lately = LatelyLoose(twins, config=LatelyLooseConfig())
    said = follow(
        lately, place, ({"block": TABLE, "twin": at(0.3, 0, 0)}, 12), ({"block": TABLE}, 40)
    )
    assert told(said, 1) == 1.0  # one may be in
    assert told(said, 3) < 0.15
    said = follow(lately, place, ({"twin": at(0.1, 0, 0), "block": WRONG}, 4))
    assert said is None


def test_what_a_state_lacks_counts_to_the_step_before(assembly: Assembly) -> None:
    scores = np.array([0.1, 0.1, 0.3, 0.3, 0.2])
    result = held_back(scores, np.array([0.3, 0.3, 0.15, 0.1, 0.15]), assembly)
    # From 3 two thirds, half of which are too early for 2 as well; and of the error half.
    assert result == pytest.approx([0.1, 0.1 + 0.25 + 0.1, 0.25, 0.1, 0.1])
    assert scores[3] == 0.3
    all_late = held_back(scores, np.array([1.0, 0, 0, 0, 0]), assembly)
    assert all_late == pytest.approx([1.0, 0, 0, 0, 0])


def test_pose2state_takes_it_in_and_keeps_it_as_a_term(assembly: Assembly) -> None:
    looks = np.array([0.05, 0.05, 0.8, 0.05, 0.05])
    loose = np.array([0.45, 0.45, 0.04, 0.03, 0.03])
    fusion = Pose2State(assembly, config=FusionConfig(sharpness=1.0))
    said = fusion.step(looks, None, loose)
    assert said is not None
    assert said.index == 1
    assert said.terms["lately_loose"] is loose
    assert said.probabilities == pytest.approx(held_back(looks, loose, assembly))
    nothing_seen = Pose2State(assembly).step(None, None, loose)
    assert nothing_seen is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"found": 1.5}, "found is 1.5, use 0 to 1"),
        ({"away": 0.01}, "in_place is 0.02 and away 0.01"),
        ({"gain": -1.0}, "gain is -1, use 0 or more"),
        ({"steps": 0.0}, "steps is 0, use more than 0"),
        ({"step_frames": float("nan")}, "step_frames is nan"),
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(MethodError, match=message):
        LatelyLooseConfig(**options)
