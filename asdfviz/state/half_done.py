"""States between two steps: of the parts that a step adds, some are joined and others are not yet.

Truth counts them to the step before, since a state is reached when all of its parts are in. A group
that shows only the first of two parts fits the later state better, though, and the second one may be
too small or too hidden to say otherwise, so whoever follows states needs these by themselves.

The paper has no such states.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations, pairwise

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.shapes import AllScores, Scores, Transform

MOST_ADDED = 4
"""Steps that add more parts have too many ways of being half done."""
SAME_PLACE = 1e-6
"""Poses that differ by less are one place that was written twice, metres and as elements of rotations."""


@lru_cache(maxsize=8)
def ways_half_done(assembly: Assembly) -> tuple[tuple[State, State, tuple[str, ...]], ...]:
    """Every step with the next one and some, but not all, of the parts that this one adds.

    Without those that the assembly names: as a correct state, or as an error that follows the step, or
    one before. An error that follows a later step (a part comes off again) takes none of them, as what
    came before tells it from the half-done step.
    """
    found: list[tuple[State, State, tuple[str, ...]]] = []
    for state, following in pairwise(assembly.steps):
        named = [s for s in assembly.states if not s.is_error or s.completed <= state.index]
        added = [name for name in following.attached if name not in state.T_base_part]
        for count in range(1, len(added)) if len(added) <= MOST_ADDED else ():
            for some in combinations(added, count):
                between = _between(state, following, some, index=len(assembly.states))
                if not any(joins_alike(between, other) for other in named):
                    found.append((state, following, some))
    return tuple(found)


def errors_alike(assembly: Assembly, half_done: Collection[int]) -> dict[int, int]:
    """Errors that join the same as one of the half-done states, by their indices, each with that one's."""
    states = assembly.states
    return {
        error.index: k
        for error in assembly.errors
        for k in half_done
        if error.index not in half_done and joins_alike(error, states[k])
    }


def not_yet(
    scores: AllScores, previous: Scores | None, assembly: Assembly, alike: Mapping[int, int]
) -> AllScores:
    """Scores with those of errors that cannot be there yet given to what they look like.

    Args:
        scores: of the assembly's states, and of more after them.
        previous: what the frame before was, of the assembly's states; its most probable state is what was reached.
        assembly: the states.
        alike: errors, each with the state that it looks like until the step that it follows was reached.
    """
    reached = -1 if previous is None else assembly.states[int(previous.argmax())].completed
    result = scores.copy()
    for error, other in alike.items():
        if reached < assembly.states[error].completed:
            result[other] += result[error]
            result[error] = 0.0
    return result


def joins_alike(one: State, other: State) -> bool:
    """Whether two states have the same parts at the same places."""
    return one.T_base_part.keys() == other.T_base_part.keys() and all(
        is_same_place(T, other.T_base_part[name]) for name, T in one.T_base_part.items()
    )


def is_same_place(T_one: Transform, T_other: Transform) -> bool:
    """Whether two poses are one place that was written twice."""
    return np.allclose(T_one, T_other, rtol=0.0, atol=SAME_PLACE)


@dataclass(frozen=True, slots=True, eq=False)
class HalfDone:
    """An assembly with its half-done states, and the way back."""

    assembly: Assembly
    """The half-done states come last, as if they were errors, with their transitions."""
    before: tuple[int, ...]
    """Of every state, the one that truth counts it to."""
    after: tuple[int, ...]
    """Of a half-done state, the next step; of the others, themselves."""
    alike: Mapping[int, int] = field(default_factory=dict[int, int])
    """Errors that join the same as a half-done state, each with that one."""

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
            states.append(_between(state, following, some, index=len(states)))
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
        alike = errors_alike(unfolded, range(len(assembly.states), len(states)))
        return cls(unfolded, tuple(before), tuple(after), alike)

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

    @property
    def halves(self) -> dict[int, tuple[State, ...]]:
        """Of every step that can be half done, by its index, the half-done states that count to it."""
        found: dict[int, tuple[State, ...]] = {}
        for k in sorted(self.indices):
            found[self.before[k]] = (*found.get(self.before[k], ()), self.assembly.states[k])
        return found

    def unfolded(self, looks: Scores | None) -> AllScores | None:
        """Probabilities of the assembly's states as those of all: half done looks like a bit of both.

        And like an error that joins the same.
        """
        if looks is None:
            return None
        both = looks[list(self.before)] + looks[list(self.after)]
        for error, between in self.alike.items():
            both[between] = max(both[between], both[error])
        return both / both.sum()

    def summed(self, belief: AllScores) -> Scores:
        """Probabilities of the assembly's own states, each with those that count to it."""
        result = np.zeros(len(self.before) - len(self.indices))
        np.add.at(result, list(self.before), belief)
        return result

    def told(self, term: AllScores) -> Scores:
        """What a term says of the assembly's own states: of those that count to one, the most."""
        result = np.zeros(len(self.before) - len(self.indices))
        np.maximum.at(result, list(self.before), term)
        return result / result.sum()


def _between(state: State, following: State, some: tuple[str, ...], *, index: int) -> State:
    places: Mapping[str, np.ndarray] = {n: following.T_base_part[n] for n in some}
    joints = {n: joint for n, joint in following.joints.items() if n in some}
    return State(
        index=index,
        name=f"{state.name} with {' and '.join(some)}",
        T_base_part={**state.T_base_part, **places},
        is_error=True,
        after=state.index,
        joints={**state.joints, **joints},
    )
