"""Where nails are on a hand."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.synth.hands import GRASPS, OPEN_HAND, hand_mesh
from asdfviz.synth.nails import FAR, Fingertip, nail_marks

TIP = Fingertip(np.zeros(3), np.array([0.0, 0.02, 0.0]), 0.008, np.array([0.0, 0.5, 2.0]))


def test_a_nail_lies_on_the_back_of_a_fingertip() -> None:
    places = np.array(
        [
            [0.0, 0.016, 0.007],  # its middle
            [0.0, 0.016, -0.007],  # the pad
            [0.0, 0.002, 0.007],  # the joint behind it
            [0.0064, 0.016, 0.003],  # its rim
        ]
    )
    marks = nail_marks(places, [TIP])
    assert marks[0] == pytest.approx(1.0)
    assert marks[1] == FAR
    assert marks[2] < -1
    assert marks[3] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(nail_marks(places, [TIP, TIP]), marks)


@pytest.mark.parametrize("grasp", range(len(GRASPS)))
def test_every_hand_has_five_nails(grasp: int) -> None:
    hand = hand_mesh(grasp)
    assert hand.nails.shape == (len(hand.mesh.vertices),)
    middle = hand.mesh.vertices[hand.nails > 0.3]
    apart = np.linalg.norm(middle[:, None] - middle, axis=2) < 0.009
    reached = np.linalg.matrix_power(apart.astype(int), 8) > 0
    assert len(np.unique(reached, axis=0)) == 5


def test_nails_look_where_the_back_of_a_flat_hand_does() -> None:
    hand = hand_mesh(OPEN_HAND)
    fingers = hand.mesh.vertices[:, 0] < 0.03  # without the thumb
    a, b, c = (hand.mesh.vertices[hand.mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    nails = (hand.nails[hand.mesh.faces] > 0.3).all(axis=1) & fingers[hand.mesh.faces].all(axis=1)
    assert normals[nails, 2].mean() > 0.5
