"""How a part was turned when it was last seen on its way: a witness for what its place hides.

Not in the paper. Once a slider is in its guide nothing shows of it, neither to networks nor in depth, and one
put in reversed looks like the right one. But nobody turns a part by half on its last centimetres: as it was
turned when it was last seen, so it is in its place. That tells apart the states that join it there, and says
nothing of those that do not.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Part, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Intrinsics, Scores, Transform
from asdfviz.geometry.transforms import inverse
from asdfviz.state.joints import Deviation, off_nominal
from asdfviz.state.twins import twin_groups

LEAST = 2
"""A single frame may be wrong."""


@dataclass(frozen=True)
class LastTurnsConfig:
    """What is seen of a part on its way, and what that says."""

    enabled: bool = True
    """On or off."""
    sure: float = 0.6
    """Score from which a pose says how its part is turned, 0 to 1."""
    near: float = 0.12
    """Farther from all its places nothing can be told yet, metres: a hand may still turn it."""
    frames: int = 4
    """Of the frames in which it was seen the last ones count, so many."""
    sigma: float = 0.6
    """Standard deviation of how it is turned on its way, radians."""
    most: float = 4.0
    """Log odds against a state that has it turned otherwise, at most."""
    hidden: float = 0.3
    """A part is hidden where in all its places it shows less than this share of what its box shows in the mean
    of all directions."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 <= self.sure <= 1:
            raise MethodError(f"last_turns.sure is {self.sure:g}, use a score from 0 to 1")
        if self.frames < LEAST:
            raise MethodError(f"last_turns.frames is {self.frames}, use {LEAST} or more")
        for name in ("near", "sigma", "hidden"):
            if not 0 < getattr(self, name) < math.inf:
                raise MethodError(f"last_turns.{name} is {getattr(self, name):g}, use more than 0")
        if not 0 <= self.most < math.inf:
            raise MethodError(f"last_turns.most is {self.most:g}, use 0 or more")


class LastTurns:
    """What was seen in one sequence of parts that states join turned in several ways."""

    def __init__(self, assembly: Assembly, *, config: LastTurnsConfig) -> None:
        """Begin a sequence."""
        self._assembly, self._config = assembly, config
        alone = (names[0] for names in twin_groups(assembly) if len(names) == 1)
        states = {name: _joining(assembly, name) for name in alone if name != assembly.base}
        self._states = {
            name: joining
            for name, joining in states.items()
            if config.enabled and _are_turned(assembly.parts[name], joining, config.sigma)
        }
        self._seen = {name: deque[Scores](maxlen=config.frames) for name in self._states}
        """Of each part the costs of its last turns, by state; NaN where a state does not join it."""
        self._areas = {name: _mean_outline(assembly.parts[name]) for name in self._states}
        self._pixels = 0.0
        """What a square metre shows at the base, pixels."""

    def step(
        self,
        base: PoseEstimate | None,
        poses: Mapping[str, PoseEstimate],
        *,
        K: Intrinsics,
        place: Callable[[str, State], Transform],
        shown_px: Callable[[str, State], float],
    ) -> Scores | None:
        """Probability of every state by this alone; None where it says nothing.

        Args:
            base: where the base part is, if that is known.
            poses: of the parts, those that a state only placed left out or of stage "group".
            K: of the camera.
            place: T_base_part where a state joins a part, as its joint is known.
            shown_px: in how many pixels a part shows where a state joins it.
        """
        against = np.zeros(len(self._assembly.states))
        if base is not None:
            self._pixels = float(K[0, 0] * K[1, 1] / base.T_camera_part[2, 3] ** 2)
        for name, joining in self._states.items():
            pose = poses.get(name)
            if pose is not None and pose.score >= self._config.sure and pose.stage != "group":
                if base is not None:
                    T_base_part = inverse(base.T_camera_part) @ pose.T_camera_part
                    self._see(name, T_base_part, place)
            elif len(self._seen[name]) >= LEAST and self._is_hidden(name, joining, shown_px):
                costs = np.mean(self._seen[name], axis=0)
                against += np.nan_to_num(np.minimum(costs - np.nanmin(costs), self._config.most))
        if not against.any():
            return None
        scores = np.exp(-against)
        return scores / scores.sum()

    def _see(
        self, name: str, T_base_part: Transform, place: Callable[[str, State], Transform]
    ) -> None:
        part, costs = self._assembly.parts[name], np.full(len(self._assembly.states), np.nan)
        nearest = math.inf
        for state in self._states[name]:
            off = _off(T_base_part, part, state, place(name, state))
            costs[state.index] = 0.5 * (off.angle / self._config.sigma) ** 2
            nearest = min(nearest, off.distance)
        if nearest > self._config.near:
            self._seen[name].clear()
        else:
            self._seen[name].append(costs)

    def _is_hidden(
        self, name: str, joining: tuple[State, ...], shown_px: Callable[[str, State], float]
    ) -> bool:
        most = self._config.hidden * self._areas[name] * self._pixels
        return all(shown_px(name, state) < most for state in joining)


def _mean_outline(part: Part) -> float:
    """What a part's box covers, seen from all directions, in the mean: a quarter of its surface (Cauchy), m²."""
    x, y, z = np.ptp(part.mesh.vertices, axis=0)
    return float(x * y + y * z + z * x) / 2


def _joining(assembly: Assembly, name: str) -> tuple[State, ...]:
    return tuple(state for state in assembly.states if name in state.T_base_part)


def _are_turned(part: Part, joining: tuple[State, ...], sigma: float) -> bool:
    """Whether any two of the states have a part turned differently."""
    return any(
        _off(a.T_base_part[part.name], part, b, b.T_base_part[part.name]).angle > sigma
        for a in joining
        for b in joining
    )


def _off(T_base_part: Transform, part: Part, state: State, T_place: Transform) -> Deviation:
    """How far a part is from its place in a state; what turns about a ball goes by where that is."""
    joint = state.joints.get(part.name)
    if joint is None or joint.kind == "ball":
        return off_nominal(T_base_part, part, T_place, None)
    return off_nominal(T_base_part, part, state.T_base_part[part.name], joint)
