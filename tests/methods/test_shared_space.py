"""Two loose parts that would stand in one another."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.shared_space import SharedSpace, SharedSpaceConfig
from asdfviz.state.joined_spots import JoinedSpots


def at(*place: float) -> Transform:
    return transform_from(np.eye(3), np.array(place))


@pytest.fixture(scope="module")
def clamp() -> Assembly:
    return load_assembly("screw_clamp")


def intruders(
    assembly: Assembly, poses: dict[str, tuple[Transform, float]], **options: float
) -> frozenset[str]:
    space = SharedSpace(assembly, config=SharedSpaceConfig(**options))  # pyright: ignore[reportArgumentType]
    return space.intruders(
        {name: PoseEstimate(name, T, sure, "refined") for name, (T, sure) in poses.items()}
    )


def centred(assembly: Assembly, name: str, T_camera_middle: Transform) -> Transform:
    """The pose of a part whose middle is there."""
    return T_camera_middle @ at(*-assembly.parts[name].middle)


def test_a_pin_is_not_within_a_jaw_that_lies_there(clamp: Assembly) -> None:
    base = {clamp.base: (at(-0.4, 0, 0.6), 0.9)}
    jaw, pin = clamp.parts["upper_jaw"], "pin"
    there = at(0.3, 0, 0.6)
    solid = jaw.mesh.vertices[jaw.mesh.faces].mean(axis=1)
    inside = solid[np.argmin(np.linalg.norm(solid - jaw.middle, axis=1))]
    lying = {"upper_jaw": (there, 0.9), pin: (centred(clamp, pin, there @ at(*inside)), 0.7)}
    beside = {**lying, pin: (centred(clamp, pin, there @ at(0, 0, 0.2)), 0.7)}
    assert intruders(clamp, base | lying, share=0.05) == {pin}
    surer = {**lying, "upper_jaw": (there, 0.5)}
    assert intruders(clamp, base | surer, share=0.05) == {"upper_jaw"}
    assert intruders(clamp, base | beside, share=0.05) == frozenset()
    assert intruders(clamp, lying, share=0.05) == frozenset(), "nobody knows what is loose"
    assert intruders(clamp, base | lying, share=0.05, enabled=False) == frozenset()
    assert intruders(clamp, base | lying, share=1.0) == frozenset()


def test_a_pin_is_not_within_a_jaw_that_is_held(clamp: Assembly) -> None:
    """However sure it is, and although the jaw was placed by a state."""
    state = next(s for s in clamp.states if "upper_jaw" in s.T_base_part)
    base, T_jaw = at(0, 0, 0.6), at(0, 0, 0.6) @ state.T_base_part["upper_jaw"]
    jaw, spots = clamp.parts["upper_jaw"], JoinedSpots(clamp)
    solid = jaw.mesh.vertices[jaw.mesh.faces].mean(axis=1)
    away = [spots.distance("pin", centred(clamp, "pin", T_jaw @ at(*p)), base) for p in solid]
    there = centred(clamp, "pin", T_jaw @ at(*solid[int(np.argmax(away))]))
    assert max(away) > 0.03
    placed = {
        clamp.base: PoseEstimate(clamp.base, base, 0.9, "refined"),
        "upper_jaw": PoseEstimate("upper_jaw", T_jaw, 0.0, "group"),
        "pin": PoseEstimate("pin", there, 0.95, "tracked"),
    }
    held = {clamp.base, "upper_jaw"}
    for share, of, told in ((0.05, held, {"pin"}), (0.05, set[str](), set()), (1.0, held, set())):
        space = SharedSpace(clamp, config=SharedSpaceConfig(share=share))
        assert space.intruders(placed, held=of) == told
    far = SharedSpace(clamp, config=SharedSpaceConfig(share=0.05, held=max(away) + 0.01))
    assert far.intruders(placed, held=held) == frozenset(), "it is near its place"


def test_parts_in_their_places_may_stand_in_one_another(toy) -> None:
    """As a screw does in its nut: the pin is put where the block stands."""
    state = toy.assembly.states[1]
    base = at(0, 0, 0.6)
    block = base @ state.T_base_part["block"]
    pin = centred(toy.assembly, "pin", block @ at(*toy.assembly.parts["block"].middle))
    away = at(0.3, 0, 0)
    here = {"base": (base, 0.9), "block": (block, 0.9), "pin": (pin, 0.7)}
    there = {**here, "block": (away @ block, 0.9), "pin": (away @ pin, 0.7)}
    assert intruders(toy.assembly, here, share=0.1) == frozenset()
    assert intruders(toy.assembly, there, share=0.1) == {"pin"}
    space = SharedSpace(toy.assembly, config=SharedSpaceConfig(share=0.1))
    placed = {n: PoseEstimate(n, T, sure, "group") for n, (T, sure) in there.items()}
    assert space.intruders(placed) == frozenset(), "a state says so"


@pytest.mark.parametrize("wrong", [{"share": 0.0}, {"share": 1.5}, {"loose": -0.1}])
def test_options_out_of_range_are_named(toy, wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match="shared_space"):
        intruders(toy.assembly, {}, **wrong)
