"""The script of an assembly sequence: what is where in every frame, and which state that is.

A hand fetches part after part; once, if the assembly knows errors, one is made and corrected. Parts
lie, are held or are joined to the base, and nothing else moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, rotation_angle
from asdfviz.synth.assets import Assets
from asdfviz.synth.contact import approach
from asdfviz.synth.joint_motion import joined_poses
from asdfviz.synth.layout import Outfit
from asdfviz.synth.motion import Pace, carry, reach, slide
from asdfviz.synth.stage import Stage

APPROACH = 0.04
"""How far out of its place a part begins to slide home, metres."""
DWELL = 2
"""Frames that a hand waits near by after a step."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame of the script."""

    T_world_part: Mapping[str, Transform]
    attached: tuple[str, ...]
    state: State
    """The state that the truth names."""
    T_world_hand: Transform | None
    held: str | None
    """The part between the fingers."""


@dataclass(slots=True)
class Director:
    """Plays the assembly through and writes down every frame."""

    assets: Assets
    stage: Stage
    outfit: Outfit
    pace: Pace
    stretch: float
    joints_seed: int
    """Draws the places within the joints' travel, the same for every state."""
    poses: dict[str, Transform] = field(default_factory=dict[str, Transform])
    joined: dict[str, Transform] = field(default_factory=dict[str, Transform])
    label: State = field(init=False)
    hand: Vector = field(init=False)
    moments: list[Moment] = field(default_factory=list[Moment])

    def __post_init__(self) -> None:
        self.label = self.assembly.states[0]
        self.poses = {self.assembly.base: self.stage.T_world_base, **self.stage.T_world_part}
        self.joined = {self.assembly.base: np.eye(4)}
        self.hand = self._rest_point()

    @property
    def assembly(self) -> Assembly:
        """The assembly that is played."""
        return self.assets.assembly

    def targets(self, state: State) -> Mapping[str, Transform]:
        """T_base_part of a state with the joints where this sequence leaves them."""
        return joined_poses(state, np.random.default_rng([self.joints_seed, 5]), spread=0.8)

    def idle(self, count: int) -> None:
        """Frames in which nothing moves and no hand is there."""
        for _ in range(max(1, round(count * self.stretch))):
            self._record(None, None)

    def go_to(self, state: State) -> None:
        """Change what is joined until it is `state`."""
        goals = self.targets(state)
        leaving = [n for n in self.joined if n not in goals]
        changed = [n for n in self.joined if n in goals and _differs(self.joined[n], goals[n])]
        new = [n for n in goals if n not in self.joined]
        for name in leaving:
            self._move(name, self.stage.T_world_part[name], home=np.array([0.0, 0.0, 0.02]))
        for name in [*changed, *new]:
            T_base_part = goals[name]
            home = self._way_in(name, T_base_part)
            T_world_base = self.poses[self.assembly.base]
            self._move(name, T_world_base @ T_base_part, home=T_world_base[:3, :3] @ home)
            self.joined[name] = T_base_part
        self.label = state
        self._retreat_a_little()
        self._wait(DWELL)

    def show(self, shift: Vector, turn: float) -> None:
        """Push what was assembled over the table."""
        base = self.assembly.base
        T_base_grasp = self._grasp(base, self.poses[base])
        self._reach_to(apply(self.poses[base], T_base_grasp[None])[0])
        if not self.stage.base_held:
            for T in slide(self.poses[base], shift, turn, pace=self.pace, stretch=self.stretch):
                self._put_base(T)
                self._record(self._hand_pose(apply(T, T_base_grasp[None])[0]), base)
        self.leave()

    def leave(self) -> None:
        """Draw the hand out of the view."""
        self._reach_to(self._rest_point())

    def _take_off(self, name: str) -> None:
        """The part is no longer counted as joined; an error ends with the last wrong part."""
        del self.joined[name]
        if self.label.is_error:
            right = self.assembly.states[self.label.completed]
            goals = self.targets(right)
            wrong = [n for n, T in self.joined.items() if n not in goals or _differs(T, goals[n])]
            self.label = self.label if wrong else right

    def _move(self, name: str, goal: Transform, *, home: Vector) -> None:
        start = self.poses[name]
        grasp = self._grasp(name, goal)
        self._reach_to(apply(start, grasp[None])[0])
        leave = self._way_out(name, start)
        if name in self.joined:
            self._take_off(name)
        path = carry(
            start,
            goal,
            leave=leave,
            arrive=home,
            clear=self._clear_height(name, start, goal),
            pace=self.pace,
            stretch=self.stretch,
        )
        for T in path:
            self.poses[name] = T
            self.hand = apply(T, grasp[None])[0]
            self._record(self._hand_pose(self.hand), name)

    def _put_base(self, T_world_base: Transform) -> None:
        self.poses[self.assembly.base] = T_world_base
        for name, T_base_part in self.joined.items():
            self.poses[name] = T_world_base @ T_base_part

    def _way_in(self, name: str, T_base_part: Transform) -> Vector:
        """From the place outwards, base frame, metres."""
        joint = next((s.joints[name] for s in self.assembly.states if name in s.joints), None)
        up = self.poses[self.assembly.base][:3, :3].T @ np.array([0.0, 0.0, 1.0])
        candidates = [up]
        if joint is not None:
            candidates = [joint.axis, -joint.axis, up]
        candidates += [s * axis for axis in np.eye(3) for s in (1.0, -1.0)]
        upward = [c for c in candidates if c @ up > -0.3]
        others = [(self.assembly.parts[n].mesh, T) for n, T in self.joined.items() if n != name]
        mesh = self.assembly.parts[name].mesh
        return APPROACH * approach(mesh, T_base_part, others, upward, distance=APPROACH)

    def _way_out(self, name: str, start: Transform) -> Vector:
        """Out of where the part is now: the way it came if it was joined, else straight up."""
        if np.allclose(start, self.stage.T_world_part[name], atol=1e-6):
            return np.array([0.0, 0.0, 0.02])
        T_world_base = self.poses[self.assembly.base]
        return T_world_base[:3, :3] @ self._way_in(name, inverse(T_world_base) @ start)

    def _clear_height(self, name: str, start: Transform, goal: Transform) -> float:
        vertices = self.assembly.parts[name].mesh.vertices
        below = max(-float((vertices @ T[:3, :3].T)[:, 2].min()) for T in (start, goal))
        tops = [
            float(apply(self.poses[n], self.assembly.parts[n].mesh.vertices)[:, 2].max())
            for n in self.joined
        ]
        return max(tops) + below + 0.008

    def _grasp(self, name: str, goal: Transform) -> Vector:
        """Where fingers take a part (its frame): the end that looks at the arm, rather high."""
        mesh = self.assembly.parts[name].mesh
        samples = surface_points(mesh.vertices, mesh.faces, 300, seed=1)
        world = apply(goal, samples)
        arm = self.stage.shoulder - world.mean(axis=0)
        wish = np.array([*(arm[:2] / np.linalg.norm(arm[:2])), 0.5])
        end = samples[int((world @ wish).argmax())]
        return 0.65 * end + 0.35 * mesh.vertices.mean(axis=0)

    def _hand_pose(self, point: Vector) -> Transform:
        arm = self.stage.shoulder - point
        away = np.array([*(arm[:2] / (np.linalg.norm(arm[:2]) + 1e-9)), 0.0])
        T = self.outfit.pose(
            point, away, pitch=0.35, roll=-0.45 if not self.outfit.mirrored else 0.45
        )
        low = float(apply(T, self.assets.hand_points[self.outfit.grasp])[:, 2].min())
        T[2, 3] += max(0.0, 0.001 - low)
        return T

    def _rest_point(self) -> Vector:
        middle = self.stage.T_world_base[:3, 3]
        out = self.stage.shoulder - middle
        return middle + out / np.linalg.norm(out) * 0.5 + [0.0, 0.0, 0.05]

    def _reach_to(self, point: Vector) -> None:
        for at in reach(self.hand, point, pace=self.pace, stretch=self.stretch):
            self._record(self._hand_pose(at), None)
        self.hand = point

    def _wait(self, count: int) -> None:
        for _ in range(max(1, round(count * self.stretch))):
            self._record(self._hand_pose(self.hand), None)

    def _retreat_a_little(self) -> None:
        out = self.stage.shoulder - self.hand
        self._reach_to(self.hand + out / np.linalg.norm(out) * 0.16)

    def _record(self, T_world_hand: Transform | None, held: str | None) -> None:
        self.moments.append(
            Moment(dict(self.poses), tuple(self.joined), self.label, T_world_hand, held)
        )


def _differs(T_a: Transform, T_b: Transform) -> bool:
    moved = float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
    return moved > 0.001 or rotation_angle(T_a[:3, :3].T @ T_b[:3, :3]) > 0.02


def chosen_error(assembly: Assembly, rng: np.random.Generator) -> State | None:
    """One of the error states, or None where the assembly has none."""
    errors = assembly.errors
    return errors[int(rng.integers(len(errors)))] if errors else None
