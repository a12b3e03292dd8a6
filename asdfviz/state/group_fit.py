"""The group's term: which state's group of parts explains what the camera measured, pixel by pixel.

The hypothesis test over states. Every state comes as a drawn scene: the group of parts that it
joins, nearest surfaces first. A pixel's reading and colour are compared with the surface that the
state has there, or with the ground where it has none, and with anything at all:

- on the surface, in its colours: for the state;
- on the surface, in other colours: for it or against it, depending on how well each is known;
- behind the surface: one sees through a part that the state claims, which is against it;
- nearer: something hides it, a hand or a part that nobody has found; neither;
- no reading: neither;
- a black part that is seen to be black, and a reading behind it: neither. Black plastic swallows the light,
  and what is read there lies centimetres behind it.

A part that is about to be joined half looks as if it were, from a centimetre or two away. So where its
own pose is known and is not its place, it stands there in the scenes of the states that do not join it.

Pose and state are decided together: every state's scene may shift by a few pixels, and all of them
lie by the same small amount nearer or farther, until they fit best. Readings of neighbouring pixels
are no independent witnesses: a patch counts as one.

The paper has no such term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int32

from asdfviz.errors import MethodError
from asdfviz.geometry.median import median
from asdfviz.geometry.shapes import Depth, Scores
from asdfviz.state.colors import ColorConfig
from asdfviz.state.ground import GroundConfig, InverseDepth
from asdfviz.state.group_kernels import climb, sum_spoken

Ratios: TypeAlias = Float32[np.ndarray, "k h w"]
"""How much likelier each pixel's colour is on each part, and last on the ground, than anywhere;
natural logarithm."""


BASE_SEEN = 0.1
"""Where less of the base is visible, nothing is known of it, 0 to 1."""


@dataclass(frozen=True)
class GroupFitConfig:
    """How scenes are compared with the picture; the paper has no such step."""

    enabled: bool = True
    """The term, on or off."""
    sigma: float = 0.004
    """Standard deviation of readings and surfaces against each other, metres."""
    hidden: float = 2.5
    """What lies so many standard deviations in front of a surface hides it."""
    range: float = 0.25
    """Readings that nothing explains lie anywhere in so much depth, metres."""
    least: float = -3.0
    """A pixel speaks against a state by no more than this, natural logarithm."""
    patch: float = 0.008
    """Readings within a square of this side count as one witness, metres."""
    temperature: float = 6.0
    """Above 1 the witnesses are trusted less than independent ones: they share the pose's error."""
    cells: int = 72
    """Side of the view in which scenes are compared, at most, cells."""
    shift: int = 2
    """Every state's scene is shifted by so many cells, at most."""
    enough: float = 0.9
    """A base pose with which so much of the visible group agrees is not looked for elsewhere."""
    moved: float = 3.0
    """Elsewhere than where its pose has it, the base is only looked for if that is better by this,
    natural logarithm,"""
    other: float = 2.0
    """and by this where another pose than its own says so,"""
    moved_visible: float = 0.5
    """and if so much of the group is visible there, 0 to 1,"""
    moved_agreeing: float = 0.7
    """and so much of that agrees, 0 to 1."""
    least_visible: float = 0.2
    """Where less of the best state's group is visible, nothing is said, 0 to 1."""
    least_agreeing: float = 0.5
    """Where less of that agrees, the base is not where it is thought to be, 0 to 1."""
    reach: int = 3
    """The likeliest one is looked for by this many of the largest steps to either side, first."""
    bias: float = 0.006
    """And lies nearer or farther by this at most, metres."""
    in_place: float = 0.008
    """A part whose own pose is farther than this from where any state has it is not joined,"""
    near: float = 0.06
    """and one that is nearer than this stands in the scene of every state that does not join it, metres."""
    black: float = 40.0
    """Parts that are no brighter, 0 to 255, may swallow the light of the depth camera,"""
    black_seen: float = 60.0
    """where the picture is no brighter than this either."""
    smeared: bool = True
    """Whether scenes are drawn with edges as the depth camera smears them: walls that it hardly sees would
    speak against a part in its place, and for one that was tilted until they fit."""
    ground: GroundConfig = field(default_factory=GroundConfig)
    """What lies around the group."""
    colors: ColorConfig = field(default_factory=ColorConfig)
    """The colours of parts."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range, or no number."""
        above = {n: getattr(self, n) for n in ("sigma", "range", "patch", "temperature", "cells")}
        shares = ("enough", "moved_visible", "moved_agreeing", "least_visible", "least_agreeing")
        for name, value in above.items():
            if not 0 < value < np.inf:
                raise MethodError(f"group_fit.{name} is {value:g}, use more than 0")
        for name in shares:
            if not 0 <= (value := getattr(self, name)) <= 1:
                raise MethodError(f"group_fit.{name} is {value:g}, use 0 to 1")
        for name in ("hidden", "shift", "moved", "other", "reach", "bias", "in_place", "near"):
            if not 0 <= (value := getattr(self, name)) < np.inf:
                raise MethodError(f"group_fit.{name} is {value:g}, use 0 or more")

    @property
    def most(self) -> float:
        """What a reading exactly on a surface says for it by depth alone."""
        return float(np.log(self.range / (self.sigma * np.sqrt(2 * np.pi))))


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A state's scene as the camera would see it."""

    inverse_depth: InverseDepth
    ids: Int32[np.ndarray, "h w"]
    """Number of the part, -1 where there is none."""
    ground: InverseDepth | None = None
    """What lies around it as the camera would see it; None: as it is."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What the camera measured, in the same cells."""

    depth: Depth
    ratios: Ratios
    ground: InverseDepth
    """0 where it is not known."""
    swallowed: Bool[np.ndarray, "k h w"]
    """Where each part, and last the ground, may swallow the light."""
    base: int = 0
    """Number of the base part."""


@dataclass(frozen=True, slots=True)
class Move:
    """How a scene lies in the view against how it was drawn."""

    right: float = 0.0
    """Cells."""
    down: float = 0.0
    """Cells."""
    turn: float = 0.0
    """About the view's middle, from right to down, radians."""


STILL = Move()


@dataclass(frozen=True, slots=True)
class Said:
    """What the cells say for a scene."""

    value: float
    """Natural logarithm of a likelihood ratio, were all cells independent."""
    drawn: int
    """Readings at the group."""
    visible: int
    """Of these, those that nothing nearer hides."""
    agreeing: int
    """Of the visible ones, those that are likelier with it than with anything else."""
    base_drawn: int
    """Readings at the base part, where no part of the group hides it."""
    base_visible: int
    """Of these, those that nothing nearer hides."""
    base_agreeing: int
    """Of the visible ones, those that are likelier with it than with anything else."""

    def is_seen(self, *, visible: float, agreeing: float, rests: bool = False) -> bool:
        """Whether such shares of the group are visible and agree, and of the base by itself: another
        part may well be where it should be for a base that is not there.

        Args:
            visible: share of the group.
            agreeing: share of what is visible.
            rests: whether the base is where it was before: then the group may hide it.
        """
        return (
            self.visible > visible * self.drawn
            and self.agreeing > agreeing * self.visible
            and (rests or self.base_visible >= BASE_SEEN * self.base_drawn)
            and self.base_agreeing >= agreeing * self.base_visible
        )


def spoken(
    scene: Drawn, measured: Measured, *, nearer: float, config: GroupFitConfig, move: Move = STILL
) -> Said:
    """What all cells together say for a scene.

    Args:
        scene: as drawn.
        measured: the same cells.
        nearer: how much nearer the scene lies than drawn, metres.
        config: what counts.
        move: how the scene lies in the view.
    """
    at = np.array([move.right, move.down, move.turn])
    total, counts = sum_spoken(_cells(scene, measured), _limits(config), at, nearer)
    return Said(float(total), *(int(count) for count in counts))


def best_spoken(
    scene: Drawn,
    measured: Measured,
    *,
    nearer: float,
    config: GroupFitConfig,
    steps: Sequence[tuple[float, float]],
    rounds: int,
) -> tuple[Said, Move]:
    """The most that the cells say for a scene that may move, and the move; by steps uphill.

    Args:
        scene: as drawn.
        measured: the same cells.
        nearer: as for `spoken`.
        config: as for `spoken`.
        steps: one after the other, cells to the sides and radians about the middle.
        rounds: so often each of them is taken, at most.
    """
    cells, each = _cells(scene, measured), np.array(steps, np.float64)
    total, counts, move = climb(cells, _limits(config), nearer, each, rounds)
    return Said(float(total), *(int(count) for count in counts)), Move(*map(float, move))


def _cells(scene: Drawn, measured: Measured) -> tuple[object, ...]:
    """As `sum_spoken` takes them."""
    drawn = (scene.inverse_depth, scene.ids)
    ground = measured.ground if scene.ground is None else scene.ground
    seen = measured.depth, measured.ratios, ground, measured.swallowed
    return (*drawn, measured.base, *seen)


def _limits(config: GroupFitConfig) -> tuple[float, float, float, float]:
    """As `sum_spoken` takes them."""
    return config.sigma, config.most, config.least, config.hidden


def nearer_by(base: InverseDepth, depth: Depth, *, config: GroupFitConfig) -> float:
    """How much nearer than drawn the base's surface is measured, metres, within bounds."""
    both = (base > 0) & (depth > 0)
    gap = 1.0 / base[both] - depth[both]
    gap = gap[np.abs(gap) < 2 * config.bias]
    if len(gap) == 0:
        return 0.0
    return min(max(median(gap), -config.bias), config.bias)


def trusted(cell: float, *, config: GroupFitConfig) -> float:
    """How much a cell of that side (metres, on the base) counts against an independent witness."""
    return min(1.0, (cell / config.patch) ** 2) / config.temperature


def probabilities(log_likelihoods: Sequence[float]) -> Scores:
    """From what is said for every state to its probability."""
    said = np.asarray(log_likelihoods, np.float64)
    odds = np.exp(said - said.max())
    return odds / odds.sum()
