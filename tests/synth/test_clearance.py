"""Hands that stand in a part for a moment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asdfviz.datatypes import Mesh, State
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.clearance import ALLOWED, given_way, snapped
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import backed, hand_points, scaled
from asdfviz.synth.layout import dress
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import Solid, depth, penetration, solid_of
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


def way_off(pressed: Moment, cleared: Moment) -> float:
    """How far a hand gave way, metres: out of the cube, which stays."""
    assert cleared.T_world_hand is not None
    assert pressed.T_world_hand is not None
    assert deepest(cleared) < deepest(pressed) - 0.001
    np.testing.assert_array_equal(cleared.T_world_part["cube"], pressed.T_world_part["cube"])
    return float(np.linalg.norm(cleared.T_world_hand[:3, 3] - pressed.T_world_hand[:3, 3]))


def test_a_hand_in_a_part_gives_way_by_millimetres() -> None:
    out = backed(np.eye(4), OUTFIT, 1, 1.0)[:3, 3]
    pressed = moment(-0.006 * out)
    assert deepest(pressed) > ALLOWED
    (cleared,) = given_way([pressed], SOLIDS, OUTFIT)
    assert 0.0005 < way_off(pressed, cleared) < 0.0105


def test_hands_beside_parts_and_moments_without_hands_stay() -> None:
    out = backed(np.eye(4), OUTFIT, 1, 1.0)[:3, 3]
    away = moment(0.05 * out)
    bare = Moment(away.T_world_part, (), away.state, None, "cube")
    assert given_way([away, bare], SOLIDS, OUTFIT) == (away, bare)


def test_a_hand_that_holds_something_slips_a_little_and_what_it_holds_stays() -> None:
    out = backed(np.eye(4), OUTFIT, 1, 1.0)[:3, 3]
    hold = [replace(moment(-0.006 * out), held="cube")] * 6
    cleared = given_way(hold, SOLIDS, OUTFIT)
    assert len(cleared) == 6
    for pressed, slipped in zip(hold[:3], cleared[:3], strict=True):
        assert 0.0005 < way_off(pressed, slipped) < 0.0055
    assert deepest(cleared[-1]) <= deepest(cleared[0])


def passing(x: float, *, attached: tuple[str, ...] = ()) -> Moment:
    """A hand with a cube, and a plate 2 mm thick in the way at x = 0."""
    poses = {"cube": moved(np.eye(4), np.array([x, 0.0, 0.0])), "plate": np.eye(4)}
    state = State(0, "alone", {"plate": np.eye(4)})
    hand = moved(np.eye(4), np.array([x, 0.1, 0.0]))
    return Moment(poses, attached, state, hand, "cube", 1)


def test_what_snaps_does_so_between_two_frames() -> None:
    solids = {**SOLIDS, "plate": solid_of(box((0.002, 0.05, 0.05)))}
    moments = [passing(-0.04), passing(-0.0245), passing(0.04)]
    first, now, last = snapped(moments, solids, step=0.08)
    assert (first, last) == (moments[0], moments[2])
    x = now.T_world_part["cube"][0, 3]
    assert -0.04 < x < -0.0245
    assert depth_at(x, solids["plate"]) < 0.001 < depth_at(-0.0245, solids["plate"])
    assert now.T_world_hand is not None
    np.testing.assert_allclose(now.T_world_hand[:3, 3], [x, 0.1, 0.0])


def depth_at(x: float, plate: Solid) -> float:
    return penetration(SOLIDS["cube"], plate, moved(np.eye(4), np.array([x, 0.0, 0.0])))


def test_what_is_joined_or_would_go_too_far_in_a_frame_stays() -> None:
    solids = {**SOLIDS, "plate": solid_of(box((0.002, 0.05, 0.05)))}
    joined = [passing(x, attached=("cube",)) for x in (-0.04, -0.0245, 0.04)]
    assert snapped(joined, solids, step=0.08) == tuple(joined)
    slow = [passing(x) for x in (-0.04, -0.0245, 0.04)]
    assert snapped(slow, solids, step=0.0646) == tuple(slow)
