"""Whether a part is not rather turned otherwise: other turns of it, settled and compared over time.

Not in the paper. A part taken end for end looks almost the same, and a network that never learnt the
difference prefers the wrong end in every frame. Settled by contours and depth and drawn, the right one
looks more like what is seen, which a few frames tell; the wrong one often stands in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Frame, Part
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import nearest_symmetric, symmetric_angle
from asdfviz.geometry.threads import side_by_side
from asdfviz.geometry.transforms import point_distance, rotation_angle
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.refinding import turned
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_looks import TurnLooks
from asdfviz.methods.turn_memory import SPUN, TURNS, TurnMemory
from asdfviz.methods.turn_table import TurnTable
from asdfviz.state.twins import renamed
from asdfviz.track.bodies import Body
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

Ahead: TypeAlias = Callable[[Trial], tuple[float, float]]
"""By how much a pose agrees better with what is seen than the one that the part has, and what the crop
network's liking counts for it."""

ROUGH = 2
"""Of all of them as many searches tell"""
SETTLED = 4
"""which ones are settled to the end."""
OVERLAPPING = 0.6
"""Poses whose centres are nearer than this share of a part's diameter show much the same of the picture:
a wheel taken end for end has its middle a third of its diameter deeper, as its hub looks up."""


class TurnChecks:
    """Checks the turns of the parts of one sequence."""

    def __init__(
        self,
        parts: Mapping[str, Part],
        bodies: Mapping[str, Body],
        *,
        config: TurnConfig,
        smear: SeenSmear | None = None,
    ) -> None:
        """Begin a sequence; `smear` is what others see of the depth camera's."""
        self._parts, self._bodies, self._config = parts, bodies, config
        self._table = TurnTable(parts, config=config.table)
        self.looks = TurnLooks(parts, bodies, self._table, config=config, smear=smear)
        """Has to be told where parts surely are."""
        self._turns: dict[str, list[TurnMemory]] = {}
        self._same = float(np.deg2rad(config.same_deg))
        self._first = 0

    def allows(self, frame: Frame, name: str, T_now: Transform, T_other: Transform) -> bool:
        """Whether another pose of a part is none that was ruled out, by the table or as a turn.

        Poses elsewhere, and those that are much the same, are never ruled out.
        """
        if not self._config.enabled:
            return True
        part, centre = self._parts[name], self._bodies[name].model.centre
        apart = point_distance(T_now, T_other, centre) / part.diameter
        if self._angle(name, T_now, T_other) < self._same:
            return True
        table = self._config.table
        if apart <= table.place:
            _, against = self._table.said(frame, name, T_now, T_other)
            if against > table.worse:
                return False
        if name not in self._turns or apart > OVERLAPPING:
            return True
        wrong = self._turns[name][0].out(self._config.lead)
        if not len(wrong):
            return True
        T_near = nearest_symmetric(T_other, T_now, part.symmetries)
        Ss = (np.eye(4), *part.symmetries.discrete)
        Rs_now_other = np.stack([T_now[:3, :3].T @ (T_near @ S)[:3, :3] for S in Ss])
        traces = np.einsum("sij,tij->st", Rs_now_other, wrong)
        return bool(traces.max() < 1 + 2 * np.cos(self._same))

    def is_turn(self, name: str, T_now: Transform, T_other: Transform) -> bool:
        """Whether a pose of a part has it turned otherwise in about the same place."""
        apart = point_distance(T_now, T_other, self._bodies[name].model.centre)
        if not self._config.enabled or apart > OVERLAPPING * self._parts[name].diameter:
            return False
        return self._angle(name, T_now, T_other) >= self._same

    def in_favour(
        self, frame: Frame, name: str, T_now: Transform, T_other: Transform
    ) -> float | None:
        """How much more another turn of a part would look like what is seen.

        None where that is unknown, for poses elsewhere, and for those that are much the same.
        """
        if not self.is_turn(name, T_now, T_other):
            return None
        return self.looks.ahead(frame, name, T_now, T_other)

    def step(
        self,
        frame: Frame,
        tracker: Tracker,
        poses: Mapping[str, Transform],
        looked_at: Mapping[str, LookedAt] | None = None,
    ) -> dict[str, Transform]:
        """Parts that are turned otherwise, with their poses T_camera_part.

        Args:
            frame: with depth.
            tracker: knows the parts' colours; nothing is moved.
            poses: settled in this frame or one before.
            looked_at: what crops told of the parts in this frame, if anything.
        """
        if not self._config.enabled or not poses:
            return {}
        self._recall(poses)
        looks, asked = looked_at or {}, self._asked(list(poses))
        checked = side_by_side(
            lambda name: self._checked(frame, tracker, name, poses[name], looks.get(name)), asked
        )
        found: dict[str, Transform] = {}
        for name, right in zip(asked, checked, strict=True):
            if right is not None:
                T_wrong, found[name] = right
                self._turns[name][0] = self._begun(name, T_wrong, found[name])
        return found

    def contested(self) -> dict[str, float]:
        """By how much another turn of a part is ahead by what was seen, of those that are checked."""
        return {name: known[0].ahead_seen for name, known in self._turns.items()}

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._turns = renamed(self._turns, names)

    def _asked(self, names: list[str]) -> list[str]:
        """Parts to check in this frame: half of them of which another turn is ahead, the others by turns."""
        start, a_frame = self._first % len(names), self._config.a_frame
        in_turn = names[start:] + names[:start]
        lead = self.contested()
        ahead = sorted((name for name in in_turn if lead[name] > 0), key=lambda name: -lead[name])
        first = ahead[: a_frame // 2]
        others = [name for name in in_turn if name not in first][: a_frame - len(first)]
        self._first += len(others)
        return first + others

    def _recall(self, poses: Mapping[str, Transform]) -> None:
        """Begin anew with parts that somebody else turned, unless that pose was known not long ago."""
        for name, T in poses.items():
            kept: list[TurnMemory] = []
            known = TurnMemory(T)
            for before in self._turns.get(name, ()):
                if self._angle(name, before.T_camera_part, T) <= self._same:
                    known = before
                elif before.left < self._config.known:
                    before.left += 1
                    kept.append(before)
            # What was lost and is found where it was is tried first as it was.
            if known.last < 0 and self._config.was > 0:
                symmetries = self._parts[name].symmetries
                for before in kept:
                    was_long = before.held >= self._config.held
                    if was_long and self.is_turn(name, T, before.T_camera_part):
                        known.expect(before.T_camera_part, symmetries, lead=self._config.was)
            known.T_camera_part, known.left, known.held = T, 0, known.held + 1
            self._turns[name] = [known, *kept]

    def _begun(self, name: str, T_wrong: Transform, T_right: Transform) -> TurnMemory:
        """What is known of a part that was turned: it is not as it was, before that neither."""
        R_right_wrong = T_right[:3, :3].T @ T_wrong[:3, :3]
        wrong = [R_right_wrong, *(R_right_wrong @ R for R in self._turns[name][0].wrong)]
        # Where it is right now may have been taken for wrong once.
        far = [R for R in wrong if rotation_angle(R) > self._same]
        return TurnMemory(T_right, (*TURNS, *far[: self._config.remembered]))

    def _checked(
        self, frame: Frame, tracker: Tracker, name: str, T_now: Transform, look: LookedAt | None
    ) -> tuple[Transform, Transform] | None:
        """The part's pose and that in another turn, if that is the right one."""
        known, centre = self._turns[name][0], self._bodies[name].balance
        turns = known.next(self._config)
        starts = [turned(T_now, known.turns[turn], centre=centre) for turn in turns]
        if not starts:
            return None
        now, *others = tracker.trials(frame, name, [T_now, *starts])
        if now.evidence.visible < self._config.visible:
            return None
        known.last, known.rested = turns[-1], 0
        known.tried[turns] = True
        ahead = partial(self._ahead, frame, name, look, now)
        for turn, other in zip(turns, others, strict=True):
            self._judge(name, known, turn, now, other, ahead)
        turn = max(turns, key=partial(known.rightness, config=self._config))
        if known.rightness(turn, config=self._config) < 0:
            return None
        right = self._best(frame, tracker, name, now, others[turns.index(turn)], ahead)
        if right is None or self._looks_worse_laid(frame, name, now.T_camera_part, right):
            known.rule_out([turn], lead=self._config.lead)
            return None
        return now.T_camera_part, right

    def _judge(
        self, name: str, known: TurnMemory, turn: int, now: Trial, other: Trial, ahead_by: Ahead
    ) -> None:
        """Note what a frame says for a turn."""
        if self._angle(name, now.T_camera_part, other.T_camera_part) < self._same:
            known.lead[turn] = -np.inf
            return
        # Where the part could be seen and would not be, it is not in this turn.
        is_hidden = other.evidence.visible < self._config.visible
        ahead, liked = (-self._config.step, 0.0) if is_hidden else ahead_by(other)
        ahead += known.like(turn, liked, most=self._config.liked_most)
        known.lead[turn] += min(ahead, self._config.step) - self._config.slack

    def _best(
        self, frame: Frame, tracker: Tracker, name: str, now: Trial, other: Trial, ahead: Ahead
    ) -> Transform | None:
        """Of all that a part may be turned to, once it is known not to be as it is now.

        The first turn that was ahead may only be less wrong. None where contours speak for none: what
        lies flat in the table agrees with its depth best of all.
        """

        def value(trial: Trial) -> float:
            return sum(ahead(trial))

        centre = self._bodies[name].balance
        starts = [turned(now.T_camera_part, R, centre=centre) for R in (*TURNS, *SPUN)]
        starts = [T for T in starts if self.allows(frame, name, now.T_camera_part, T)]
        rough = sorted(tracker.trials(frame, name, starts, rounds=ROUGH), key=value, reverse=True)
        found = [other]
        for trial in tracker.trials(frame, name, [t.T_camera_part for t in rough[:SETTLED]]):
            is_seen = trial.evidence.visible >= self._config.visible
            if is_seen and self._angle(name, now.T_camera_part, trial.T_camera_part) > self._same:
                found.append(trial)
        least = self._config.believed * now.confidence
        found = [trial for trial in found if trial.confidence >= least]
        return max(found, key=value).T_camera_part if found else None

    def _looks_worse_laid(
        self, frame: Frame, name: str, T_now: Transform, T_other: Transform
    ) -> bool:
        ahead = self.looks.laid_ahead(frame, name, T_now, T_other)
        return ahead is not None and ahead < 0

    def _ahead(
        self, frame: Frame, name: str, look: LookedAt | None, now: Trial, other: Trial
    ) -> tuple[float, float]:
        """By how much another pose of a part agrees better with what is seen, and how it is liked."""
        stands, _ = self._table.said(frame, name, now.T_camera_part, other.T_camera_part)
        looks = self.looks.ahead(frame, name, now.T_camera_part, other.T_camera_part)
        ahead = stands + (other.detail - now.detail if looks is None else looks)
        if look is None:
            return ahead, 0.0
        liked = look.likely(other.T_camera_part) - look.likely(now.T_camera_part)
        seen = min(now.evidence.visible, other.evidence.visible)
        return ahead, self._config.liked * seen * liked

    def _angle(self, name: str, T_a: Transform, T_b: Transform) -> float:
        """Between two poses of a part, radians; 0 where it looks the same."""
        return symmetric_angle(T_a, T_b, self._parts[name].symmetries)
