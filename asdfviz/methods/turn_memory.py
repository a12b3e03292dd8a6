"""The turns in which a part may be, and what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64

from asdfviz.geometry.shapes import Rotation, Transform
from asdfviz.geometry.symmetry import Symmetries, nearest_symmetric
from asdfviz.geometry.transforms import rotation_about
from asdfviz.methods.refinding import QUARTER_TURNS
from asdfviz.methods.turn_config import TurnConfig


def _turns() -> tuple[Rotation, ...]:
    """Half turns first, as most parts that are taken for turned are taken end for end; quarter turns;
    a third and two thirds of those, for what has several lobes; then all that a cube has besides."""
    axes = np.eye(3)
    slight = [rotation_about(a, s * np.pi / 6) for s in (1, -1, 2, -2) for a in axes]
    cube = sorted(
        QUARTER_TURNS[1:], key=lambda R: (np.count_nonzero(np.diag(R)) < 3, -float(np.trace(R)))
    )
    return (*cube[:9], *slight, *cube[9:])


TURNS = _turns()
SPUN = tuple(half @ slight for half in TURNS[:3] for slight in TURNS[9:21])
"""Taken end for end and turned besides, as what lies on its side or has a handle is."""


@dataclass(slots=True, eq=False)
class TurnMemory:
    """What is known of one part's turns."""

    T_camera_part: Transform
    """The pose when it was last in it."""
    turns: tuple[Rotation, ...] = TURNS
    """That are tried: those of all parts, and in which it was and was wrong."""
    lead: Float64[np.ndarray, "turns"] = field(init=False)
    """Of each over the pose that is believed."""
    liked: Float64[np.ndarray, "turns"] = field(init=False)
    """What of it is the crop network's liking."""
    last: int = -1
    """That was tried."""
    tried: Bool[np.ndarray, "turns"] = field(init=False)
    """Those that were."""
    rested: int = 0
    """Frames since the last try."""
    held: int = 0
    """Frames in which it was in this pose."""
    left: int = 0
    """Frames since it was last in this pose."""

    def __post_init__(self) -> None:
        """Nothing is known yet."""
        self.lead, self.liked = np.zeros((2, len(self.turns)))
        self.tried = np.zeros(len(self.turns), dtype=bool)

    @property
    def wrong(self) -> tuple[Rotation, ...]:
        """Turns of it that it was in and that were wrong, the last first."""
        return self.turns[len(TURNS) :]

    def expect(self, T_camera_part: Transform, symmetries: Symmetries, *, lead: float) -> None:
        """Let the turn nearest to a pose of the part, of these symmetries, begin with a lead."""
        T_near = nearest_symmetric(T_camera_part, self.T_camera_part, symmetries)
        R_now_near = self.T_camera_part[:3, :3].T @ T_near[:3, :3]
        self.lead[np.einsum("tij,ij->t", np.stack(self.turns), R_now_near).argmax()] = lead

    @property
    def seen(self) -> Float64[np.ndarray, "turns"]:
        """The lead of each but for the crop network's liking."""
        return self.lead - self.liked

    @property
    def ahead_seen(self) -> float:
        """By how much a turn is ahead by what was seen, at most; below 0 where none is."""
        return float(self.seen.max())

    def next(self, config: TurnConfig) -> list[int]:
        """The turns to try: one that is ahead, or the next that are open, at first those that were not tried
        and one that is hardly behind; now and then any."""
        ahead = np.maximum(self.lead, self.seen)
        if ahead.max() > 0:
            return [int(ahead.argmax())]
        order = (self.last + 1 + np.arange(len(self.turns))) % len(self.turns)
        still_open = [int(turn) for turn in order if self.lead[turn] > -config.lead]
        new = [turn for turn in sorted(still_open) if not self.tried[turn]]
        if new:
            is_near = self.tried & (self.seen > -config.near)
            near = sorted((t for t in still_open if is_near[t]), key=lambda t: -self.seen[t])
            return [*near[:1], *new][: config.at_first]
        if still_open:
            return still_open[:1]
        self.rested += 1
        if self.rested < config.again:
            return []
        turn = int(order[0])
        again = [*(k for k in range(len(TURNS), len(self.turns)) if k != turn), turn]
        self.rule_out(again, lead=config.lead)
        return again

    def rightness(self, turn: int, *, config: TurnConfig) -> float:
        """By how much more than enough a turn is ahead to be the right one."""
        lead, seen = float(self.lead[turn]), float(self.seen[turn])
        disliked = min(float(self.liked[turn]), 0.0)
        return max(lead - config.lead, seen + config.disliked * disliked - config.lead_seen)

    def rule_out(self, turns: Sequence[int], *, lead: float) -> None:
        """Let these turns, where they are others, be as far behind as what is no longer open."""
        at = list(turns)
        self.lead[at] = np.where(np.isfinite(self.lead[at]), -lead, -np.inf)
        self.liked[at] = 0.0

    def like(self, turn: int, liked: float, most: float) -> float:
        """Take in what the crop network's liking counts for a turn in a frame; return what is left of it.

        In all it counts for `most` or against, as it errs alike in all frames.
        """
        before = self.liked[turn]
        self.liked[turn] = np.clip(before + liked, -most, most)
        return float(self.liked[turn] - before)

    def out(self, lead: float) -> Float64[np.ndarray, "n 3 3"]:
        """Turns that are no longer open: behind by that much, or wrong before and not ahead now."""
        # Turns that are no others, as the part is symmetric, have no lead.
        out = np.isfinite(self.lead) & (self.lead <= -lead)
        out[len(TURNS) :] = True
        return np.stack(self.turns)[out]
