"""Parts near their places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.state.near_places import NearPlaces

T_CAMERA_BASE = transform_from(
    rotation_about(np.array([0.3, 1.0, 0.2]), 0.7), np.array([0.1, 0.0, 0.6])
)


def found(
    assembly: Assembly, name: str, at: tuple[float, ...], score: float = 0.8, tilt: float = 0.0
) -> bool:
    T_base_part = transform_from(rotation_about(np.array([1.0, 0, 0]), tilt), np.array(at))
    pose = PoseEstimate(name, T_CAMERA_BASE @ T_base_part, score, "refined")
    near = NearPlaces(assembly, in_place=0.008, near=0.06, black=40.0)
    loose = near.loose(T_CAMERA_BASE, {name: pose})
    assert not loose or loose[name] == pytest.approx(T_base_part)
    return bool(loose)


@pytest.mark.parametrize(
    ("name", "at", "is_loose"),
    [
        ("pin", (0.0, 0.1, 0.0), False),
        ("pin", (0.0, -0.095, 0.0), False),  # in an error's hole, almost
        ("pin", (0.0, 0.1, 0.02), True),
        ("pin", (0.0, 0.1, 0.07), False),  # far
        ("block", (0.125, 0.0, 0.0), False),  # it slides by 0.03
        ("block", (0.145, 0.0, 0.0), True),
        ("base", (0.0, 0.0, 0.02), False),
    ],
)
def test_a_part_is_loose_near_its_places_and_in_none(
    assembly: Assembly, name: str, at: tuple[float, ...], is_loose: bool
) -> None:
    assert found(assembly, name, at) == is_loose
    assert not found(assembly, name, at, score=0.4)


def test_a_part_that_is_turned_otherwise_has_a_doubtful_pose(assembly: Assembly) -> None:
    assert found(assembly, "pin", (0.0, 0.1, 0.02), tilt=0.2)
    assert not found(assembly, "pin", (0.0, 0.1, 0.02), tilt=0.9)


def test_of_a_black_part_it_is_never_sure(assembly: Assembly) -> None:
    """Depth has it too deep: it may be in its place all the same."""
    black = replace(assembly.parts["pin"], color=np.array([25, 25, 28], np.uint8))
    painted = replace(assembly, parts={**assembly.parts, "pin": black})
    assert not found(painted, "pin", (0.0, 0.1, 0.02))


def test_a_twins_place_is_as_good(assembly: Assembly) -> None:
    at = (0.0, 0.1, 0.02)
    pin = assembly.parts["pin"]
    twins = {**assembly.parts, "lid": replace(pin, name="lid")}
    last = assembly.states[3]
    places = {**last.T_base_part, "lid": transform_from(np.eye(3), np.array(at))}
    states = (*assembly.states[:3], replace(last, T_base_part=places), *assembly.states[4:])
    assert found(assembly, "pin", at)
    assert not found(replace(assembly, parts=twins, states=states), "pin", at)
