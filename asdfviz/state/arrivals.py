"""The frame in which a part arrives: it is where the next state has it, and that state is not reached yet.

Truth counts a part as joined from the first frame in which it no longer moves. In the frame before it came
to its place, and nothing that one frame shows tells the two apart. So every way from a state to one that
puts parts somewhere leads through a state of its own, for one frame: it looks like the later state and
counts to the earlier one. Taking a part off has none, since what begins to move is no longer joined.

The paper has no such states.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.shapes import AllScores, Scores
from asdfviz.state.half_done import is_same_place


@dataclass(frozen=True, slots=True, eq=False)
class Arrivals:
    """The states of a model, the assembly's own first, then one for each way on which parts arrive."""

    count: int
    """How many are the assembly's own."""
    before: Int64[np.ndarray, "m"]
    """Of every state, the one of the assembly that truth counts it to."""
    shown: Int64[np.ndarray, "m"]
    """And the one that it looks like."""
    move: Float64[np.ndarray, "m m"]
    """P(next state | state)."""

    @classmethod
    def of(
        cls, assembly: Assembly, move: Float64[np.ndarray, "n n"], ways: Iterable[tuple[int, int]]
    ) -> Arrivals:
        """Lead the ways on which parts arrive through states of their own.

        Args:
            assembly: its states.
            move: P(next state | state) of these alone.
            ways: from a state to the next, by their indices.
        """
        count, states = len(move), assembly.states
        arriving = [(a, b) for a, b in ways if _puts_parts(states[a], states[b])]
        own = list(range(count))
        size = count + len(arriving)
        full = np.zeros((size, size))
        full[:count, :count] = move
        for k, (a, b) in enumerate(arriving, count):
            full[a, k], full[a, b] = full[a, b], 0.0
        for k, (_, b) in enumerate(arriving, count):
            full[k] = full[b]  # it goes on as from where it arrived
        return cls(
            count,
            np.array(own + [a for a, _ in arriving]),
            np.array(own + [b for _, b in arriving]),
            full,
        )

    def begun(self, scores: Scores) -> AllScores:
        """Scores of the assembly's states as those of all: nothing arrives in the first frame."""
        return np.concatenate([scores, np.zeros(len(self.before) - self.count)])

    def counted(self, belief: AllScores) -> Scores:
        """Probabilities of the assembly's states, each with the frames that count to it."""
        return np.bincount(self.before, belief, self.count)

    def seen(self, belief: AllScores) -> Scores:
        """Probabilities of what the parts look like: one that arrives is where it arrives."""
        return np.bincount(self.shown, belief, self.count)


def _puts_parts(state: State, following: State) -> bool:
    """Whether the second one has any part where the first one does not have it."""
    return any(
        name not in state.T_base_part or not is_same_place(state.T_base_part[name], T)
        for name, T in following.T_base_part.items()
    )
