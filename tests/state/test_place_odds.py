"""How surely parts are where the most probable state has them."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import StateEstimate
from asdfviz.state.half_done import HalfDone
from asdfviz.state.place_odds import JoinedOdds


def test_all_states_that_have_a_part_in_the_same_place_count() -> None:
    caliper = load_assembly("geared_caliper")
    belief = np.zeros(len(caliper.states))
    belief[1:4] = [0.2, 0.5, 0.3]
    odds = JoinedOdds(caliper).of(StateEstimate(belief, {}))
    assert set(odds) == set(caliper.states[2].T_base_part)
    assert odds["carriage"] == pytest.approx(1.0)
    assert odds["rule"] == pytest.approx(1.0)
    assert odds["wheel"] == pytest.approx(0.8)


def test_of_a_step_that_is_half_done_one_part_may_be_sure_and_the_other_not() -> None:
    unfolded = HalfDone.of(load_assembly("geared_caliper"))
    states = unfolded.assembly.states
    half = next(k for k in unfolded.indices if "pinion" in states[k].T_base_part)
    belief = np.zeros(len(states))
    belief[half], belief[2] = 0.6, 0.4
    odds = JoinedOdds(unfolded.assembly).of(StateEstimate(belief, {}))
    assert odds["pinion"] == pytest.approx(1.0)
    assert "wheel" not in odds


def test_a_part_elsewhere_is_another_matter() -> None:
    """The error's jaw is turned: it says nothing for the right one."""
    clamp = load_assembly("corner_clamp")
    jaw = clamp.states[1].T_base_part["jaw"]
    wrong = next(
        s
        for s in clamp.states
        if "jaw" in s.T_base_part and not np.allclose(s.T_base_part["jaw"], jaw)
    )
    belief = np.zeros(len(clamp.states))
    belief[1], belief[wrong.index] = 0.7, 0.3
    assert JoinedOdds(clamp).of(StateEstimate(belief, {}))["jaw"] == pytest.approx(0.7)
