"""The vise's parts as they lie on a table, seen by a camera that shakes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.geometry.transforms import (
    apply_to_point,
    point_distance,
    rotation_about,
    transform_from,
)
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.at_rest_config import AtRestConfig

NAMES = ("body", "slider", "pad", "foot", "collar")
UP = np.array([0.0, 0.0, 1.0])
TURN = rotation_about(np.array([1.0, 0.3, 0.0]), np.deg2rad(50))
NONE: frozenset[str] = frozenset()


@pytest.fixture(scope="module")
def vise() -> Assembly:
    return load_assembly("vise")


@pytest.fixture
def rest(vise: Assembly) -> AtRest:
    return AtRest(vise, config=AtRestConfig())


def lying() -> dict[str, Transform]:
    """T_stage_part of five parts in a ring."""
    angles = 2 * np.pi * np.arange(len(NAMES)) / len(NAMES)
    places = [np.array([0.15 * np.cos(a), 0.15 * np.sin(a), 0.6]) for a in angles]
    turns = [rotation_about(UP, 0.7 * k) for k in range(len(NAMES))]
    return {n: transform_from(R, t) for n, R, t in zip(NAMES, turns, places, strict=True)}


def shaken(k: int) -> Transform:
    """T_camera_stage of a camera that goes to and fro, 17 mm a frame."""
    return transform_from(
        rotation_about(np.array([0.5, 0.0, 1.0]), 0.008 * np.sin(1.7 * k)),
        np.array([0.017 * np.sin(2.0 * k), 0.012 * np.cos(1.3 * k) - 0.012, 0.002 * np.sin(k)]),
    )


def in_place(vise: Assembly, name: str, T: Transform, R: np.ndarray) -> Transform:
    """The pose turned about the part's own middle."""
    middle = vise.parts[name].middle
    R_new = T[:3, :3] @ R
    return transform_from(R_new, apply_to_point(T, middle) - R_new @ middle)


def estimates(poses: Mapping[str, Transform], score: float = 0.9) -> dict[str, PoseEstimate]:
    return {name: PoseEstimate(name, T, score, "tracked") for name, T in poses.items()}


def play(
    rest: AtRest,
    frames: int,
    seen: Callable[[int], Mapping[str, Transform]],
    *,
    shakes: bool = True,
) -> dict[str, PoseEstimate]:
    """Show frames; what is told of the last one."""
    told: dict[str, PoseEstimate] = {}
    for k in range(frames):
        T = shaken(k) if shakes else np.eye(4)
        poses = estimates({name: T @ T_stage for name, T_stage in seen(k).items()})
        rest.see(poses, joined=NONE)
        told = rest.told(poses)
    return told


def test_the_camera_is_followed_by_what_lies_still(rest: AtRest) -> None:
    play(rest, 12, lambda k: lying())
    assert rest.T_camera_stage == pytest.approx(shaken(11) @ np.linalg.inv(shaken(0)), abs=1e-3)


def test_a_part_turned_wrongly_in_some_frames_is_told_as_most_have_it(
    vise: Assembly, rest: AtRest
) -> None:
    def seen(k: int) -> dict[str, Transform]:
        poses = lying()
        if k in (2, 5, 8, 11):
            poses["pad"] = in_place(vise, "pad", poses["pad"], TURN)
        return poses

    told = play(rest, 12, seen)
    right = rest.T_camera_stage @ lying()["pad"]
    off = symmetric_angle(told["pad"].T_camera_part, right, vise.parts["pad"].symmetries)
    assert np.rad2deg(off) < 2.0
    assert point_distance(told["pad"].T_camera_part, right, vise.parts["pad"].middle) < 0.001
    assert told["pad"].score == 0.9


def test_what_agrees_is_told_as_it_was_found(rest: AtRest) -> None:
    told = play(rest, 12, lambda k: lying())
    for name, T in lying().items():
        assert told[name].T_camera_part == pytest.approx(shaken(11) @ T, abs=1e-12)


def test_a_part_that_is_carried_away_is_told_as_it_was_found(rest: AtRest) -> None:
    def seen(k: int) -> dict[str, Transform]:
        poses = lying()
        poses["pad"][:3, 3] += [0.0, 0.0, -0.02 * max(k - 8, 0)]
        return poses

    told = play(rest, 12, seen)
    assert told["pad"].T_camera_part == pytest.approx(shaken(11) @ seen(11)["pad"], abs=1e-12)


def test_a_part_that_turns_in_its_place_is_told_as_it_was_found(
    vise: Assembly, rest: AtRest
) -> None:
    def seen(k: int) -> dict[str, Transform]:
        poses = lying()
        poses["pad"] = in_place(vise, "pad", poses["pad"], rotation_about(UP, 0.12 * k))
        return poses

    told = play(rest, 25, seen)
    assert told["pad"].T_camera_part == pytest.approx(shaken(24) @ seen(24)["pad"], abs=1e-12)


@pytest.mark.parametrize("others", [(), ("pad", "foot", "collar")])
@pytest.mark.parametrize("step", [0.003, 0.01])
def test_two_parts_that_move_as_one_are_no_camera(
    rest: AtRest, others: tuple[str, ...], step: float
) -> None:
    def seen(k: int) -> dict[str, Transform]:
        poses = {n: T for n, T in lying().items() if n in ("body", "slider", *others)}
        for name in ("body", "slider"):
            poses[name][:3, 3] += [step * max(k - 8, 0), 0.0, 0.0]
        return poses

    play(rest, 20, seen, shakes=False)
    assert np.array_equal(rest.T_camera_stage, np.eye(4))
    assert not rest.is_shaken
    assert all(rest.lies(name) for name in others)


def test_poses_that_err_do_not_move_a_camera_that_stands_still(rest: AtRest) -> None:
    rng = np.random.default_rng(2)

    def seen(k: int) -> dict[str, Transform]:
        noisy = lying()
        for T in noisy.values():
            T[:3, 3] += rng.normal(0, 0.001, 3)
        return noisy

    for _ in range(3):
        play(rest, 20, seen, shakes=False)
        assert np.array_equal(rest.T_camera_stage, np.eye(4))
        assert not rest.is_shaken


def test_a_part_lies_where_it_was_found_often_enough(rest: AtRest) -> None:
    def seen(k: int) -> dict[str, Transform]:
        poses = lying()
        poses["pad"][:3, 3] += [0.0, 0.01 * k, 0.0]  # carried
        return poses

    for frames in range(1, 24, 3):
        fresh = AtRest(load_assembly("vise"), config=AtRestConfig())
        play(fresh, frames, seen)
        assert not fresh.lies("pad")
    play(rest, 12, seen)
    assert rest.lies("foot")


def test_while_too_little_is_seen_the_camera_is_taken_to_go_on(rest: AtRest) -> None:
    play(rest, 10, lambda k: lying())
    few = {name: T for name, T in lying().items() if name in ("pad", "foot")}
    for _ in range(30):
        rest.see(estimates(few), joined=NONE)
    assert rest.is_shaken
    turned = {**few, "pad": few["pad"] @ transform_from(TURN, np.zeros(3))}
    assert rest.told(estimates(turned))["pad"].T_camera_part is turned["pad"]


@pytest.mark.parametrize("is_still", [True, False])
def test_where_few_parts_are_loose_the_base_tells_that_the_camera_has_come_to_rest(
    vise: Assembly, rest: AtRest, *, is_still: bool
) -> None:
    play(rest, 10, lambda k: lying())
    joined = frozenset(NAMES) - {vise.base, "pad"}
    was_shaken: list[bool] = []
    for k in range(10, 70):
        T = shaken(10 if is_still else k)
        rest.see(estimates({n: T @ T_stage for n, T_stage in lying().items()}), joined=joined)
        was_shaken.append(rest.is_shaken)
    assert all(was_shaken[: AtRestConfig().shaken])
    assert set(was_shaken[AtRestConfig().shaken + AtRestConfig().patience :]) == {not is_still}
    rest.see({}, joined=joined)
    assert rest.is_shaken == (not is_still)


def test_what_a_state_places_stays_and_with_it_the_base(vise: Assembly, rest: AtRest) -> None:
    play(rest, 12, lambda k: lying())
    there = {name: rest.T_camera_stage @ T for name, T in lying().items()}
    rest.see(estimates(there), joined=NONE)
    moved = dict(there)
    for name in ("body", "pad", "foot"):
        moved[name] = in_place(vise, name, there[name], rotation_about(UP, np.deg2rad(8)))
    poses = estimates(moved)
    poses["pad"] = replace(poses["pad"], stage="group")
    told = rest.told(poses)
    for name in ("body", "pad"):
        assert told[name].T_camera_part is moved[name]
    assert told["foot"].T_camera_part is not moved["foot"]


def test_what_is_not_found_for_long_is_expected_no_more(rest: AtRest) -> None:
    play(rest, 10, lambda k: lying())
    for k in range(10, 40):
        others = {name: shaken(k) @ T for name, T in lying().items() if name != "pad"}
        expected = rest.expected(estimates(others))
        assert ("pad" in expected) == (k - 10 <= AtRestConfig().absent)
        rest.see(estimates(others), joined=NONE)


def test_a_hidden_part_is_expected_where_the_others_have_the_camera(rest: AtRest) -> None:
    play(rest, 10, lambda k: lying())
    found = {name: shaken(10) @ T for name, T in lying().items() if name != "pad"}
    expected = rest.expected(estimates(found))
    moved = shaken(10) @ np.linalg.inv(shaken(0))
    assert expected["pad"] == pytest.approx(moved @ shaken(0) @ lying()["pad"], abs=1e-3)


def test_joined_parts_do_not_rest(rest: AtRest) -> None:
    play(rest, 10, lambda k: lying())
    there = estimates({name: rest.T_camera_stage @ T for name, T in lying().items()})
    rest.see(there, joined=frozenset({"pad"}))
    expected = rest.expected(there)
    assert "pad" not in expected
    assert "foot" in expected


def test_before_a_camera_that_stands_still_poses_are_told_as_they_are_found(
    vise: Assembly, rest: AtRest
) -> None:
    def seen(k: int) -> dict[str, Transform]:
        poses = lying()
        if k >= 20:
            poses["pad"] = in_place(vise, "pad", poses["pad"], TURN)
        return poses

    told = play(rest, 24, seen, shakes=False)
    assert told["pad"].T_camera_part == pytest.approx(seen(23)["pad"], abs=1e-12)
    assert rest.expected({}) == {}


def test_unsure_poses_are_not_asked(rest: AtRest) -> None:
    for k in range(10):
        poses = {name: shaken(k) @ T for name, T in lying().items()}
        rest.see(estimates(poses, score=0.1), joined=NONE)
    assert not rest.is_shaken
    assert not any(rest.lies(name) for name in NAMES)


def test_twins_that_change_names_lie_where_they_lay(rest: AtRest) -> None:
    play(rest, 10, lambda k: lying())
    there = estimates({name: rest.T_camera_stage @ T for name, T in lying().items()})
    pad = rest.expected(there)["pad"]
    rest.rename({"pad": "foot", "foot": "pad"})
    others = {name: pose for name, pose in there.items() if name not in ("pad", "foot")}
    assert rest.expected(others)["foot"] == pytest.approx(pad, abs=1e-3)


def test_it_can_be_switched_off(vise: Assembly) -> None:
    off = AtRest(vise, config=AtRestConfig(enabled=False))
    play(off, 10, lambda k: lying())
    assert off.expected({}) == {}
    assert np.array_equal(off.T_camera_stage, np.eye(4))


@pytest.mark.parametrize(
    "wrong",
    [
        {"agree": 0.0},
        {"patience": 0},
        {"fades": 1.5},
        {"sure": 0.0},
        {"share": 3.0},
        {"shaken": -1},
    ],
)
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"at_rest\."):
        AtRestConfig(**wrong)
