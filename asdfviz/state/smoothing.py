"""A left-to-right hidden Markov model over the assembly's states: online filter and offline path.

The paper's Pose2State averages, so it has inertia and never vetoes. Here a state can only be
reached along the assembly's transitions, evidence multiplies, and a state that both terms rule out
is out. `StateFilter` uses the past alone; `most_likely_path` (Viterbi) a whole recording, and is
reported apart from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores


@dataclass(frozen=True)
class SmoothingConfig:
    """How fast states change and how far one frame's evidence is trusted."""

    stay: float = 0.96
    """Probability that a state lasts for another frame: 25 frames a state, as in the paper's
    sequences."""
    leak: float = 1e-4
    """Probability of a jump to any other state: a missed step must not lock the model."""
    appearance_weight: float = 0.6
    """Exponent of the network's term; evidence of neighbouring frames is not independent."""
    pose_weight: float = 0.8
    """Exponent of the relative poses' term."""
    floor: float = 0.02
    """Evidence is never below this share of its largest value: one frame does not rule out alone."""


class StateFilter:
    """The model online: the probability of every state given all frames so far."""

    def __init__(self, assembly: Assembly, *, config: SmoothingConfig | None = None) -> None:
        self._config = config or SmoothingConfig()
        self._move = transition_matrix(assembly, config=self._config)
        self._belief: Scores | None = None

    def reset(self) -> None:
        """Forget the sequence."""
        self._belief = None

    def step(self, appearance: Scores | None, relative_pose: Scores | None) -> Scores | None:
        """Take in one frame; None before anything was ever seen.

        Args:
            appearance: probabilities by looks, None where they say nothing.
            relative_pose: probabilities by relative poses, None likewise.
        """
        evidence = combined(appearance, relative_pose, config=self._config)
        if self._belief is None:
            if evidence is None:
                return None
            self._belief = evidence / evidence.sum()
            return self._belief
        expected = self._belief @ self._move
        joint = expected if evidence is None else expected * evidence
        self._belief = joint / joint.sum()
        return self._belief


def most_likely_path(
    appearance: Sequence[Scores | None],
    relative_pose: Sequence[Scores | None],
    assembly: Assembly,
    *,
    config: SmoothingConfig | None = None,
) -> list[int] | None:
    """Return the most probable state of every frame, all frames known (Viterbi).

    Args:
        appearance: probabilities by looks, frame by frame.
        relative_pose: probabilities by relative poses, frame by frame.
        assembly: its transitions.
        config: as for the filter.

    Returns:
        State indices; None where no frame says anything.

    Raises:
        MethodError: the two sequences differ in length.
    """
    if len(appearance) != len(relative_pose):
        raise MethodError(
            f"{len(appearance)} frames of appearance, {len(relative_pose)} of relative poses: "
            "both cover the same frames"
        )
    chosen = config or SmoothingConfig()
    pairs = zip(appearance, relative_pose, strict=True)
    evidence = [combined(a, p, config=chosen) for a, p in pairs]
    if all(e is None for e in evidence):
        return None
    log_move = np.log(transition_matrix(assembly, config=chosen))
    states = len(log_move)
    best = np.zeros(states)
    came_from: list[np.ndarray] = []
    for i, seen in enumerate(evidence):
        if i > 0:
            options = best[:, None] + log_move
            came_from.append(options.argmax(axis=0))
            best = options.max(axis=0)
        if seen is not None:
            best = best + np.log(seen)
    path = [int(best.argmax())]
    for origins in reversed(came_from):
        path.append(int(origins[path[-1]]))
    return path[::-1]


def transition_matrix(assembly: Assembly, *, config: SmoothingConfig) -> Float64[np.ndarray, "n n"]:
    """Return P(next state | state): stay, move on along a legal transition, or rarely jump.

    Correct states lead to the next one even where assembly.yaml lists no transition.
    """
    count = len(assembly.states)
    legal = np.zeros((count, count))
    for a, b in pairwise(state.index for state in assembly.steps):
        legal[a, b] = 1.0
    for a, b in assembly.transitions:
        if a != b:
            legal[a, b] = 1.0
    ways = legal.sum(axis=1, keepdims=True)
    onward = (1 - config.stay) * legal / np.maximum(ways, 1.0)
    stay = np.where(ways[:, 0] > 0, config.stay, 1.0)
    move = (1 - config.leak) * (np.diag(stay) + onward) + config.leak / count
    return move / move.sum(axis=1, keepdims=True)


def combined(
    appearance: Scores | None, relative_pose: Scores | None, *, config: SmoothingConfig
) -> Scores | None:
    """Multiply the two terms, each tempered; None where neither says anything."""
    weighted = ((appearance, config.appearance_weight), (relative_pose, config.pose_weight))
    product: Scores | None = None
    for term, weight in weighted:
        if term is not None:
            share = np.maximum(term / max(float(term.max()), 1e-12), config.floor) ** weight
            product = share if product is None else product * share
    return product
