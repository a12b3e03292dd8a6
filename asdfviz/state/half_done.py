"""States between two steps: of the parts that a step adds, some are joined and others are not yet.

Truth counts them to the step before, since a state is reached when all of its parts are in. A group
that shows only the first of two parts fits the later state better, though, and the second one may be
too small or too hidden to say otherwise, so whoever follows states needs these by themselves.

The paper has no such states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.shapes import Scores

All: TypeAlias = Float64[np.ndarray, "all"]
"""One for every state, the half-done ones among them."""
MOST_ADDED = 4
"""Steps that add more parts have too many ways of being half done."""


def ways_half_done(assembly: Assembly) -> Iterator[tuple[State, State, tuple[str, ...]]]:
    """Every step with the next one and some, but not all, of the parts that this one adds."""
    known = {frozenset(state.attached) for state in assembly.states}
    for state, following in pairwise(assembly.steps):
        added = [name for name in following.attached if name not in state.T_base_part]
        if len(added) <= MOST_ADDED:
            for count in range(1, len(added)):
                for some in combinations(added, count):
                    if frozenset((*state.attached, *some)) not in known:
                        yield state, following, some


@dataclass(frozen=True, slots=True, eq=False)
class HalfDone:
    """An assembly with its half-done states, and the way back."""

    assembly: Assembly
    """The half-done states come last, as if they were errors, with their transitions."""
    before: tuple[int, ...]
    """Of every state, the one that truth counts it to."""
    after: tuple[int, ...]
    """Of a half-done state, the next step; of the others, themselves."""

    @classmethod
    def of(cls, assembly: Assembly) -> HalfDone:
        """The half-done states of an assembly; it stays as it is if no step adds several parts."""
        states, before = list(assembly.states), [state.index for state in assembly.states]
        after, links = list(before), set(assembly.transitions)
        joined: dict[int, dict[frozenset[str], int]] = {}
        for state, following, some in ways_half_done(assembly):
            own = frozenset(state.attached)
            ends = {own: state.index, frozenset(following.attached): following.index}
            joined.setdefault(state.index, ends)[own | set(some)] = len(states)
            named = f"{state.name} with {' and '.join(some)}"
            states.append(_between(state, following, some, index=len(states), name=named))
            before.append(state.index)
            after.append(following.index)
        for step in joined.values():  # one part after the other
            links |= {
                (step[less], step[more])
                for less in step
                for more in step
                if less < more and len(more) == len(less) + 1
            }
        unfolded = replace(assembly, states=tuple(states), transitions=frozenset(links))
        return cls(unfolded, tuple(before), tuple(after))

    @classmethod
    def none(cls, assembly: Assembly) -> HalfDone:
        """The assembly as it is."""
        own = tuple(state.index for state in assembly.states)
        return cls(assembly, own, own)

    @property
    def indices(self) -> frozenset[int]:
        """Of the half-done states."""
        return frozenset(
            k for k, (b, a) in enumerate(zip(self.before, self.after, strict=True)) if a != b
        )

    def unfolded(self, looks: Scores | None) -> All | None:
        """Probabilities of the assembly's states as those of all: half done looks like a bit of both."""
        if looks is None:
            return None
        both = looks[list(self.before)] + looks[list(self.after)]
        return both / both.sum()

    def summed(self, belief: All) -> Scores:
        """Probabilities of the assembly's own states, each with those that count to it."""
        result = np.zeros(len(self.before) - len(self.indices))
        np.add.at(result, list(self.before), belief)
        return result

    def told(self, term: All | None) -> Scores | None:
        """What a term says of the assembly's own states: of those that count to one, the most."""
        if term is None:
            return None
        result = np.zeros(len(self.before) - len(self.indices))
        np.maximum.at(result, list(self.before), term)
        return result / result.sum()


def _between(
    state: State, following: State, some: tuple[str, ...], *, index: int, name: str
) -> State:
    places: Mapping[str, np.ndarray] = {n: following.T_base_part[n] for n in some}
    joints = {n: joint for n, joint in following.joints.items() if n in some}
    return State(
        index=index,
        name=name,
        T_base_part={**state.T_base_part, **places},
        is_error=True,
        after=state.index,
        joints={**state.joints, **joints},
    )
