from __future__ import annotations

import numpy as np

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.one_place import OnePlace


def at(*place: float) -> np.ndarray:
    return transform_from(np.eye(3), np.array(place))


def test_of_two_in_one_place_the_less_sure_goes(toy) -> None:
    one_place = OnePlace(toy.assembly)
    poses = {"block": at(0, 0, 0.6), "pin": at(0.005, 0, 0.6), "base": at(0.3, 0, 0.6)}
    sure = {"block": 0.9, "pin": 0.6, "base": 0.1}
    assert one_place.intruders(poses, sure) == {"pin"}
    assert one_place.intruders(poses, {**sure, "pin": 0.95}) == {"block"}
    # What the state holds stays, however sure the other is.
    assert one_place.intruders(poses, sure, joined=["pin"]) == {"block"}


def test_neighbours_and_parts_that_belong_together_stay(toy) -> None:
    one_place = OnePlace(toy.assembly)
    sure = dict.fromkeys(toy.assembly.parts, 0.5)
    beside = {"block": at(0, 0, 0.6), "pin": at(0.04, 0, 0.6)}
    assert one_place.intruders(beside, sure) == frozenset()
    joined = {name: at(0, 0, 0.6) @ T for name, T in toy.assembly.states[1].T_base_part.items()}
    assert one_place.intruders(joined, sure) == frozenset()
    # The block may be taken for some way into the base that it stands on, and not for being there.
    base = at(0, 0, 0.6)
    stands = base @ toy.assembly.states[1].T_base_part["block"]
    half = stands.copy()
    half[:3, 3] = 0.4 * base[:3, 3] + 0.6 * stands[:3, 3]
    assert one_place.intruders({"base": base, "block": half}, sure) == frozenset()


def test_a_jaw_is_not_where_the_other_one_is_however_near_a_screw_draws_them() -> None:
    clamp = load_assembly("screw_clamp")
    one_place = OnePlace(clamp)
    lower = at(0, 0, 0.6)
    upper = lower @ clamp.states[-1].T_base_part["upper_jaw"]
    sure = {"lower_jaw": 0.7, "upper_jaw": 0.9}
    assert one_place.intruders({"lower_jaw": lower, "upper_jaw": upper}, sure) == frozenset()
    middles = {name: clamp.parts[name].middle for name in sure}
    mistaken = upper @ at(*(middles["upper_jaw"] - middles["lower_jaw"] + [0, 0, 0.003]))
    poses = {"lower_jaw": mistaken, "upper_jaw": upper}
    assert one_place.intruders(poses, sure) == {"lower_jaw"}


def test_a_rod_lies_beside_its_twin_as_joined_but_never_where_it_lies() -> None:
    clamp = load_assembly("screw_clamp")
    one_place = OnePlace(clamp)
    joined = clamp.states[-1].T_base_part
    sure = {"rod": 0.8, "rod-Copy": 0.6}
    rods = {name: at(0, 0, 0.6) @ joined[name] for name in sure}
    assert one_place.intruders(rods, sure) == frozenset()
    near = {**rods, "rod-Copy": at(0, 0, 0.002) @ rods["rod"]}
    assert one_place.intruders(near, sure) == {"rod-Copy"}
    assert one_place.intruders(near, sure, joined=["rod-Copy"]) == {"rod"}


def test_of_two_in_one_place_the_joined_one_is_told() -> None:
    clamp = load_assembly("screw_clamp")
    held = at(0, 0, 0.6) @ clamp.states[-1].T_base_part["rod"]
    poses = {
        "rod": PoseEstimate("rod", held, 0.6, "group"),
        "rod-Copy": PoseEstimate("rod-Copy", held, 0.9, "refined"),
    }
    assert OnePlace(clamp).alone(poses) == {"rod-Copy": poses["rod-Copy"]}
    assert OnePlace(clamp).alone(poses, joined=("rod",)) == {"rod": poses["rod"]}
