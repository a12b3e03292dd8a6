"""Joints of one link move together; others move freely, parts that hang together as one."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Joint, State
from asdfviz.geometry.transforms import rotation_about
from asdfviz.synth.joint_motion import joined_poses

X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
AXLE = np.array([0.0, -0.02, 0.0])


def poses(joints: dict[str, Joint], seed: int, spread: float = 1.0) -> dict[str, np.ndarray]:
    state = State(1, "s", {"base": np.eye(4), **dict.fromkeys(joints, np.eye(4))}, joints=joints)
    return dict(joined_poses(state, np.random.default_rng(seed), spread=spread))


@pytest.mark.parametrize("spread", [1.0, 0.6])
def test_a_gear_turns_as_far_as_its_rack_travels(spread: float) -> None:
    rack = Joint("prismatic", X, np.zeros(3), slide=(-0.01, 0.03), link="rack")
    gear = Joint("revolute", -Z, AXLE, turn=(-0.5, 1.5), link="rack")
    travels: list[float] = []
    for seed in range(5):
        found = poses({"rack": rack, "gear": gear}, seed, spread)
        travel = found["rack"][0, 3]
        np.testing.assert_allclose(
            found["gear"][:3, :3], rotation_about(-Z, travel / 0.02), atol=1e-12
        )
        np.testing.assert_allclose((found["gear"] @ [*AXLE, 1.0])[:3], AXLE, atol=1e-12)
        travels.append(float(travel))
    assert np.ptp(travels) > 0.005 * spread


def test_a_linked_screw_follows_its_thread_and_an_unlinked_one_does_not() -> None:
    for link, follows in (("screw", True), ("", False)):
        screw = Joint("cylindrical", X, AXLE, slide=(-0.01, 0.01), turn=(-12.0, 12.0), link=link)
        fits = []
        for seed in range(6):
            T = poses({"screw": screw}, seed)["screw"]
            thread = rotation_about(X, float(T[0, 3]) * 1200.0)
            fits.append(bool(np.abs(T[:3, :3] - thread).max() < 1e-9))
        assert all(fits) == follows


def test_what_is_of_one_link_with_a_still_part_is_still_too() -> None:
    slider = Joint("prismatic", X, np.zeros(3), slide=(-0.01, 0.03), link="screw")
    screw = Joint("cylindrical", X, AXLE, slide=(-0.01, 0.03), turn=(-9.0, 9.0), link="screw")
    other = Joint("prismatic", X, np.zeros(3), slide=(-0.01, 0.03))
    joints = {"slider": slider, "screw": screw, "other": other}
    state = State(1, "s", {"base": np.eye(4), **dict.fromkeys(joints, np.eye(4))}, joints=joints)
    found = joined_poses(state, np.random.default_rng(4), still=["screw"])
    np.testing.assert_array_equal(found["screw"], np.eye(4))
    np.testing.assert_array_equal(found["slider"], np.eye(4))
    assert abs(found["other"][0, 3]) > 1e-3
    bolt = Joint("cylindrical", X, AXLE, slide=(-0.01, 0.03), turn=(-9.0, 9.0))
    state = State(
        1,
        "s",
        {"base": np.eye(4), "jaw": np.eye(4), "bolt": np.eye(4)},
        joints={"jaw": other, "bolt": bolt},
    )
    found = joined_poses(state, np.random.default_rng(4), still=["bolt"])
    np.testing.assert_array_equal(found["jaw"], np.eye(4))


def test_equal_joints_move_as_one_and_links_apart_do_not() -> None:
    one = Joint("ball", X, AXLE, turn=(-0.4, 0.4))
    found = poses({"foot": one, "collar": one}, 3)
    np.testing.assert_array_equal(found["foot"], found["collar"])
    left = Joint("prismatic", X, np.zeros(3), slide=(0.0, 0.1), link="left")
    right = Joint("prismatic", X, np.zeros(3), slide=(0.0, 0.1), link="right")
    found = poses({"left": left, "right": right}, 3)
    assert abs(found["left"][0, 3] - found["right"][0, 3]) > 1e-3
