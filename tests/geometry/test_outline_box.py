"""The box around projected points."""

import numpy as np
import pytest

from asdfviz.geometry.camera import project
from asdfviz.geometry.outline_box import NEAREST, outline_box
from asdfviz.geometry.transforms import apply, rotation_about, transform_from

K = np.array([[600.0, 0.5, 320], [0, 610, 240], [0, 0, 1]])


def test_it_holds_every_point_and_no_more() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(200, 3)) * 0.05
    T = transform_from(rotation_about(rng.normal(size=3), 0.7), np.array([0.05, -0.1, 0.6]))
    pixels = project(apply(T, points), K)
    box = outline_box(T, points, K)
    assert box == pytest.approx(np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]))


def test_what_is_too_near_is_projected_from_the_nearest_distance() -> None:
    box = outline_box(np.eye(4), np.array([[0.01, 0.02, -1.0]]), K)
    u, v = project(np.array([[0.01, 0.02, NEAREST]]), K)[0]
    assert box == pytest.approx([u, v, u, v])
