"""The script of an assembly sequence: what is where in every frame, and which state that is.

A hand fetches part after part; an error may be made and corrected. Parts lie, are held (rigid to
the hand) or are joined to the base, and nothing else moves. Without hands parts move by themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, transform_from
from asdfviz.synth.assets import Assets
from asdfviz.synth.film import Act
from asdfviz.synth.grasping import Grip, Hold, backed, find_grip
from asdfviz.synth.layout import Outfit, turn_z
from asdfviz.synth.motion import Limits, Pace, blend, frames_needed, moved
from asdfviz.synth.penetration import Solid
from asdfviz.synth.routes import Obstacle, over, over_with_hand, rests_between, wrong_place
from asdfviz.synth.stage import Stage
from asdfviz.synth.ways import Body, Way, changes, differs, with_steps

DWELL = 2
"""Frames that a hand waits near by after a step, at 10 a second."""
UNLISTED = "unlisted"
"""Name of the state in which a part sits where no state of the assembly has it."""
AWKWARD = 0.001
"""A grip that is worse than this is looked for with a stopover, metres."""
ASIDE = 0.12
"""How far a hand draws back towards the shoulder after a step, metres."""
OUT_OF_VIEW = 0.5
"""How far a hand that leaves goes, metres."""


@dataclass(slots=True)
class Director:
    """Plays the assembly through and writes down every act."""

    assets: Assets
    solids: Mapping[str, Solid]
    stage: Stage
    targets: Mapping[int, Mapping[str, Transform]]
    ways: Mapping[tuple[int, str], Way]
    outfit: Outfit | None
    """The person's hand; None where parts move by themselves."""
    pace: Pace
    fps: float
    rng: np.random.Generator
    poses: dict[str, Transform] = field(init=False)
    joined: dict[str, Transform] = field(init=False)
    joined_in: dict[str, int] = field(default_factory=dict[str, int])
    """Index of the state for which each joined part was put where it is."""
    label: State = field(init=False)
    T_world_hand: Transform | None = None
    grasp: int = 0
    acts: list[Act] = field(default_factory=list[Act])

    def __post_init__(self) -> None:
        self.label = self.assembly.states[0]
        self.poses = {self.assembly.base: self.stage.stand.T_world_base, **self.stage.T_world_part}
        self.joined = {self.assembly.base: np.eye(4)}

    @property
    def assembly(self) -> Assembly:
        """What is played."""
        return self.assets.assembly

    def idle(self, count: int) -> None:
        """Nothing moves for some frames (at 10 a second); the hand stays where it is."""
        frames = max(1, round(count * max(self.fps, 5.0) / 10))
        stops = () if self.T_world_hand is None else (self.T_world_hand,)
        self._add(stops, self.pace.hands(self.fps), frames=frames, least=1)

    def go_to(self, state: State, *, slip: bool = False) -> None:
        """Change what is joined until it is `state`.

        Args:
            state: where to.
            slip: the last part is first held to a wrong place, if there is a free one.
        """
        goals = self.targets[state.index]
        for name in reversed([n for n in self.joined if n not in goals]):
            self._move(name, self.stage.T_world_part[name], way_in=())
        names = changes(self.joined, goals)
        for name in names:
            T = self.stage.stand.T_world_base
            way = [T[:3, :3] @ stop for stop in self.ways[state.index, name].stops]
            wrong = self._wrong_place(name, state) if slip and name == names[-1] else None
            self._move(name, T @ goals[name], way_in=way, wrong=wrong)
            self.joined[name] = goals[name]
            self.joined_in[name] = state.index
        self.label = state
        self._draw_back()
        self.idle(DWELL)

    def show(self, shift: Vector, turn: float) -> None:
        """Push what was assembled over the table, and leave."""
        base = self.assembly.base
        start = self.poses[base]
        center = apply(start, self.solids[base].middle[None])[0]
        R = turn_z(turn)
        goal = transform_from(R @ start[:3, :3], R @ (start[:3, 3] - center) + center + shift)
        riders = {n: T for n, T in self.joined.items() if n != base}
        grip = self._grip(base, [start, goal], skip=set(self.joined))
        if grip is None or grip.badness > AWKWARD:
            return self.leave()  # A flat base that fingers cannot get round stays where it is.
        self._reach_for(base, grip)
        # What rides far from the middle goes farther than the middle does.
        slow = self.pace.parts(self.fps).halved()
        self._carry(base, [start, goal], grip, limits=slow, riders=riders)
        for name, T_base_part in self.joined.items():
            self.poses[name] = goal @ T_base_part
        self.leave()

    def leave(self) -> None:
        """Draw the hand out of the view."""
        if self.T_world_hand is not None and self.outfit is not None:
            off = backed(self.T_world_hand, self.outfit, self.grasp)
            self._hand_along([self.T_world_hand, off, self._away(off)])
            self.T_world_hand = None

    def _move(
        self, name: str, goal: Transform, *, way_in: Sequence[Vector],
        wrong: Transform | None = None,
    ) -> None:  # fmt: skip
        """Bring a part somewhere; where no grip does for all of the way it is put down on it."""
        ends = [goal, *(moved(goal, place) for place in with_steps(way_in))]
        ends += [] if wrong is None else [blend(wrong, ends[-1], k) for k in (0.0, 0.3, 0.6)]
        starts = [self.poses[name], *(moved(self.poses[name], v) for v in self._way_off(name))]
        grip = self._grip(name, [*starts, *ends], skip={name})
        if grip is not None and grip.badness > AWKWARD:
            if wrong is not None:
                return self._move(name, goal, way_in=way_in)
            via = self._stopover(name, ends, grip)
            if via is not None:
                rest, first, grip = via
                self._bring(name, rest, first, way_in=())
                self._draw_back()
        self._bring(name, goal, grip, way_in=way_in, wrong=wrong)

    def _bring(
        self, name: str, goal: Transform, grip: Grip | None, *, way_in: Sequence[Vector],
        wrong: Transform | None = None,
    ) -> None:  # fmt: skip
        outs = [self.poses[name], *(moved(self.poses[name], v) for v in self._way_off(name)[1::2])]
        *corners, home = [goal, *(moved(goal, stop) for stop in way_in)]
        if grip is not None:
            self._reach_for(name, grip)
        if name in self.joined:
            self._take_off(name)
        high = over(outs[-1], home, grip, self.outfit, self.solids[name], self._obstacles(name))
        stops = [*outs, *high, home]
        if wrong is None:
            self._carry(name, [*stops, *reversed(corners)], grip)
        else:
            self._carry(name, [*stops, wrong], grip)
            self._hold_wrongly(name, wrong, grip)
            self._carry(name, [wrong, home, *reversed(corners)], grip)
        self.poses[name] = goal

    def _way_off(self, name: str) -> list[Vector]:
        """Middles and ends of the stretches on which a joined part leaves; none if it is loose."""
        if name not in self.joined:
            return []
        R = self.stage.stand.T_world_base[:3, :3]
        return [R @ v for v in with_steps(self.ways[self.joined_in[name], name].stops)]

    def _stopover(
        self, name: str, ends: Sequence[Transform], grip: Grip
    ) -> tuple[Transform, Grip, Grip] | None:
        """A rest between on the part's own spot, with better grips on the ways there and on."""
        best: tuple[Transform, Grip, Grip] | None = None
        least = grip.badness
        spot, faces = self.stage.T_world_part[name], self.assets.resting[name]
        for rest in rests_between(name, ends[0], spot, faces, self.poses, self.solids):
            first = self._grip(name, [self.poses[name], rest], skip={name}, limit=least)
            if first is None:
                continue
            second = self._grip(name, [rest, *ends], skip={name}, limit=least)
            if second is not None:
                least = max(first.badness, second.badness)
                best = (rest, first, second)
        return best

    def _hold_wrongly(self, name: str, wrong: Transform, grip: Grip | None) -> None:
        """A moment in which nothing moves and the truth says that this is no state."""
        right = self.label
        poses = {**self.joined, name: inverse(self.stage.stand.T_world_base) @ wrong}
        self.label = State(
            len(self.assembly.states), UNLISTED, poses, is_error=True, after=right.completed
        )
        self.joined[name] = poses[name]
        self._carry(name, [wrong], grip, frames=max(2, round(0.5 * self.fps)))
        del self.joined[name]
        self.label = right

    def _take_off(self, name: str) -> None:
        """The part is no longer counted as joined; an error ends with the last wrong part."""
        del self.joined[name]
        if self.label.is_error:
            right = self.assembly.states[self.label.completed]
            goals = self.targets[right.index]
            wrong = [n for n, T in self.joined.items() if n not in goals or differs(T, goals[n])]
            self.label = self.label if wrong else right

    def _wrong_place(self, name: str, state: State) -> Transform | None:
        T = self.stage.stand.T_world_base
        others = [Body(self.solids[n], T_n) for n, T_n in self.joined.items() if n != name]
        body = Body(self.solids[name], self.targets[state.index][name])
        found = wrong_place(body, others, self.ways[state.index, name].out, T, self.rng)
        return None if found is None else T @ found

    def _grip(
        self, name: str, places: Sequence[Transform], *, skip: set[str], limit: float = np.inf
    ) -> Grip | None:
        """A grip that does at the start and at the goal of a move, less bad than the limit."""
        if self.outfit is None:
            return None
        bodies = [Body(self.solids[n], T) for n, T in self.poses.items() if n not in skip]
        riders = self.joined if name == self.assembly.base else {}
        riding = [(n, T) for n, T in riders.items() if n != name]
        holds = [
            Hold(T, (*bodies, *(Body(self.solids[n], T @ T_n) for n, T_n in riding)))
            for T in places
        ]
        shoulder = self.stage.stand.shoulder
        return find_grip(self.solids[name], holds, shoulder, self.outfit, self.rng, limit=limit)

    def _reach_for(self, name: str, grip: Grip) -> None:
        """Bring the empty hand to a part."""
        if self.outfit is None:
            return
        at = self.poses[name] @ grip.T_part_hand
        before = backed(at, self.outfit, grip.grasp)
        come_from = self._away(before) if self.T_world_hand is None else self.T_world_hand
        high = over_with_hand(come_from, before, self.outfit, grip.grasp, self._obstacles(None))
        self.grasp = grip.grasp
        self._hand_along([come_from, *high, before, at])

    def _draw_back(self) -> None:
        if self.T_world_hand is None or self.outfit is None:
            return
        off = backed(self.T_world_hand, self.outfit, self.grasp)
        out = self.stage.stand.shoulder - off[:3, 3]
        away = out / np.linalg.norm(out) * ASIDE + [0.0, 0.0, 0.03]
        self._hand_along([self.T_world_hand, off, moved(off, away)])

    def _away(self, T_world_hand: Transform) -> Transform:
        out = self.stage.stand.shoulder - T_world_hand[:3, 3]
        return moved(T_world_hand, out / np.linalg.norm(out) * OUT_OF_VIEW)

    def _obstacles(self, name: str | None) -> list[Obstacle]:
        """What lies around, except one part."""
        found = [Obstacle.of(T, self.solids[n].samples) for n, T in self.poses.items() if n != name]
        points = self.assets.points_of
        return found + [Obstacle.of(c.T_world_mesh, points(c)) for c in self.stage.clutter]

    def _carry(
        self, name: str, stops: Sequence[Transform], grip: Grip | None, *,
        limits: Limits | None = None, riders: Mapping[str, Transform] | None = None,
        frames: int | None = None,
    ) -> None:  # fmt: skip
        pace = limits or self.pace.parts(self.fps)
        pivot = self.solids[name].middle
        middle = transform_from(np.eye(3), pivot)
        count = frames or frames_needed([T @ middle for T in stops], pace)
        self.acts.append(
            Act(
                tuple(stops), dict(self.poses), tuple(self.joined), self.label, pace, count, count,
                held=name, riders=dict(riders or {}), pivot=pivot,
                T_part_hand=None if grip is None else grip.T_part_hand,
                grasp=0 if grip is None else grip.grasp,
            )
        )  # fmt: skip
        if grip is not None:
            self.T_world_hand = stops[-1] @ grip.T_part_hand

    def _hand_along(self, stops: Sequence[Transform]) -> None:
        limits = self.pace.hands(self.fps)
        frames = frames_needed(stops, limits)
        self._add(tuple(stops), limits, frames=frames, least=max(1, frames // 3))
        self.T_world_hand = stops[-1]

    def _add(
        self, stops: tuple[Transform, ...], limits: Limits, *, frames: int, least: int
    ) -> None:
        self.acts.append(
            Act(
                stops, dict(self.poses), tuple(self.joined), self.label, limits, frames, least,
                grasp=self.grasp,
            )
        )  # fmt: skip
