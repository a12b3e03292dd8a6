"""A left-to-right hidden Markov model over the assembly's states: the online filter.

The paper's Pose2State averages, so it has inertia and never vetoes. Here a state can only be
reached along the assembly's transitions, evidence multiplies, and a state that all terms rule out
is out. `StateFilter` uses the past alone; `asdfviz.state.decoding` a whole recording by the same
model, and is reported apart from it (`asdfviz.state.offline`).

The frame in which a part arrives is a state of its own (`asdfviz.state.arrivals`).

States only change in frames that tell them apart. Where nothing is seen, or all states are equally
likely, the belief stays: else a covered camera would go through the steps by itself, since the model
expects the next one.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeGuard

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import AllScores, Scores
from asdfviz.state.arrivals import Arrivals
from asdfviz.state.half_done import errors_alike, not_yet

ALIKE = 1e-9
"""Evidence of which the largest and the least differ by less than this share tells nothing."""


@dataclass(frozen=True)
class SmoothingConfig:
    """How fast states change and how far one frame's evidence is trusted."""

    stay: float = 0.96
    """Probability that a state lasts for another frame that tells states apart: 25 frames a state, as
    in the paper's sequences."""
    stay_wrong: float = 0.5
    """Probability that an error lasts for another frame: it is undone at once, and while it is there
    every frame says so. One that joins the same as a half-done state lasts as that one does (`stay`),
    which would outlast it."""
    leak: float = 1e-4
    """Probability of a jump to any later state: a missed step must not lock the model."""
    fall: float = 1e-6
    """Probability of a fall back to any earlier state: what is joined stays joined, but the model
    may have been wrong."""
    mistakes: float = 0.4
    """Weight of a way that leads into an error state against that of the right next step."""
    at_once: float = 0.1
    """Weight of a step that adds several parts at once against that of each of its first parts alone: a hand
    brings one after the other."""
    appearance_weight: float = 0.6
    """Exponent of the network's term; evidence of neighbouring frames is not independent."""
    pose_weight: float = 0.8
    """Exponent of the relative poses' term."""
    group_weight: float = 1.0
    """Exponent of the group's term."""
    place_weight: float = 1.0
    """Exponent of the term of what stands in the places of joined parts."""
    arrival: bool = True
    """Whether a part arrives for one frame before the state that joins it is reached."""
    floor: float = 0.02
    """Evidence is never below this share of its largest value: one frame does not rule out alone."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a number is out of its range."""
        for name in ("stay", "stay_wrong", "leak", "fall"):
            if not 0 <= getattr(self, name) <= 1:
                raise MethodError(f"smoothing.{name} is {getattr(self, name):g}, use 0 to 1")
        weights = ("appearance_weight", "pose_weight", "group_weight", "place_weight")
        for name in ("mistakes", "at_once", *weights):
            if not 0 <= getattr(self, name) < math.inf:
                raise MethodError(f"smoothing.{name} is {getattr(self, name):g}, use 0 or more")
        if not 0 < self.floor <= 1:  # where two terms disagree, nothing would be left
            raise MethodError(f"smoothing.floor is {self.floor:g}, use more than 0, at most 1")


FOLLOWED = SmoothingConfig(
    appearance_weight=0.15, pose_weight=0.25, group_weight=0.4, place_weight=0.6
)
"""As `asdf_plus` and `asdf_track` have it. Appearance counts little: a lightly trained network mistakes
states more often than places. What is seen of the group errs alike in frames that look alike, so it
counts less than once a frame."""


class StateFilter:
    """The model online: the probability of every state given all frames so far."""

    def __init__(
        self,
        assembly: Assembly,
        *,
        config: SmoothingConfig | None = None,
        half_done: Collection[int] = (),
    ) -> None:
        """Begin a sequence; `half_done` as for `transition_matrix`."""
        self._config = config or SmoothingConfig()
        self._assembly = assembly
        self._model = with_arrivals(assembly, config=self._config, half_done=half_done)
        self._alike = errors_alike(assembly, half_done)
        self._belief: AllScores | None = None

    def reset(self) -> None:
        """Forget the sequence."""
        self._belief = None

    @property
    def belief(self) -> Scores | None:
        """The probability of every state after the last frame; None before anything was ever seen."""
        return None if self._belief is None else self._model.counted(self._belief)

    @property
    def shown(self) -> Scores | None:
        """The same, but that a part that arrives in this frame counts as where it arrives."""
        return None if self._belief is None else self._model.seen(self._belief)

    def step(
        self,
        appearance: Scores | None,
        relative_pose: Scores | None,
        group_fit: Scores | None = None,
        place_looks: Scores | None = None,
    ) -> Scores | None:
        """Take in one frame; None before anything was ever seen. What tells nothing changes nothing.

        Args:
            appearance: probabilities by looks, None where they say nothing.
            relative_pose: probabilities by relative poses, None likewise.
            group_fit: probabilities by what the camera sees of each state's group, None likewise.
            place_looks: probabilities by what stands in the places of joined parts, None likewise.
        """
        evidence = combined(appearance, relative_pose, group_fit, place_looks, config=self._config)
        if self._belief is None:
            if evidence is None:
                return None
            self._belief = self._possible(self._model.begun(evidence / evidence.sum()))
        elif tells(evidence):
            joint = (self._belief @ self._model.move) * evidence[self._model.shown]
            self._belief = self._possible(joint / joint.sum())
        return self.belief

    def _possible(self, belief: AllScores) -> AllScores:
        """Where a half-done state lasts, the way through its end and back by an error adds up: not taken."""
        return not_yet(belief, self.belief, self._assembly, self._alike)


def transition_matrix(
    assembly: Assembly, *, config: SmoothingConfig, half_done: Collection[int] = ()
) -> Float64[np.ndarray, "n n"]:
    """Return P(next state | state): stay, move on along a legal transition, or rarely jump or fall back.

    Correct states lead to the next one even where assembly.yaml lists no transition.

    Args:
        assembly: its states and transitions.
        config: how fast states change.
        half_done: states that last and are entered as correct ones although they are no steps.
    """
    count = len(assembly.states)
    wrong = {state.index for state in assembly.errors} - set(half_done)
    legal = np.zeros((count, count))
    for a, b in _legal(assembly):
        legal[a, b] = config.mistakes if b in wrong else 1.0
    for a, b in _steps(assembly):
        if any(legal[a, k] for k in half_done):
            legal[a, b] = config.at_once
    ways = legal.sum(axis=1, keepdims=True)
    short = wrong - errors_alike(assembly, half_done).keys()
    lasting = np.array([config.stay_wrong if k in short else config.stay for k in range(count)])
    onward = (1 - lasting[:, None]) * legal / np.where(ways > 0, ways, 1.0)
    stay = np.where(ways[:, 0] > 0, lasting, 1.0)
    completed = np.array([state.completed for state in assembly.states])
    is_later = completed[None] >= completed[:, None]
    jump = np.where(is_later, config.leak, config.fall) / count
    move = (1 - config.leak) * (np.diag(stay) + onward) + jump
    return move / move.sum(axis=1, keepdims=True)


def _legal(assembly: Assembly) -> list[tuple[int, int]]:
    """The ways from a state to the next, errors and half-done states among them."""
    return sorted({*_steps(assembly), *((a, b) for a, b in assembly.transitions if a != b)})


def _steps(assembly: Assembly) -> list[tuple[int, int]]:
    """From each step to the next."""
    return list(pairwise(state.index for state in assembly.steps))


def with_arrivals(
    assembly: Assembly, *, config: SmoothingConfig, half_done: Collection[int]
) -> Arrivals:
    """All states of the model and how they follow each other; arguments as for `transition_matrix`."""
    move = transition_matrix(assembly, config=config, half_done=half_done)
    return Arrivals.of(assembly, move, _legal(assembly) if config.arrival else ())


def combined(
    appearance: Scores | None,
    relative_pose: Scores | None,
    group_fit: Scores | None = None,
    place_looks: Scores | None = None,
    *,
    config: SmoothingConfig,
) -> Scores | None:
    """Multiply the terms, each tempered; None where none says anything."""
    weighted = (
        (appearance, config.appearance_weight),
        (relative_pose, config.pose_weight),
        (group_fit, config.group_weight),
        (place_looks, config.place_weight),
    )
    product: Scores | None = None
    for term, weight in weighted:
        if term is not None:
            share = np.maximum(term / max(float(term.max()), 1e-12), config.floor) ** weight
            product = share if product is None else product * share
    return product


def tells(evidence: Scores | None) -> TypeGuard[Scores]:
    """Whether it tells any two states apart."""
    return evidence is not None and float(np.ptp(evidence)) > ALIKE * float(evidence.max())
