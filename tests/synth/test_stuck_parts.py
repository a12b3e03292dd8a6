"""Where joints leave parts in the states of one sequence."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform
from asdfviz.synth.joint_motion import held_with, joined_poses
from asdfviz.synth.ways import differs


def moved_again(assembly: Assembly, still: frozenset[str]) -> set[str]:
    """Parts that a later state has elsewhere than an earlier one, by their joints alone."""
    first: dict[str, Transform] = {}
    moved: set[str] = set()
    for state in assembly.steps:
        for name, T in joined_poses(
            state, np.random.default_rng(3), spread=0.8, still=still
        ).items():
            if differs(first.setdefault(name, T), T):
                moved.add(name)
    return moved


@pytest.mark.parametrize("name", ["vise", "screw_clamp", "geared_caliper", "corner_clamp"])
def test_a_part_that_is_stuck_later_on_moves_nothing_that_was_joined_before(name: str) -> None:
    """Else a hand would take it off and put it elsewhere, while the state says that it is joined."""
    assembly = load_assembly(name)
    assert not moved_again(assembly, frozenset())
    for part in assembly.parts:
        assert not moved_again(assembly, held_with(assembly, {part}))


def test_what_moves_as_one_stays_as_one_before_all_of_it_is_there() -> None:
    vise = load_assembly("vise")
    late = [n for n in vise.parts if moved_again(vise, frozenset({n}))]
    assert late  # without its companions each of them would move what was there before
    for name in late:
        assert moved_again(vise, frozenset({name})) <= held_with(vise, {name})
