"""Whether a part is not rather turned otherwise: other turns of it, settled and compared over time.

Not in the paper. A part taken end for end looks almost the same, and a network that never learnt the
difference prefers the wrong end in every frame. Settled by contours and depth, the right one lies a
millimetre nearer to what was measured, which a few frames tell; the wrong one often stands in the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Frame, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.shapes import Rotation, Transform
from asdfviz.geometry.symmetry import nearest_symmetric, symmetric_angle
from asdfviz.geometry.transforms import rotation_about, rotation_angle
from asdfviz.methods.refinding import QUARTER_TURNS, turned
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_table import table_near
from asdfviz.pose.standing import RestConfig, Stance, sides
from asdfviz.pose.table import SunkConfig, Table
from asdfviz.track.bodies import Body
from asdfviz.track.tracker import Tracker


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
_STACKED = np.stack(TURNS)


@dataclass(frozen=True)
class TurnTableConfig:
    """What the table says of turns; the paper has no such step."""

    enabled: bool = True
    """On or off."""
    sunk: SunkConfig = field(default_factory=SunkConfig)
    """Against those that have the part stand in it."""
    rest: RestConfig = field(default_factory=RestConfig)
    """For those that have it lie on a side."""
    worse: float = 0.05
    """A pose against which it speaks by this more than against the part's own is ruled out at once,"""
    place: float = 0.3
    """if their centres are nearer than this share of the part's diameter: what was moved may be lower."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.worse, self.place) < 0:
            raise MethodError(
                f"turns.table.worse is {self.worse:g} and place {self.place:g}: use 0 or more"
            )


@dataclass(frozen=True)
class TurnConfig:
    """When a part is believed to be turned otherwise."""

    enabled: bool = True
    """On or off."""
    a_frame: int = 4
    """Parts that are checked in a frame, one turn of each."""
    visible: float = 0.5
    """Share of the part that must be seen, 0 to 1."""
    lead: float = 0.35
    """A turn is right, or ruled out, that is ahead or behind by this (`Trial.detail`) in all;"""
    step: float = 0.12
    """no frame counts for more than this for it: a single one may deceive."""
    remembered: int = 6
    """Turns that a part was in and that were wrong."""
    again: int = 12
    """Frames after which a turn that was ruled out is tried again."""
    same_deg: float = 20.0
    """Poses turned less than this against each other are one,"""
    same_place: float = 0.1
    """if their centres are nearer than this share of the part's diameter."""
    table: TurnTableConfig = field(default_factory=TurnTableConfig)
    """What the table says, besides."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.a_frame < 1 or not 0 < self.step <= self.lead:
            raise MethodError(
                f"turns.a_frame is {self.a_frame}, step {self.step:g} and lead {self.lead:g}: "
                "a_frame must be 1 or more, step above 0 and no more than lead"
            )


@dataclass(slots=True, eq=False)
class _Turns:
    """What is known of one part's turns."""

    T_camera_part: Transform
    """The pose in the frame before."""
    lead: Float64[np.ndarray, "turns"] = field(default_factory=lambda: np.zeros(len(TURNS)))
    """Of each over the pose that is believed."""
    last: int = -1
    """That was tried."""
    rested: int = 0
    """Frames since the last try."""
    wrong: list[Rotation] = field(default_factory=list[Rotation])
    """Turns of it that it was in and that were wrong."""


class TurnChecks:
    """Checks the turns of the parts of one sequence."""

    def __init__(
        self, parts: Mapping[str, Part], bodies: Mapping[str, Body], *, config: TurnConfig
    ) -> None:
        """Begin a sequence."""
        self._parts, self._bodies, self._config = parts, bodies, config
        table = config.table
        self._stances: dict[str, Stance] = {}
        if table.enabled:
            self._stances = {
                n: Stance(hull_corners(p.mesh.vertices), sides(p.mesh), table.sunk, table.rest)
                for n, p in parts.items()
            }
        self._looked: tuple[Frame, str, Transform, Table | None] | None = None
        self._turns: dict[str, _Turns] = {}
        self._same = float(np.deg2rad(config.same_deg))
        self._first = 0

    def allows(self, frame: Frame, name: str, T_now: Transform, T_other: Transform) -> bool:
        """Whether another pose of a part is none that was ruled out, by the table or as a turn.

        Poses elsewhere, and those that are much the same, are never ruled out.
        """
        if not self._config.enabled:
            return True
        part, centre = self._parts[name], np.append(self._bodies[name].model.centre, 1.0)
        apart = float(np.linalg.norm((T_now - T_other)[:3] @ centre)) / part.diameter
        if self._angle(name, T_now, T_other) < self._same:
            return True
        table = self._config.table
        if apart <= table.place:
            _, against = self._said(frame, name, T_now, T_other)
            if against > table.worse:
                return False
        known = self._turns.get(name)
        if known is None or apart > self._config.same_place:
            return True
        # Turns that are no others, as the part is symmetric, have no lead.
        out = np.isfinite(known.lead) & (known.lead <= -self._config.lead)
        wrong = np.concatenate([_STACKED[out], np.reshape(known.wrong, (-1, 3, 3))])
        if not len(wrong):
            return True
        T_near = nearest_symmetric(T_other, T_now, part.symmetries)
        Ss = (np.eye(4), *part.symmetries.discrete)
        Rs_now_other = np.stack([T_now[:3, :3].T @ (T_near @ S)[:3, :3] for S in Ss])
        traces = np.einsum("sij,tij->st", Rs_now_other, wrong)
        return bool(traces.max() < 1 + 2 * np.cos(self._same))

    def step(
        self, frame: Frame, tracker: Tracker, poses: Mapping[str, Transform]
    ) -> dict[str, Transform]:
        """Parts that are turned otherwise, with their poses T_camera_part.

        Args:
            frame: with depth.
            tracker: knows the parts' colours; nothing is moved.
            poses: settled in this frame or one before.
        """
        if not self._config.enabled or not poses:
            return {}
        self._forget(poses)
        names = list(poses)
        start = self._first % len(names)
        self._first += self._config.a_frame
        found: dict[str, Transform] = {}
        for name in (names[start:] + names[:start])[: self._config.a_frame]:
            right = self._checked(frame, tracker, name, poses[name])
            if right is not None:
                T_wrong, found[name] = right
                self._turns[name] = self._begun(name, T_wrong, found[name])
        return found

    def _forget(self, poses: Mapping[str, Transform]) -> None:
        """What was known of a part's turns holds no longer once somebody else turned it."""
        for name, T in poses.items():
            known = self._turns.get(name)
            if known is None or self._angle(name, known.T_camera_part, T) > self._same:
                self._turns[name] = _Turns(T)
            else:
                known.T_camera_part = T

    def _begun(self, name: str, T_wrong: Transform, T_right: Transform) -> _Turns:
        """What is known of a part that was turned: it is not as it was, before that neither."""
        R_right_wrong = T_right[:3, :3].T @ T_wrong[:3, :3]
        wrong = [R_right_wrong, *(R_right_wrong @ R for R in self._turns[name].wrong)]
        # Where it is right now may have been taken for wrong once.
        far = [R for R in wrong if rotation_angle(R) > self._same]
        return _Turns(T_right, wrong=far[: self._config.remembered])

    def _checked(
        self, frame: Frame, tracker: Tracker, name: str, T_now: Transform
    ) -> tuple[Transform, Transform] | None:
        """The part's pose and that in another turn, if that is the right one."""
        known = self._turns[name]
        turn = self._next(known)
        if turn is None:
            return None
        T_turned = turned(T_now, TURNS[turn], centre=self._bodies[name].model.centre)
        now, other = tracker.trials(frame, name, [T_now, T_turned])
        if now.evidence.visible < self._config.visible:
            return None
        known.last, known.rested = turn, 0
        if self._angle(name, now.T_camera_part, other.T_camera_part) < self._same:
            known.lead[turn] = -np.inf
            return None
        # Where the part could be seen and would not be, it is not in this turn.
        is_hidden = other.evidence.visible < self._config.visible
        ahead = -self._config.step
        if not is_hidden:
            stands, _ = self._said(frame, name, now.T_camera_part, other.T_camera_part)
            ahead = other.detail - now.detail + stands
        known.lead[turn] += min(ahead, self._config.step)
        if known.lead[turn] < self._config.lead:
            return None
        return now.T_camera_part, other.T_camera_part

    def _said(
        self, frame: Frame, name: str, T_now: Transform, T_other: Transform
    ) -> tuple[float, float]:
        """By how much the table speaks for another pose of a part rather, and by how much against it."""
        table = self._table(frame, name, T_now)
        if table is None or frame.depth is None:
            return 0.0, 0.0
        stance, both, K = self._stances[name], np.stack([T_now, T_other]), frame.camera.K
        now_against, against = stance.against(both, table, depth=frame.depth, K=K)
        now, other = stance.in_favour(both, table)
        worse = float(against - now_against)
        return float(other - now) - worse, worse

    def _table(self, frame: Frame, name: str, T_now: Transform) -> Table | None:
        """Around a part, found once for all its other poses; None where it is not known or asked."""
        stance, known = self._stances.get(name), self._looked
        if stance is None:
            return None
        if known is None or known[:2] != (frame, name) or not np.array_equal(known[2], T_now):
            table = table_near(frame, projected_box(T_now, stance.corners, frame))
            known = self._looked = (frame, name, T_now, table)
        return known[3]

    def _next(self, known: _Turns) -> int | None:
        """The turn to try: one that is ahead, or the next one that is open; now and then any."""
        if known.lead.max() > 0:
            return int(known.lead.argmax())
        order = (known.last + 1 + np.arange(len(TURNS))) % len(TURNS)
        for turn in map(int, order):
            if known.lead[turn] > -self._config.lead:
                return turn
        known.rested += 1
        if known.rested < self._config.again:
            return None
        turn = int(order[0])
        if np.isfinite(known.lead[turn]):
            known.lead[turn] = -self._config.lead
        return turn

    def _angle(self, name: str, T_a: Transform, T_b: Transform) -> float:
        """Between two poses of a part, radians; 0 where it looks the same."""
        return symmetric_angle(T_a, T_b, self._parts[name].symmetries)
