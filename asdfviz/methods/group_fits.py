"""The hypothesis test over states: draws every state's group where the base is, and compares.

See `asdfviz.state.group_fit` for what is compared. Here is decided where the base is (by its own
pose, by that of the frame before, or by the other parts that the state joins, whichever the picture
agrees with best; it may also be looked for around), and what is remembered from frame to frame:
where parts are in their joints, and their colours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.transforms import apply, apply_to_point, inverse, rotation_angle
from asdfviz.methods.group_trials import Trial
from asdfviz.methods.group_views import GroupView, learn_colors, measured_in, view_of
from asdfviz.methods.one_place import are_near
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.state.colors import Look, Looks, is_black
from asdfviz.state.group_fit import (
    STILL,
    GroupFitConfig,
    Measured,
    Move,
    probabilities,
    trusted,
)
from asdfviz.state.joint_places import JointPlaces
from asdfviz.state.near_places import NearPlaces
from asdfviz.state.twins import twins_by_name
from asdfviz.track.raster import draw, new_buffers

SAME = 0.004
"""Poses of the base whose middles are nearer to each other than this (metres) and SAME_ANGLE are one."""
SAME_ANGLE = 0.08
"""Radians."""
FAR = 0.08
"""Other parts that see the base farther than this from all other accounts of it are wrong, metres,"""
SURE = 0.8
"""unless the base has no pose, and the surest of them is as sure as this."""

LIKELY = 0.1
"""A part less likely than this to be where its pose has it tells nothing of its joint."""
TAKEN = 0.5
"""Score from which another part is where its pose has it, and the base is not."""
LONG = 8
"""Frames in a row for which a base has to be in one place to be asked for there later."""


class GroupFits:
    """Compares states with the picture; one for each sequence."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        *,
        config: GroupFitConfig,
        smear: SeenSmear | None = None,
    ) -> None:
        """Begin a sequence; `smear` is what others see of the depth camera's."""
        self._smear = smear if config.smeared else None
        self._assembly, self._shapes, self._config = assembly, shapes, config
        self._places = JointPlaces(assembly)
        self.near = NearPlaces(
            assembly, in_place=config.in_place, near=config.near, black=config.black
        )
        """Which parts are near their places and not in them."""
        self._looks = Looks(config=config.colors)
        self._last: Transform | None = None
        """T_camera_base of the last frame that said something,"""
        self._best_trial: Trial | None = None
        """and the scenes of all states there."""
        self._stood: Transform | None = None
        """Where it was for long at last: one frame may mistake another part for a base that hides."""
        self._frames = 0
        """For which it has been where it is."""
        self._base: PoseEstimate | None = None
        self._joined = list(
            {
                (name, T.tobytes(), id(state.joints.get(name))): (name, state)
                for state in assembly.states
                for name, T in state.T_base_part.items()
            }.values()
        )
        """Every part with the states that have it in different places."""
        self._black = [is_black(p.color, config.black) for p in assembly.parts.values()]
        self._twins = twins_by_name(assembly)
        """The names of its kind for every part."""

    @property
    def base(self) -> PoseEstimate | None:
        """Where the base is by all that was seen of the group in the last frame; its score is the
        share that agrees. None where nothing was said."""
        return self._base

    def shown_px(self, name: str, state: State) -> float:
        """In how many pixels a part shows where a state joins it, by the last frame that said
        something; inf before."""
        if self._best_trial is None:
            return math.inf
        return self._best_trial.shown_px(name, state)

    def place(self, name: str, state: State) -> Transform:
        """T_base_part where a state joins a part, by what was seen of its joint."""
        return self._places.last(name, state)

    def settle(self, T_camera_base: Transform) -> None:
        """Where the last frame's base turned out to be once its group was settled: from there on it is
        looked for, since what agreed best among a few accounts may be millimetres off for good."""
        if self._last is not None:
            self._last = T_camera_base

    def step(
        self,
        poses: Mapping[str, PoseEstimate],
        belief: Scores | None,
        frame: Frame,
        *,
        first: PoseEstimate | None = None,
    ) -> Scores | None:
        """The probability of every state by what the camera sees of its group; None: it says nothing.

        Args:
            poses: of the parts, each by itself.
            belief: in the states before this frame, None where there is none yet.
            frame: with depth, or nothing is said.
            first: the base's pose by this frame alone, if `poses` has another.
        """
        self._base = None
        config = self._config
        if frame.depth is None or not config.enabled:
            return None
        learn_colors(self._looks, poses, self._shapes, frame, frame.depth)
        likely = self._likely(belief)
        Ts_camera_base = self._bases(poses, likely, first)
        if not Ts_camera_base:
            return None
        view = view_of(self._pixels(Ts_camera_base, frame), frame, frame.depth, cells=config.cells)
        if view is None:
            return None
        measured = self._measured(view, Ts_camera_base)
        middle = apply_to_point(Ts_camera_base[0], self._assembly.parts[self._assembly.base].middle)
        weight = trusted(float(middle[2] / view.K[0, 0]), config=config)
        trials = [self._trial(T, poses, view, measured) for T in Ts_camera_base]
        best = self._best(trials, likely, weight)
        said = best.all_said(weight=weight)
        top = max(said, key=lambda one: one.value)
        rests = self._last is not None and self._apart(best.T_camera_base, self._last) == 0.0
        if not top.is_seen(
            visible=config.least_visible, agreeing=config.least_agreeing, rests=rests
        ):
            return None
        share = top.agreeing / top.visible
        self._base = PoseEstimate(self._assembly.base, best.T_camera_base, share, "group")
        state = self._assembly.states[said.index(top)]
        self._frames = self._frames + 1 if rests else 0
        if self._frames >= LONG:
            self._stood = best.T_camera_base
        self._best_trial, self._last, self._places = best, best.T_camera_base, best.settled(state)
        return probabilities([weight * one.value for one in said])

    def _likely(self, belief: Scores | None) -> list[State]:
        """The states by which poses of the base are compared, the likeliest first."""
        if belief is None:
            return [self._assembly.states[0]]
        return [self._assembly.states[i] for i in np.argsort(-belief)[:2]]

    def _bases(
        self, poses: Mapping[str, PoseEstimate], likely: Sequence[State], first: PoseEstimate | None
    ) -> list[Transform]:
        """Where the base may be: by its own pose, as before, or by the parts that the state joins."""
        base, parts, state = self._assembly.base, self._assembly.parts, likely[0]
        kept: list[Transform] = []
        accounts = [pose.T_camera_part for pose in (poses.get(base), first) if pose is not None]
        before = (T for T in (self._last, self._stood) if T is not None)
        accounts += [T for T in before if not self._is_taken(T, poses, likely)]
        for T in accounts:
            if not any(self._apart(T, other) == 0.0 for other in kept):
                kept.append(T)
        joined = (n for n in state.attached if n in poses and n != base)
        lost = base not in poses
        for name in sorted(joined, key=lambda n: -poses[n].score):
            if parts[name].symmetries.is_symmetric:
                continue
            T_base_part = self._places.last(name, state)
            T_camera_base = poses[name].T_camera_part @ inverse(T_base_part)
            apart = min((self._apart(T_camera_base, T) for T in kept), default=np.inf)
            # A base that hides behind a part that it carries is where that one says, if anywhere; but a
            # loose twin goes by the name of the joined one while that is hidden.
            is_sure = poses[name].score >= SURE and state.T_base_part.keys() >= set(
                self._twins[name]
            )
            if 0.0 < apart < FAR or (apart >= FAR and lost and is_sure):
                kept.append(T_camera_base)
            lost = lost and apart >= FAR and not is_sure
        return kept

    def _is_taken(
        self, T_camera_base: Transform, poses: Mapping[str, PoseEstimate], likely: Sequence[State]
    ) -> bool:
        """Whether a part that is not joined surely lies where the base would be."""
        parts, base = self._assembly.parts, self._assembly.parts[self._assembly.base]
        return any(
            pose.score >= TAKEN
            and not any(name in state.T_base_part for state in likely)
            and are_near(base, T_camera_base, parts[name], pose.T_camera_part)
            for name, pose in poses.items()
        )

    def _apart(self, T_a: Transform, T_b: Transform) -> float:
        """Distance of the base's middle between two of its poses, metres; 0 where they are one."""
        middle = self._assembly.parts[self._assembly.base].middle[None]
        distance = float(np.linalg.norm(apply(T_a, middle) - apply(T_b, middle)))
        is_same = distance < SAME and rotation_angle(T_a[:3, :3].T @ T_b[:3, :3]) < SAME_ANGLE
        return 0.0 if is_same else distance

    def _pixels(self, Ts_camera_base: Sequence[Transform], frame: Frame) -> np.ndarray:
        """The outlines of everything that any state joins."""
        outlines = [
            apply(self._places.last(name, state), self._shapes[name].corners)
            for name, state in self._joined
        ]
        corners = np.concatenate(outlines)
        return np.concatenate([project(apply(T, corners), frame.camera.K) for T in Ts_camera_base])

    def _measured(self, view: GroupView, Ts_camera_base: Sequence[Transform]) -> Measured:
        height, width = view.depth.shape
        covered, ids = new_buffers(width, height)
        for T in Ts_camera_base:
            for name, state in self._joined:
                draw(
                    self._assembly.parts[name].mesh,
                    T @ self._places.last(name, state),
                    K=view.K,
                    inverse_depth=covered,
                    ids=ids,
                )
        looks = [self._look(name) for name in self._assembly.parts]
        base = list(self._assembly.parts).index(self._assembly.base)
        return measured_in(view, covered, looks, black=self._black, base=base, config=self._config)

    def _look(self, name: str) -> Look | None:
        """What a part looks like; while nobody saw its colours, what a twin does."""
        known = (self._looks.of(one) for one in (name, *self._twins[name]))
        return next((look for look in known if look is not None), None)

    def _trial(
        self,
        T_camera_base: Transform,
        poses: Mapping[str, PoseEstimate],
        view: GroupView,
        measured: Measured,
    ) -> Trial:
        places = self._places.copy()
        places.see(T_camera_base, {n: p for n, p in poses.items() if p.score >= LIKELY})
        return Trial(
            self._assembly,
            T_camera_base,
            places,
            view,
            measured,
            self._config,
            Ts_base_loose=self.near.loose(T_camera_base, poses),
            smear=self._smear and self._smear.now,
        )

    def _best(self, trials: Sequence[Trial], likely: Sequence[State], weight: float) -> Trial:
        """Where the base is by the picture; elsewhere than by its pose only if that is much better.

        Where its pose agrees well enough with what is seen, nothing is looked for around.
        """
        config, first = self._config, trials[0]
        is_enough = any(
            first.said(state).is_seen(visible=config.moved_visible, agreeing=config.enough)
            for state in likely
        )
        found: list[tuple[float, Trial, Move, State]] = []
        for trial, state in product(trials, likely):
            cost = 0.0 if trial is first else config.other
            found.append((weight * trial.said(state).value - cost, trial, STILL, state))
            if is_enough:
                continue
            said, move = trial.found(state)
            if said.is_seen(visible=config.moved_visible, agreeing=config.moved_agreeing):
                found.append((weight * said.value - cost - config.moved, trial, move, state))
        _, best, move, state = max(found, key=lambda one: one[0])
        return best if move == STILL else best.moved(move, state)
