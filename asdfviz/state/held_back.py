"""Evidence for states that cannot be there yet, given to the step before.

A state may look like the step before it: a step that adds two parts is reached with the second one, and with
the first one in place it looks much like the later state. So what is known to be too early speaks for the
step before, rather than for all others alike.
"""

from __future__ import annotations

from functools import lru_cache

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Scores


def held_back(scores: Scores, likely: Scores, assembly: Assembly) -> Scores:
    """Evidence for states, what they lack in likelihood given to the step before each.

    Args:
        scores: of every state.
        likely: how likely the states are by what came before (`asdfviz.state.lately_loose`).
        assembly: whose states.
    """
    result, lacking = scores.copy(), 1.0 - likely / likely.max()
    for state, before in _steps_before(assembly):
        moved = result[state] * lacking[state]
        result[state] -= moved
        result[before] += moved
    return result


@lru_cache(maxsize=8)
def _steps_before(assembly: Assembly) -> tuple[tuple[int, int], ...]:
    """States, each with the step before it; the last ones first, since that may be too early, too."""
    steps = [state.index for state in assembly.steps]
    latest = sorted(assembly.states, key=lambda s: (s.completed, s.is_error), reverse=True)
    before = ((s.index, [k for k in steps if k < s.completed + s.is_error]) for s in latest)
    return tuple((state, earlier[-1]) for state, earlier in before if earlier)
