"""Roughly where states have parts."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.state.joined_spots import JoinedSpots

T_CAMERA_BASE = transform_from(
    rotation_about(np.array([0.3, 1.0, 0.2]), 0.7), np.array([0.1, 0.0, 0.6])
)


@pytest.mark.parametrize(
    ("name", "at", "away"),
    [
        ("pin", (0.0, 0.1, 0.0), 0.0),
        ("pin", (0.0, -0.1, 0.0), 0.0),  # an error's hole
        ("pin", (0.0, 0.1, 0.02), 0.02),
        ("block", (0.1, 0.0, 0.0), 0.0),
        ("block", (0.125, 0.0, 0.0), 0.0),  # it slides by 0.03
        ("block", (0.1, 0.05, 0.0), 0.05),
        ("base", (0.0, 0.0, 0.0), np.inf),  # nothing joins it to itself
    ],
)
def test_distance_is_that_to_the_nearest_place_beyond_its_joint(
    assembly: Assembly, name: str, at: tuple[float, float, float], away: float
) -> None:
    T = T_CAMERA_BASE @ transform_from(np.eye(3), np.array(at))
    found = JoinedSpots(assembly).distance(name, T, T_CAMERA_BASE)
    assert found == pytest.approx(away, abs=1e-9)
