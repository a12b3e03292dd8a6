"""A part of the sample that was put in its place in some turn, settled in the turn that it has."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Frame, Part
from asdfviz.errors import Stopped
from asdfviz.geometry.shapes import Rotation, Transform
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.geometry.transforms import (
    apply_to_point,
    point_distance,
    rotation_about,
    transform_from,
)
from asdfviz.methods.tracking import load_bodies
from asdfviz.methods.turned_fits import TurnedConfig, fitted_in_any_turn
from asdfviz.track.bodies import Body
from asdfviz.track.fitting import fitted

UPRIGHT = np.diag([1.0, -1.0, -1.0])
"""As a click puts a part that was nowhere before."""
OVER = rotation_about(np.array([1.0, 0.4, 0.2]), 2.0)


@cache
def seen(part: str, place: int = 0) -> tuple[Frame, Transform, Part, Body]:
    sequence = open_sequence("sample")
    truth = sequence.truth(place)
    assert sequence.assembly is not None
    assert truth is not None
    frame = sequence[place]
    body = load_bodies(sequence.assembly)[part]
    return frame, truth.T_camera_part[part], sequence.assembly.parts[part], body


def put(T: Transform, part: Part, frame: Frame, R: Rotation) -> Transform:
    """The part's middle at the depth that is measured where it is seen."""
    assert frame.depth is not None
    middle = apply_to_point(T, part.middle)
    u, v = np.rint((frame.camera.K @ middle)[:2] / middle[2]).astype(int)
    near = frame.depth[v - 4 : v + 5, u - 4 : u + 5]
    at = middle / middle[2] * float(np.median(near[near > 0]))
    return transform_from(R, at - R @ part.middle)


@pytest.mark.parametrize("R", [UPRIGHT, OVER], ids=["upright", "over"])
@pytest.mark.parametrize("name", ["base", "jaw", "bolt"])
def test_a_part_that_was_put_in_a_wrong_turn_is_turned_right(name: str, R: Rotation) -> None:
    frame, T, part, body = seen(name)
    start = put(T, part, frame, R)
    if R is UPRIGHT:
        near = fitted(frame, start, body=body, camera=frame.camera)
        assert near is None or symmetric_angle(near.T_camera_part, T, part.symmetries) > 0.3
    found = fitted_in_any_turn(frame, start, part=part, body=body)
    assert found is not None
    assert symmetric_angle(found.T_camera_part, T, part.symmetries) < np.deg2rad(8)
    assert point_distance(found.T_camera_part, T, part.middle) < 0.005


@pytest.mark.parametrize("name", ["base", "jaw", "bolt"])
def test_a_part_that_was_put_about_right_goes_where_it_is_settled_nearby(name: str) -> None:
    frame, T, part, body = seen(name, 5)
    R = rotation_about(np.array([0.2, 1.0, -0.4]), 0.1) @ T[:3, :3]
    at = apply_to_point(T, part.middle) + np.array([0.004, -0.003, 0.006])
    start = transform_from(R, at - R @ part.middle)
    near = fitted(frame, start, body=body, camera=frame.camera)
    found = fitted_in_any_turn(frame, start, part=part, body=body)
    assert near is not None
    assert found is not None
    np.testing.assert_array_equal(found.T_camera_part, near.T_camera_part)


def test_what_fits_as_well_in_another_turn_or_hardly_fits_is_doubted() -> None:
    frame, T, part, body = seen("bolt")
    found = fitted_in_any_turn(frame, T, part=part, body=body)
    assert found is not None
    assert found.doubt is None
    for config, doubt in (
        (TurnedConfig(alike=2.0), "alike"),
        (TurnedConfig(poor=1.01), "poor"),
    ):
        found = fitted_in_any_turn(frame, T, part=part, body=body, config=config)
        assert found is not None
        assert found.doubt == doubt


def test_without_depth_other_turns_are_not_tried_which_is_said() -> None:
    frame, T, part, body = seen("jaw")
    found = fitted_in_any_turn(replace(frame, depth=None), T, part=part, body=body)
    assert found is not None
    assert found.doubt == "untried"


def test_a_part_is_not_taken_far_from_where_it_was_put() -> None:
    frame, T, part, body = seen("bolt")
    far = put(T, part, frame, OVER)
    far[:3, 3] += [0.12, 0.0, 0.0]
    found = fitted_in_any_turn(frame, far, part=part, body=body)
    if found is not None:
        radii, more = TurnedConfig().farthest
        reach = float(np.linalg.norm(part.mesh.vertices - part.middle, axis=1).max())
        assert point_distance(found.T_camera_part, far, part.middle) <= radii * reach + more


def test_it_can_be_stopped() -> None:
    frame, T, part, body = seen("bolt")
    with pytest.raises(Stopped):
        fitted_in_any_turn(frame, T, part=part, body=body, stop=lambda: True)
