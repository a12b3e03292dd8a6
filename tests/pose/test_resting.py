"""Things come to rest where their centre of mass stands over what touches the table."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.pose.resting import center_of_mass, footprint, overlap, resting_faces, support_margin
from asdfviz.synth.primitives import box, lathe


def test_a_box_rests_on_its_six_sides_mostly_the_large_ones() -> None:
    size = np.array([0.1, 0.06, 0.03])
    faces = resting_faces(box(tuple(size)).vertices)
    assert len(faces) == 6
    share = np.zeros(3)
    for face in faces:
        axis = int(np.abs(face.R_world_part[2]).argmax())
        assert abs(face.R_world_part[2, axis]) > 0.999
        assert face.margin == pytest.approx(np.delete(size, axis).min() / 2, abs=1e-4)
        share[axis] += face.probability
    assert share.sum() == pytest.approx(1.0)
    assert share[2] > share[1] > share[0]


def test_a_top_heavy_cup_never_stands_on_its_tip() -> None:
    cone = lathe(np.array([[0.0, -0.05], [0.003, -0.05], [0.04, 0.05], [0.0, 0.05]]), segments=32)
    center = center_of_mass(cone)
    assert center[2] == pytest.approx(0.023, abs=0.004)
    faces = resting_faces(cone.vertices, center=center)
    downs = np.array([-f.R_world_part[2] for f in faces])
    assert (downs[:, 2] > -0.99).all()
    assert downs[:, 2].max() > 0.999
    for face in faces:
        assert support_margin(cone.vertices - center, -face.R_world_part[2]) == pytest.approx(
            face.margin
        )


def test_the_centre_of_mass_of_a_shifted_box() -> None:
    mesh = box((0.02, 0.04, 0.06))
    shifted = type(mesh)(mesh.vertices + np.array([0.1, -0.2, 0.3]), mesh.faces)
    assert np.allclose(center_of_mass(shifted), [0.1, -0.2, 0.3])


def test_footprints_are_counter_clockwise_and_overlap_by_their_gap() -> None:
    outline = footprint(box((0.02, 0.02, 0.02)).vertices)
    x, y = outline.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() == pytest.approx(2 * 0.02**2)
    assert not overlap(outline, outline + np.array([0.03, 0.0]), gap=0.009)
    assert overlap(outline, outline + np.array([0.03, 0.0]), gap=0.011)
