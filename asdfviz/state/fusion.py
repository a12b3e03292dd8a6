"""Pose2State: fuses appearance, relative pose and the previous frame (equations 3 to 5).

Our reading, in the paper's symbols, for state s of frame f (index t in time):

    (3)  S_f(s)     = w_DL * S_DL(s) + w_P * S_P(s)
    (4)  S_{f-1}(s) = (1 - 2 n) P(s_{t-1} = s) + n P(s_{t-1} = s - 1) + n P(s_{t-1} = s + 1)
    (5)  P(s_t = s) = w_f * S_f(s) + w_{f-1} * S_{f-1}(s)

(3) and (5) divided by the sum of their weights, so that all sum to 1. The paper gives none of the
weights. P(s_{t-1}) is the fused result of the previous frame, so the average is recursive: it has
inertia and never vetoes.

What the paper leaves open, and what is done here:

- t = 0: there is no previous frame; P = S_f. No state is favoured at the start.
- First and last state: the share of the neighbour that does not exist stays with the state itself,
  or both ends would slowly lose to the middle when nothing speaks.
- Error states: their neighbours are the states that `Assembly.transitions` links them with, either
  way round, and they are neighbours of those in turn; correct states have s - 1 and s + 1. A state
  with k neighbours gives n to each and keeps 1 - k n (n is lowered where k n would exceed a half).
- No base part (S_P is None): S_f is S_DL alone. No state box and no base, or no state classes (S_DL
  is None): S_f is S_P alone. In (5) it then has its own share of w_f, w_DL or w_P: what is missing
  lends no weight, so that one term alone does not overrule what both have said before.
- What is told is P raised to a power (`sharpness`) and divided by its sum: means of means are flat, and
  of states that had 0.8 of P all were right, but they were one frame in a hundred. P itself goes on.
- An error that joins what a half-done step joined before it (one of two screws came off again) looks
  like that one. Until the step that it follows was reached, by the previous frame, what S_f gives to it
  counts to the step before.
- A part that was found loose shortly before is not joined yet (`asdfviz.state.lately_loose`): so much of
  S_f as that takes from a state counts to the step before it.
- Neither term, or none that has a weight: nothing was seen; the previous result is kept as it is, and
  before any evidence the state is unknown (None).
- State 0, which has no class: see `asdfviz.state.appearance`.

Where both terms speak, the default weights follow a real transition within 3 frames although states
may last 7 only; the tests simulate it. The looks alone take about twice as long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores
from asdfviz.state.half_done import HalfDone, not_yet
from asdfviz.state.held_back import held_back


@dataclass(frozen=True)
class FusionConfig:
    """The weights of equations 3 to 5; the paper names them and gives no values.

    Chosen on twenty sequences under GBOT's conditions, every first, second and third frame of them: with
    0.3, 0.25 and 0.013 for w_DL, w_f and n 70.5, 72.2 and 70.3 % of their states were right, with these
    74.1, 74.4 and 71.8.
    """

    w_dl: float = 0.15
    """w_DL, equation 3: weight of the network's state boxes."""
    w_p: float = 0.85
    """w_P, equation 3: weight of the relative poses."""
    w_f: float = 0.3
    """w_f, equation 5: weight of this frame."""
    w_previous: float = 0.7
    """w_{f-1}, equation 5: weight of the previous frame."""
    neighbour: float = 0.006
    """n, equation 4: share of each neighbour's previous probability."""
    sharpness: float = 2.5
    """Power of what is told; 1: equation 5 as it is. Of 2.5 the probabilities of those twenty sequences
    are calibrated best (the mean logarithm of the true state's is -0.84, with 1 -1.14)."""
    errors_wait: bool = True
    """What is given to errors that cannot be there yet counts to the steps that they look like. Paper:
    no such rule."""
    w_places: float = 0.36
    """w_DL where the state network tells the looks: it is right more often. Of a sequence of the paper's
    GearedCaliper with 0, 0.15, 0.36 and 0.85 64, 76, 90 and 88 % of the states were right."""
    error_odds: float = 1.0
    """By the poses: how much likelier each error is than a correct state before anything is seen."""
    error_odds_places: float = 0.3
    """The same where the state network tells the looks (which have their own, `appearance.error_odds`):
    what poses cannot tell apart, it can."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a weight is out of its range."""
        for name in ("w_dl", "w_p", "w_f", "w_previous", "w_places"):
            if not 0 <= getattr(self, name) < math.inf:
                raise MethodError(
                    f"fusion.{name} is {getattr(self, name):g}, use a weight from 0 up"
                )
        for name in ("error_odds", "error_odds_places"):
            if not 0 < getattr(self, name) < math.inf:
                raise MethodError(f"fusion.{name} is {getattr(self, name):g}, use more than 0")
        if not (self.w_dl + self.w_p > 0 and self.w_f > 0):
            raise MethodError(
                "fusion: w_dl and w_p are both 0, or w_f is: nothing seen would count"
            )
        if not 0 < self.sharpness < math.inf:
            raise MethodError(f"fusion.sharpness is {self.sharpness:g}, use a power above 0")
        if not 0 <= self.neighbour <= 1:
            raise MethodError(f"fusion.neighbour is {self.neighbour:g}, use a share from 0 to 1")

    def chosen(self, *, places: bool) -> FusionConfig:
        """The weights with w_DL and the odds of errors as they are for these looks.

        Args:
            places: whether the state network tells them.
        """
        if not places:
            return self
        return replace(self, w_dl=self.w_places, error_odds=self.error_odds_places)


class Pose2State:
    """Holds the previous frame's result; one for each sequence."""

    def __init__(self, assembly: Assembly, *, config: FusionConfig | None = None) -> None:
        self._config = config or FusionConfig()
        self._carry = _carry_matrix(neighbours(assembly), self._config.neighbour)
        ways = HalfDone.of(assembly)
        self._assembly = assembly
        self._odds = np.ones(len(assembly.states))
        self._odds[[state.index for state in assembly.errors]] = self._config.error_odds
        alike = ways.alike.items() if self._config.errors_wait else ()
        self._alike = {error: ways.before[k] for error, k in alike}
        self._previous: Scores | None = None

    def reset(self) -> None:
        """Forget the previous frame."""
        self._previous = None

    @property
    def belief(self) -> Scores | None:
        """P of the last frame, not sharpened; None before anything was ever seen."""
        return self._previous

    def step(
        self,
        appearance: Scores | None,
        relative_pose: Scores | None,
        lately_loose: Scores | None = None,
    ) -> StateEstimate | None:
        """Fuse one frame's terms with the frame before; None before anything was ever seen.

        Args:
            appearance: S_DL, or None where it says nothing.
            relative_pose: S_P, or None where it says nothing.
            lately_loose: how likely the states are by what lay loose, None likewise.

        Returns:
            The probabilities, sharpened, and every term that was there under "appearance",
            "relative_pose", "lately_loose" and "previous".
        """
        said = {
            "appearance": appearance,
            "relative_pose": relative_pose,
            "lately_loose": lately_loose,
        }
        terms = {name: term for name, term in said.items() if term is not None}
        current = self._current(appearance, relative_pose)
        if current is not None and lately_loose is not None:
            current = held_back(current, lately_loose, self._assembly)
        if self._previous is not None:
            terms["previous"] = self._carried(self._previous)
        share = self._share(appearance, relative_pose)
        fused = self._fused(current, terms.get("previous"), share)
        if fused is None:
            return None
        self._previous = fused
        sharp = (fused / fused.max()) ** self._config.sharpness
        return StateEstimate(probabilities=_normalized(sharp), terms=terms)

    def _current(self, S_dl: Scores | None, S_p: Scores | None) -> Scores | None:
        """Equation 3, errors that cannot be there yet counted to the steps that look like them."""
        if S_p is not None:
            S_p = _normalized(S_p * self._odds)
        if S_dl is None or S_p is None:
            S_f = S_dl if S_p is None else S_p
        else:
            S_f = _normalized(self._config.w_dl * S_dl + self._config.w_p * S_p)
        return S_f if S_f is None else not_yet(S_f, self._previous, self._assembly, self._alike)

    def _carried(self, previous: Scores) -> Scores:
        """Equation 4."""
        return self._carry @ previous

    def _share(self, S_dl: Scores | None, S_p: Scores | None) -> float:
        """How much of equation 3 is there, by weight, 0 to 1."""
        if (S_dl is None) == (S_p is None):
            return 1.0
        w_dl, w_p = self._config.w_dl, self._config.w_p
        return (w_dl if S_p is None else w_p) / (w_dl + w_p)

    def _fused(self, current: Scores | None, carried: Scores | None, share: float) -> Scores | None:
        """Equation 5, with this share of the weight of the frame."""
        if current is None:
            return self._previous
        if carried is None:
            return current
        w_f, w_previous = share * self._config.w_f, self._config.w_previous
        if w_f + w_previous == 0:
            return self._previous
        return _normalized(w_f * current + w_previous * carried)


def neighbours(assembly: Assembly) -> Float64[np.ndarray, "n n"]:
    """Which states are neighbours, as a symmetric matrix of 0 and 1."""
    adjacency = np.zeros((len(assembly.states), len(assembly.states)))
    steps = [state.index for state in assembly.steps]
    for a, b in pairwise(steps):
        adjacency[a, b] = adjacency[b, a] = 1.0
    errors = {state.index for state in assembly.errors}
    for a, b in assembly.transitions:
        if a != b and (a in errors or b in errors):
            adjacency[a, b] = adjacency[b, a] = 1.0
    return adjacency


def _carry_matrix(
    adjacency: Float64[np.ndarray, "n n"], share: float
) -> Float64[np.ndarray, "n n"]:
    """Equation 4 as a matrix; rows and columns sum to 1."""
    links = adjacency.sum(axis=1)
    share = min(share, 0.5 / max(float(links.max()), 1.0))
    return share * adjacency + np.diag(1 - share * links)


def _normalized(scores: Scores) -> Scores:
    return scores / scores.sum()
