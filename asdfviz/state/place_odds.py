"""How sure it is that a part is where the most probable state has it, whichever state it is."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Assembly, StateEstimate


class JoinedOdds:
    """The states of an assembly that have parts in the same places."""

    def __init__(self, assembly: Assembly) -> None:
        states = assembly.states
        self._alike = [
            {
                name: [
                    other.index
                    for other in states
                    if name in other.T_base_part and np.allclose(other.T_base_part[name], T)
                ]
                for name, T in state.T_base_part.items()
            }
            for state in states
        ]
        """By state and part, the states that have the part at the same place."""

    def of(self, state: StateEstimate) -> dict[str, float]:
        """By part of the most probable state, the probability of all states together that have the
        part where this one has it; the base part among them."""
        return {
            name: float(state.probabilities[alike].sum())
            for name, alike in self._alike[state.index].items()
        }
