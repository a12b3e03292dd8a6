"""What lay about loose a moment ago is not joined yet: a witness for the state.

Not in the paper. A part that a hand carries, and one that is too small or too hidden to be found in its
place, are both unseen, and the looks of the group often tell the later state from the first part of a
step on. But where the camera found the part far from all its places shortly before, it is still on its way.

Of each kind of part (twins count together, as nobody tells them apart) q_j is the probability that at
least j of them are loose. In every frame

- q_j is multiplied by 1 - a, unless j or more were found loose: unseen parts get to their places, a of
  them in a frame, `arrives` of them in the time of a step. How long that is the sequence tells itself, by
  the steps that were reached so far and the frames that they took;
- `gain` is added to its log odds where j or more were found loose, and `joined` taken from them where so
  many were found in a place that j cannot be loose.

A state that leaves fewer than j of them loose is as likely as its evidence says only if q_j is below a
half, else 2 (1 - q_j) of that (`asdfviz.state.held_back`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores
from asdfviz.state.joined_spots import JoinedSpots
from asdfviz.state.twins import loose_in_states, twin_groups

LEAST_ODDS = -5.0
"""The log odds of a part being loose are never below."""
MOST_ARRIVING = 0.5
"""Share of the unseen parts that get to their places in a frame, at most."""


@dataclass(frozen=True)
class LatelyLooseConfig:
    """When a part counts as loose, and for how long; the paper has no such step.

    Chosen on nine sequences under GBOT's conditions that no table uses and the eight of Table 1, every first,
    second and third frame of them, by what `asdf` said: without it 82.9, 85.4 and 83.6 % of their states
    were right, with it 86.9, 87.4 and 85.4; of the nine alone 79.6, 81.4 and 79.2, and 82.5, 83.9 and 81.8.
    """

    enabled: bool = True
    """On or off."""
    found: float = 0.5
    """Score from which a pose says where its part is, 0 to 1: of such poses 97 % were within 30 mm."""
    away: float = 0.04
    """Farther than this from where any state has it a part is loose, metres,"""
    in_place: float = 0.02
    """and nearer than this it is in a place."""
    gain: float = 0.7
    """Log odds of being loose for each frame in which it was found loose,"""
    most: float = 3.0
    """but no more than this."""
    joined: float = 2.0
    """Log odds of being joined for each frame in which it was found in a place."""
    arrives: float = 1.0
    """Unseen parts that get to their places in the time of a step, of all that there are."""
    step_frames: float = 10.0
    """That time before anything was seen, frames,"""
    steps: float = 2.0
    """which counts as much as so many steps that were seen."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 <= self.found <= 1:
            raise MethodError(f"lately_loose.found is {self.found:g}, use 0 to 1")
        if not 0 < self.in_place <= self.away < np.inf:
            raise MethodError(
                f"lately_loose.in_place is {self.in_place:g} and away {self.away:g}, use metres above 0, "
                "the second at least as many"
            )
        for name in ("gain", "most", "joined", "arrives"):
            if not 0 <= getattr(self, name) < np.inf:
                raise MethodError(f"lately_loose.{name} is {getattr(self, name):g}, use 0 or more")
        for name in ("step_frames", "steps"):
            if not 0 < getattr(self, name) < np.inf:
                raise MethodError(
                    f"lately_loose.{name} is {getattr(self, name):g}, use more than 0"
                )


@dataclass(slots=True, eq=False)
class _Kind:
    """The twins of one part, or a part that has none."""

    names: tuple[str, ...]
    loose: tuple[int, ...]
    """How many of them every state leaves loose."""
    odds: Float64[np.ndarray, "n"]
    """Log odds that at least one, two, ... are loose."""


class LatelyLoose:
    """What was found loose in one sequence."""

    def __init__(self, assembly: Assembly, *, config: LatelyLooseConfig) -> None:
        self._assembly, self._config, self._frames = assembly, config, 0
        self._step_frames = config.step_frames
        self._spots = JoinedSpots(assembly)
        groups = (
            tuple(n for n in names if n in self._spots.places) for names in twin_groups(assembly)
        )
        self._kinds = [
            _Kind(names, loose_in_states(assembly, names), np.full(len(names), LEAST_ODDS))
            for names in groups
            if names
        ]

    @property
    def step_frames(self) -> float:
        """How long a step takes by what the sequence showed so far, frames."""
        return self._step_frames

    def step(self, poses: Mapping[str, PoseEstimate], belief: Scores | None) -> Scores | None:
        """Take in the poses of one frame.

        Args:
            poses: of the parts, those that a state only placed left out.
            belief: in the states by all frames before, which tells how many steps there were.

        Returns:
            How likely the states are by this alone; None where all are as likely.
        """
        self._step_frames = self._told(belief)
        if not self._config.enabled:
            return None
        share = min(self._config.arrives / self._step_frames, MOST_ARRIVING)
        chances = np.ones(len(self._assembly.states))
        for kind in self._kinds:
            self._count(kind, self._away(kind, poses), share)
            loose = 1.0 / (1.0 + np.exp(-kind.odds))
            most = np.append(np.minimum(1.0, 2.0 * (1.0 - loose)), 1.0)
            np.minimum(chances, most[list(kind.loose)], out=chances)
        return chances / chances.sum() if np.ptp(chances) > 0 else None

    def _told(self, belief: Scores | None) -> float:
        """How long a step takes, frames; counts this one."""
        config = self._config
        reached = 0 if belief is None else self._assembly.states[int(belief.argmax())].completed
        steps, frames = config.steps + reached, config.steps * config.step_frames + self._frames
        self._frames += 1
        return frames / steps

    def _away(self, kind: _Kind, poses: Mapping[str, PoseEstimate]) -> list[float]:
        """Of those that were found, how far each is from all places, metres."""
        base = poses.get(self._assembly.base)
        if base is None:
            return []
        found = (poses[name] for name in kind.names if name in poses)
        return [
            min(
                self._spots.distance(name, pose.T_camera_part, base.T_camera_part)
                for name in kind.names
            )
            for pose in found
            if pose.score >= self._config.found and pose.stage != "group"
        ]

    def _count(self, kind: _Kind, away: Sequence[float], share: float) -> None:
        """Take in those that were found, by how far they are from all places."""
        config = self._config
        loose = sum(distance > config.away for distance in away)
        joined = sum(distance < config.in_place for distance in away)
        odds = kind.odds.copy()
        unseen = (1.0 - share) / (1.0 + np.exp(-odds[loose:]))
        odds[loose:] = np.log(unseen) - np.log1p(-unseen)
        odds[:loose] += config.gain
        odds[max(loose, len(odds) - joined) :] -= config.joined
        odds = np.maximum.accumulate(odds[::-1])[::-1]  # where two are loose, one is
        kind.odds = np.clip(odds, LEAST_ODDS, config.most)
