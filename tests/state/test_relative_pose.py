from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.state.fusion import Pose2State
from asdfviz.state.relative_pose import (
    PlaceOdds,
    RelativePoseConfig,
    relative_pose_probabilities,
)
from asdfviz.state.smoothing import StateFilter

FAR = transform_from(rotation_about(np.array([1.0, 1, 0]), 1.0), np.array([0.3, 0.2, -0.1]))


def fitting(assembly: Assembly, poses, **options) -> np.ndarray | None:
    return relative_pose_probabilities(poses, assembly, config=RelativePoseConfig(**options))


def scene(assembly: Assembly, state: int, **moved: np.ndarray) -> dict[str, np.ndarray]:
    """Every part where the state has it, the others far away."""
    Ts = {name: assembly.states[state].T_base_part.get(name, FAR) for name in assembly.parts}
    return {**Ts, **moved}


@pytest.mark.parametrize("state", range(5))
def test_every_state_is_recognised_from_its_own_poses(
    assembly: Assembly, place: Callable, state: int
) -> None:
    probabilities = fitting(assembly, place(scene(assembly, state)))
    assert probabilities is not None
    assert probabilities.sum() == pytest.approx(1.0)
    assert int(probabilities.argmax()) == state
    assert probabilities[state] > 0.7


def test_without_the_base_part_nothing_is_said(assembly: Assembly, place: Callable) -> None:
    poses = place(scene(assembly, 3))
    del poses["base"]
    assert fitting(assembly, poses) is None


def test_the_base_alone_says_nothing(assembly: Assembly, place: Callable) -> None:
    assert fitting(assembly, {}) is None
    assert fitting(assembly, place({"base": np.eye(4)})) is None


def test_the_only_state_is_said_once_the_base_was_found(
    assembly: Assembly, place: Callable
) -> None:
    only = replace(assembly, states=assembly.states[:1], transitions=frozenset())
    assert fitting(only, place({"lid": FAR})) is None
    said = fitting(only, place({"base": np.eye(4)}))
    assert said == pytest.approx(np.ones(1))
    fused, followed = Pose2State(only).step(None, said), StateFilter(only).step(None, said)
    assert fused is not None
    assert fused.index == 0
    assert followed == pytest.approx(np.ones(1))


def test_missing_parts_speak_neither_for_nor_against(assembly: Assembly, place: Callable) -> None:
    seen = scene(assembly, 3)
    poses = place({name: seen[name] for name in ("base", "block")})
    probabilities = fitting(assembly, poses)
    assert probabilities is not None
    with_block = probabilities[1:]
    assert with_block == pytest.approx(np.full(4, with_block[0]))
    assert probabilities[0] < with_block[0]


def test_a_joined_part_seen_far_away_speaks_against(assembly: Assembly, place: Callable) -> None:
    probabilities = fitting(assembly, place({"base": np.eye(4), "lid": FAR}))
    assert probabilities is not None
    assert probabilities[3] < 0.2 * probabilities[2]
    assert probabilities[:3] == pytest.approx(np.full(3, probabilities[0]))


def test_a_loose_part_seen_at_its_place_speaks_against(assembly: Assembly, place: Callable) -> None:
    lid = assembly.states[3].T_base_part["lid"]
    probabilities = fitting(assembly, place({"base": np.eye(4), "lid": lid}))
    assert probabilities is not None
    assert int(probabilities.argmax()) == 3
    assert probabilities[0] < 0.2 * probabilities[3]


def test_one_wild_pose_never_vetoes(assembly: Assembly, place: Callable) -> None:
    probabilities = fitting(assembly, place(scene(assembly, 3, block=FAR)))
    assert probabilities is not None
    assert int(probabilities.argmax()) == 3


def test_a_slide_within_the_joint_counts_as_joined(assembly: Assembly, place: Callable) -> None:
    block = assembly.states[1].T_base_part["block"]
    for travel, joined in ((0.03, True), (-0.03, True), (0.12, False)):
        T_block = block.copy()
        T_block[0, 3] += travel
        probabilities = fitting(assembly, place({"base": np.eye(4), "block": T_block}))
        assert probabilities is not None
        assert (probabilities[1] > probabilities[0]) == joined


def test_a_round_pin_may_be_turned_about_its_axis(assembly: Assembly, place: Callable) -> None:
    spun = transform_from(rotation_about(np.array([0.0, 0, 1]), 2.0), np.zeros(3))
    tipped = transform_from(rotation_about(np.array([1.0, 0, 0]), 1.5), np.zeros(3))
    pin = assembly.states[2].T_base_part["pin"]
    for T_turn, expected in ((spun, 2), (tipped, 1)):
        probabilities = fitting(assembly, place(scene(assembly, 2, pin=pin @ T_turn)))
        assert probabilities is not None
        assert int(probabilities.argmax()) == expected


def test_a_doubtful_rotation_beside_the_place_still_says_joined(
    assembly: Assembly, place: Callable
) -> None:
    turned = assembly.states[1].T_base_part["block"] @ transform_from(
        rotation_about(np.array([0.0, 0, 1]), 1.5), np.zeros(3)
    )
    poses = place({"base": np.eye(4), "block": turned})
    doubtful = {name: replace(pose, score=0.4) for name, pose in poses.items()}
    sure, unsure = fitting(assembly, poses), fitting(assembly, doubtful)
    assert sure is not None
    assert unsure is not None
    assert int(sure.argmax()) == 0
    assert unsure[1] > unsure[0]


def test_a_wider_tolerance_forgives_more(assembly: Assembly, place: Callable) -> None:
    block = assembly.states[1].T_base_part["block"].copy()
    block[1, 3] += 0.06
    poses = place({"base": np.eye(4), "block": block})
    strict, lax = fitting(assembly, poses), fitting(assembly, poses, sigma_translation=0.12)
    assert strict is not None
    assert lax is not None
    assert strict[1] < strict[0]
    assert lax[1] > lax[0]


def test_a_pose_that_is_hardly_believed_says_hardly_anything(
    assembly: Assembly, place: Callable
) -> None:
    seen = place(scene(assembly, 3))
    seen["lid"] = replace(seen["lid"], T_camera_part=FAR)
    seen["lid"] = replace(seen["lid"], score=0.02)
    doubted = fitting(assembly, seen, doubted=1.0)
    believed = fitting(assembly, seen)
    without = fitting(assembly, {n: pose for n, pose in seen.items() if n != "lid"}, doubted=1.0)
    assert doubted is not None
    assert believed is not None
    assert without is not None
    np.testing.assert_allclose(doubted, without, atol=0.02)
    assert abs(believed[3] - without[3]) > abs(doubted[3] - without[3])


def test_a_base_that_is_hardly_believed_does_not_take_everything_apart(
    assembly: Assembly, place: Callable
) -> None:
    seen = place(scene(assembly, 3))
    seen["base"] = replace(seen["base"], T_camera_part=FAR)
    believed = fitting(assembly, seen)
    assert believed is not None
    assert believed[0] > 0.5
    seen["base"] = replace(seen["base"], score=0.1)
    doubted = fitting(assembly, seen)
    assert doubted is not None
    assert doubted.max() < 1.5 / len(doubted)
    surest = fitting(assembly, seen, in_place=PlaceOdds(slope=0.0))
    assert surest is not None
    np.testing.assert_allclose(surest, 1 / len(surest), atol=0.05)


def test_scores_tell_the_place_before_the_rotation() -> None:
    told = PlaceOdds()
    assert told.probability(0.05) < 0.25
    assert told.probability(0.3) > 0.85
    assert PlaceOdds(slope=0.0).probability(0.3) == 0.3
    assert PlaceOdds(slope=0.0).probability(1.2) == 1.0


def test_poses_that_fit_to_the_last_bit_are_no_error(assembly: Assembly, place: Callable) -> None:
    seen = place(scene(assembly, 3))
    found = fitting(assembly, seen, outliers=0.0, in_place=PlaceOdds(slope=0.0))
    assert found is not None
    assert int(found.argmax()) == 3
    assert np.isfinite(found).all()
    assert PlaceOdds(offset=-2000.0).probability(0.5) < 1e-9


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"sigma_translation": 0.0}, "sigma_translation is 0"),
        ({"temperature": float("nan")}, "temperature is nan"),
        ({"outliers": 1.5}, "outliers is 1.5"),
        ({"doubted": -1.0}, "doubted is -1"),
    ],
)
def test_tolerances_that_are_none_are_refused(options: dict[str, Any], named: str) -> None:
    with pytest.raises(MethodError, match=named):
        RelativePoseConfig(**options)
    with pytest.raises(MethodError, match="in_place"):
        PlaceOdds(offset=float("nan"))


@pytest.mark.parametrize("first", ["pinion", "wheel"])
def test_a_step_of_which_one_part_is_still_out_is_not_done(place: Callable, first: str) -> None:
    caliper = load_assembly("geared_caliper")
    before, done = (state.index for state in caliper.steps[1:3])
    T_base_part = caliper.states[done].T_base_part
    half = {**scene(caliper, before), first: T_base_part[first]}
    told = fitting(caliper, place(half))
    assert told is not None
    assert told[before] > 2 * told[done]
    untold = fitting(caliper, place(half), half_done=0.0)
    assert untold is not None
    assert untold[before] < 2 * untold[done], "else this asks nothing"
    both = fitting(caliper, place(scene(caliper, done)))
    assert both is not None
    assert both[done] > 3 * both[before]


@pytest.mark.parametrize("named", ["rod", "rod-Copy"])
def test_of_twins_it_does_not_show_which_one_is_missing(place: Callable, named: str) -> None:
    clamp = load_assembly("screw_clamp")
    front, rear = (clamp.steps[i] for i in (2, 3))
    placed = {name: front.T_base_part[name] for name in ("lower_jaw", "pad")}
    alone = fitting(clamp, place({**placed, named: FAR}))
    assert alone is not None
    before = clamp.steps[1].index
    # The other one may be in, or hidden elsewhere; both cannot be in.
    assert alone[front.index] == pytest.approx(alone[before])
    assert alone[front.index] > 2 * alone[rear.index]
    other = {"rod": "rod-Copy", "rod-Copy": "rod"}[named]
    both = fitting(clamp, place({**placed, named: FAR, other: front.T_base_part["rod"]}))
    assert both is not None
    assert int(both.argmax()) == front.index
