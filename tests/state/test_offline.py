"""Following states online and decoding them from what was kept are one model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import StateEstimate
from asdfviz.geometry.shapes import Scores
from asdfviz.state.half_done import HalfDone
from asdfviz.state.offline import FollowedTerms
from asdfviz.state.smoothing import FOLLOWED, StateFilter


def leaning(count: int, state: int, *, by: float = 8.0) -> Scores:
    """What a term says that has one state `by` times as likely as each other one."""
    scores = np.ones(count)
    scores[state] = by
    return scores / scores.sum()


def followed(
    ways: HalfDone, seen: Sequence[int | None], *, by: float = 8.0
) -> list[StateEstimate | None]:
    """What a method says and keeps of frames in which two terms see a state each, or nothing."""
    model = StateFilter(ways.assembly, config=FOLLOWED, half_done=ways.indices)
    count, said = len(ways.before), list[StateEstimate | None]()
    for state in seen:
        term = None if state is None else leaning(count, state, by=by)
        looks = None if state is None else leaning(len(ways.before) - len(ways.indices), 0)
        belief = model.step(ways.unfolded(looks), term, None, term)
        if belief is None:
            said.append(None)
            continue
        terms = {} if term is None else {"relative_pose": term, "place_looks": term}
        told = {name: ways.told(one) for name, one in terms.items()}
        told |= {} if looks is None else {"appearance": looks}
        said.append(StateEstimate(ways.summed(belief), told, terms if ways.indices else {}))
    return said


@pytest.mark.parametrize("name", ["geared_caliper", "corner_clamp"])
def test_what_was_said_online_comes_out_of_what_is_kept(name: str) -> None:
    ways = HalfDone.of(load_assembly(name))
    half = max(ways.indices, default=1)
    said = followed(ways, [None, 0, 0, None, 1, 1, half, half, 2, 2, None, 2])
    kept = FollowedTerms.of(said, ways, config=FOLLOWED)
    assert kept is not None
    assert kept.gave(said)
    for one, belief in zip(said, kept.online(), strict=True):
        assert (one is None) == (belief is None)
        assert one is None or belief == pytest.approx(one.probabilities, abs=1e-12)
    other = FollowedTerms.of(said, ways, config=replace(FOLLOWED, stay=0.7))
    assert other is not None
    assert not other.gave(said)


def test_offline_mends_what_is_late_online_or_seen_wrongly_for_a_while() -> None:
    """Nothing is seen of the first frames, and some frames before the step show the state after it."""
    ways = HalfDone.of(load_assembly("geared_caliper"))
    seen = [None, None, *[0] * 12, *[1] * 5, *[0] * 10, *[1] * 12]
    truth = [0] * 30 + [1] * 11  # the part arrives in the frame before
    said = followed(ways, seen, by=10.0)
    kept = FollowedTerms.of(said, ways, config=FOLLOWED)
    assert kept is not None
    online = [None if one is None else one.index for one in said]
    assert online[:2] == [None, None]
    assert online[30] == 0  # late
    assert 1 in online[:29]  # misled
    assert kept.offline() == truth


def test_half_done_states_count_to_the_step_before() -> None:
    ways = HalfDone.of(load_assembly("geared_caliper"))
    half = min(ways.indices)
    said = followed(ways, [1] * 10 + [half] * 10 + [2] * 10)
    kept = FollowedTerms.of(said, ways, config=FOLLOWED)
    assert kept is not None
    assert kept.offline() == [1] * 21 + [2] * 9  # in its first frame the last part arrives


def test_runs_that_do_not_keep_all_are_not_decoded() -> None:
    ways = HalfDone.of(load_assembly("geared_caliper"))
    said = followed(ways, [0, 0, 1])
    old = [None if one is None else replace(one, unfolded={}) for one in said]
    assert FollowedTerms.of(old, ways, config=FOLLOWED) is None
    assert FollowedTerms.of([None, None], ways, config=FOLLOWED) is None
    first = said[0]
    assert first is not None
    broken = replace(first, terms={"appearance": np.full(len(first.probabilities), np.nan)})
    assert FollowedTerms.of([broken], ways, config=FOLLOWED) is None
