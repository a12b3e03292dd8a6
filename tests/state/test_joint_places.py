from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Joint
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import inverse, rotation_about, transform_from
from asdfviz.state.joint_places import TURNS, JointPlaces
from asdfviz.state.joints import deviation, spread_of


def shift(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    return transform_from(np.eye(3), np.array([x, y, z]))


def linked(assembly: Assembly) -> Assembly:
    """The pin turns freely as the block slides: both hang on one link."""
    axis = np.array([1.0, 0, 0])
    slide = Joint("prismatic", axis, np.zeros(3), slide=(-0.03, 0.03), link="drive")
    screw = Joint(
        "cylindrical", axis, np.zeros(3), slide=(-0.01, 0.01), turn=(-9.0, 9.0), link="drive"
    )
    joints = {"block": slide, "lid": screw}
    states = tuple(
        replace(s, joints={n: j for n, j in joints.items() if n in s.T_base_part})
        for s in assembly.states
    )
    return replace(assembly, states=states)


def test_a_part_stays_in_its_joint_where_it_was_seen(assembly: Assembly, place) -> None:
    places, state = JointPlaces(assembly), assembly.states[1]
    nominal = state.T_base_part["block"]
    poses = place({"base": np.eye(4), "block": shift(0.021, 0.003) @ nominal})
    T_camera_base = poses["base"].T_camera_part
    before = places.copy()
    places.see(T_camera_base, poses)
    assert np.allclose(places.last("block", state), shift(0.021) @ nominal)
    assert np.allclose(places.possible(["block"], assembly.states[3])[0][0], shift(0.021) @ nominal)
    assert np.allclose(before.last("block", state), nominal)


def test_what_is_seen_far_from_where_it_agreed_may_still_be_there(
    assembly: Assembly, place
) -> None:
    places, state = JointPlaces(assembly), assembly.states[1]
    nominal = state.T_base_part["block"]

    def see(slide: float) -> list[np.ndarray]:
        poses = place({"base": np.eye(4), "block": shift(slide) @ nominal})
        places.see(poses["base"].T_camera_part, poses)
        return [Ts[0] for Ts in places.possible(["block"], state)]

    # Nothing was seen of it yet when the picture said where it is.
    places.settle(["block"], state, [shift(0.002) @ nominal])
    assert len(places.possible(["block"], state)) > 1
    assert np.allclose(see(0.021), [shift(0.021) @ nominal, shift(0.002) @ nominal])
    assert np.allclose(places.copy().possible(["block"], state)[1][0], shift(0.002) @ nominal)
    # What agrees best is where it is, until it is seen elsewhere.
    places.settle(["block"], state, [shift(0.002) @ nominal])
    assert np.allclose(places.last("block", state), shift(0.002) @ nominal)
    assert np.allclose(see(0.004), [shift(0.004) @ nominal])


@pytest.mark.parametrize("off", [shift(0.0, 0.04), shift(0.09)])
def test_a_part_that_is_not_in_its_joint_tells_nothing_of_it(
    assembly: Assembly, place, off: np.ndarray
) -> None:
    places, state = JointPlaces(assembly), assembly.states[1]
    nominal = state.T_base_part["block"]
    poses = place({"base": np.eye(4), "block": off @ nominal})
    places.see(poses["base"].T_camera_part, poses)
    assert np.allclose(places.last("block", state), nominal)
    assert len(places.possible(["block"], state)) > 1


def test_a_link_tells_of_the_parts_that_were_not_seen(assembly: Assembly, place) -> None:
    assembly = linked(assembly)
    places, state = JointPlaces(assembly), assembly.states[3]
    poses = place({"base": np.eye(4), "block": shift(0.015) @ state.T_base_part["block"]})
    places.see(poses["base"].T_camera_part, poses)
    possible = [T for (T,) in places.possible(["lid"], state)]
    assert len(possible) == TURNS  # the link does not tell turns, the screw has many
    slides = [T[0, 3] - state.T_base_part["lid"][0, 3] for T in possible]
    assert slides == pytest.approx([0.005] * TURNS)


@pytest.mark.parametrize(("beside", "turns"), [(0.0, 1), (0.01, TURNS)])
def test_a_ball_is_round_about_every_axis_through_its_middle(
    assembly: Assembly, place, beside: float, turns: int
) -> None:
    axes = tuple(Axis(np.eye(3)[i], np.array([0.0, beside, 0.0])) for i in (1, 2))
    parts = {
        **assembly.parts,
        "lid": replace(assembly.parts["lid"], symmetries=Symmetries((), axes)),
    }
    screw = Joint("revolute", np.array([1.0, 0, 0]), np.array([0, 0, 0.1]), turn=(-9.0, 9.0))
    state = replace(assembly.states[3], joints={"lid": screw})
    assembly = replace(assembly, parts=parts, states=(*assembly.states[:3], state))
    places = JointPlaces(assembly)
    poses = place({"base": np.eye(4), "lid": state.T_base_part["lid"]})
    places.see(poses["base"].T_camera_part, poses)
    assert len(places.possible(["lid"], state)) == turns


def test_a_part_without_a_joint_is_at_its_place(assembly: Assembly) -> None:
    places, state = JointPlaces(assembly), assembly.states[3]
    ((T,),) = places.possible(["pin"], state)
    assert np.allclose(T, state.T_base_part["pin"])


def test_a_turn_that_was_seen_is_the_first_of_several(assembly: Assembly, place) -> None:
    assembly = linked(assembly)
    places, state = JointPlaces(assembly), assembly.states[3]
    turn = transform_from(rotation_about(np.array([1.0, 0, 0]), 1.2), np.zeros(3))
    poses = place({"base": np.eye(4), "lid": turn @ state.T_base_part["lid"]})
    places.see(poses["base"].T_camera_part, poses)
    first, *others = [T for (T,) in places.possible(["lid"], state)]
    off = inverse(first) @ turn @ state.T_base_part["lid"]
    assert np.allclose(off, np.eye(4), atol=1e-9)
    assert len(others) == TURNS - 1


def test_parts_of_equal_joints_move_as_one_and_round_ones_need_no_turns(
    assembly: Assembly, place
) -> None:
    """The pin is round about its own z: a joint about that axis turns it unseen."""
    T_pin = assembly.states[3].T_base_part["pin"]
    axle = Joint(
        "cylindrical", np.array([0.0, 0, 1]), T_pin[:3, 3], slide=(-0.01, 0.01), turn=(-9.0, 9.0)
    )
    state = replace(assembly.states[3], joints={"pin": axle, "lid": axle})
    assembly = replace(assembly, states=(*assembly.states[:3], state, assembly.states[4]))
    places = JointPlaces(assembly)
    assert places.together(state) == [("base",), ("block",), ("pin", "lid")]
    poses = place({"base": np.eye(4), "pin": shift(0, 0, 0.006) @ T_pin})
    places.see(poses["base"].T_camera_part, poses)
    assert len(places.possible(["pin"], state)) == 1
    both = places.possible(("pin", "lid"), state)
    assert len(both) == TURNS
    assert np.allclose(both[0][1], shift(0, 0, 0.006) @ state.T_base_part["lid"])


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "cylindrical", "ball"])
def test_only_what_cannot_be_in_a_joint_is_passed_over(
    assembly: Assembly, kind, unchecked: Callable[[], AbstractContextManager[None]]
) -> None:
    """`nearest` rules a pose out by its distance alone; measured in full, it is out as well."""
    half = transform_from(rotation_about(np.array([0.0, 0, 1.0]), np.pi), np.array([0.01, 0.02, 0]))
    free = Axis(np.array([0.0, 0, 1.0]), np.array([0.004, 0.0, 0.0]))
    slide = (0.0, 0.0) if kind in ("revolute", "ball") else (-0.01, 0.03)
    joint = Joint(kind, np.array([1.0, 0, 0]), np.array([0, 0.01, 0.0]), slide, (-2.0, 1.0))
    part = replace(
        assembly.parts["block"], symmetries=Symmetries(discrete=(half,), continuous=(free,))
    )
    assembly = replace(assembly, parts={**assembly.parts, "block": part})
    places, T_nominal = JointPlaces(assembly), assembly.states[1].T_base_part["block"]
    rng, inside = np.random.default_rng(3), 0
    with unchecked():
        for _ in range(1500):
            spun = rotation_about(rng.normal(size=3), rng.uniform(0, np.pi))
            T = transform_from(spun, rng.uniform(-0.04, 0.04, 3)) @ T_nominal
            off = deviation(
                T,
                T_nominal,
                center_part=part.middle,
                symmetries=part.symmetries,
                joint=joint,
                spread=spread_of(part),
            )
            is_in = off.within(0.02, 30.0)
            assert (places.nearest("block", T, T_nominal, joint) is not None) == is_in
            inside += is_in
    assert inside > 3


def test_a_part_that_another_state_has_elsewhere_reaches_as_far_from_there(
    assembly: Assembly,
) -> None:
    """An error joins it far from the axis, by the same joint."""
    joint = Joint("revolute", np.array([0.0, 0, 1.0]), np.zeros(3), turn=(-2.0, 2.0))
    places = JointPlaces(assembly)
    near, far = (places.reach("block", shift(x), joint) for x in (0.01, 0.1))
    assert (near, far) == pytest.approx((0.02, 0.2))


def test_what_slides_and_is_seen_no_more_may_have_been_pushed_on(assembly: Assembly, place) -> None:
    """A hand held it at the end of its range, then it went behind another part."""
    places, state = JointPlaces(assembly), assembly.states[1]
    nominal = state.T_base_part["block"]
    poses = place({"base": np.eye(4), "block": shift(0.028) @ nominal})
    T_camera_base = poses["base"].T_camera_part
    places.see(T_camera_base, poses)
    seen = [Ts[0] for Ts in places.possible(["block"], state)]
    assert np.allclose(seen, [shift(0.028) @ nominal])
    del poses["block"]
    places.see(T_camera_base, poses)
    first, *others = (Ts[0] for Ts in places.possible(["block"], state))
    assert np.allclose(first, shift(0.028) @ nominal)
    slides = [float(T[0, 3] - nominal[0, 3]) for T in others]
    assert min(slides) < -0.01
    assert any(abs(slide) < 0.005 for slide in slides)
