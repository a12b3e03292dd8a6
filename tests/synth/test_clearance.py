"""Hands that stand in a part for a moment."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Mesh, State
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.clearance import ALLOWED, given_way
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import backed, hand_points, scaled
from asdfviz.synth.layout import dress
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import depth, solid_of
from asdfviz.synth.primitives import box

OUTFIT = dress(np.random.default_rng(0), grasp=1)
CUBE: Mesh = box((0.05, 0.05, 0.05))
SOLIDS = {"cube": solid_of(CUBE)}


def moment(shift: np.ndarray) -> Moment:
    """A hand whose fingertips reach a corner of a cube, shifted."""
    tips = apply(scaled(np.eye(4), OUTFIT), hand_points(1))
    out = backed(np.eye(4), OUTFIT, 1, 1.0)[:3, 3]
    tip = tips[(tips @ out).argmin()]
    T_cube = moved(np.eye(4), tip - 0.025 * out)
    state = State(0, "alone", {"cube": np.eye(4)})
    return Moment({"cube": T_cube}, (), state, moved(np.eye(4), shift), None, 1)


def deepest(one: Moment) -> float:
    assert one.T_world_hand is not None
    world = apply(scaled(one.T_world_hand, OUTFIT), hand_points(1))
    return depth(apply(inverse(one.T_world_part["cube"]), world), SOLIDS["cube"])


def test_a_hand_in_a_part_gives_way_by_millimetres() -> None:
    out = backed(np.eye(4), OUTFIT, 1, 1.0)[:3, 3]
    pressed = moment(-0.006 * out)
    assert deepest(pressed) > ALLOWED
    (cleared,) = given_way([pressed], SOLIDS, OUTFIT)
    assert cleared.T_world_hand is not None
    assert pressed.T_world_hand is not None
    assert deepest(cleared) < deepest(pressed) - 0.001
    way = cleared.T_world_hand[:3, 3] - pressed.T_world_hand[:3, 3]
    assert 0.0005 < np.linalg.norm(way) < 0.0045
    np.testing.assert_array_equal(cleared.T_world_part["cube"], pressed.T_world_part["cube"])


def test_hands_beside_parts_and_moments_without_hands_stay() -> None:
    out = backed(np.eye(4), OUTFIT, 1, 1.0)[:3, 3]
    away = moment(0.05 * out)
    bare = Moment(away.T_world_part, (), away.state, None, "cube")
    assert given_way([away, bare], SOLIDS, OUTFIT) == (away, bare)
