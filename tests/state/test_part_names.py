"""A base with a twin is the one of both to which parts are joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.state.part_names import PartNames
from asdfviz.state.relative_pose import RelativePoseConfig

BASE = transform_from(rotation_about(np.array([0.2, 1, 0]), 0.7), np.array([0.1, 0, 0.6]))
TWIN = transform_from(rotation_about(np.array([0.2, 1, 0]), 0.9), np.array([-0.2, 0, 0.6]))
AWAY = transform_from(np.eye(3), np.array([0.0, 0.3, 0.8]))
HALF_TURN = transform_from(rotation_about(np.array([0.0, 0, 1]), np.pi), np.zeros(3))
SWAPPED = {"base": "cover", "cover": "base"}


def with_cover(assembly: Assembly, symmetries: Symmetries) -> Assembly:
    """The last step lays a part just like the base on top of everything."""
    base = replace(assembly.parts["base"], symmetries=symmetries)
    parts = {**assembly.parts, "base": base, "cover": replace(base, name="cover")}
    on_top = transform_from(np.eye(3), np.array([0, 0, 0.2]))
    last = assembly.states[3]
    states = list(assembly.states)
    states[3] = replace(last, T_base_part={**last.T_base_part, "cover": on_top})
    return replace(assembly, parts=parts, states=tuple(states))


@pytest.fixture(params=[Symmetries(), Symmetries(discrete=(HALF_TURN,))])
def covered(assembly: Assembly, request: pytest.FixtureRequest) -> Assembly:
    return with_cover(assembly, request.param)


@pytest.fixture
def names(covered: Assembly) -> PartNames:
    return PartNames(covered, config=RelativePoseConfig())


def seen(assembly: Assembly, state: int, **others: Transform) -> dict[str, Transform]:
    """Parts of a state on the plate at BASE, the others away."""
    places = assembly.states[state].T_base_part
    poses = {n: BASE @ places[n] if n in places else AWAY for n in assembly.parts}
    return {**poses, **others}


@pytest.mark.parametrize("state", [1, 2])
def test_the_plate_to_which_parts_are_joined_becomes_the_base(
    names: PartNames, covered: Assembly, state: int
) -> None:
    # The plates go by each other's names.
    poses = seen(covered, state, base=TWIN, cover=BASE)
    said = [names.changes(poses) for _ in range(3)]
    assert SWAPPED in said
    assert said[0] == {} or state > 1  # one part in one frame may only pass by
    right = {**poses, "base": BASE, "cover": TWIN}
    assert all(names.changes(right) == {} for _ in range(5))


def test_the_base_keeps_its_name_where_nothing_says_otherwise(
    names: PartNames, covered: Assembly
) -> None:
    for poses in (
        seen(covered, 0, cover=TWIN),  # nothing is joined to either
        seen(covered, 2, cover=TWIN),
        seen(covered, 3),
        {"cover": BASE, "block": BASE @ covered.states[1].T_base_part["block"]},
    ):
        assert all(names.changes(poses) == {} for _ in range(5))


def test_a_twin_that_the_base_holds_does_not_become_the_base(
    names: PartNames, covered: Assembly
) -> None:
    poses = seen(covered, 1, base=TWIN, cover=BASE)
    assert all(names.changes(poses, held={"cover"}) == {} for _ in range(5))


def test_other_twins_are_named_by_their_places_on_the_new_base(assembly: Assembly) -> None:
    assembly = with_cover(assembly, Symmetries())
    lid = assembly.parts["lid"]
    beside = transform_from(np.eye(3), np.array([0.05, 0, 0.1]))
    states = tuple(
        replace(s, T_base_part={**s.T_base_part, "lid-Copy": beside})
        if "lid" in s.T_base_part
        else s
        for s in assembly.states
    )
    parts = {**assembly.parts, "lid-Copy": replace(lid, name="lid-Copy")}
    assembly = replace(assembly, parts=parts, states=states)
    places = assembly.states[3].T_base_part
    crossed = {"lid": BASE @ places["lid-Copy"], "lid-Copy": BASE @ places["lid"]}
    poses = seen(assembly, 2, base=TWIN, cover=BASE, **crossed)
    names = PartNames(assembly, config=RelativePoseConfig())
    both = {**SWAPPED, "lid": "lid-Copy", "lid-Copy": "lid"}
    assert both in [names.changes(poses) for _ in range(3)]
