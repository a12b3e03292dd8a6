"""A place of the base that is tried: every state's group drawn there, and what the picture says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.camera import back_project
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import orthonormalized, rotation_about, transform_from
from asdfviz.methods.drawn_smear import Smear
from asdfviz.methods.group_views import GroupView
from asdfviz.state.group_fit import (
    Drawn,
    GroupFitConfig,
    Measured,
    Move,
    Said,
    best_spoken,
    nearer_by,
    spoken,
)
from asdfviz.state.group_kernels import cover
from asdfviz.state.joint_places import JointPlaces
from asdfviz.track.raster import draw, new_buffers

NEAR = ((1.0, 0.0),)
"""Steps by which every state's scene is shifted: cells, and radians about the view's middle."""
BEHIND = 15.0
"""A state whose scene, where it is drawn, is behind by more than this does not win by a shift, natural
logarithm."""
FAR = ((4.0, 0.12), (2.0, 0.06), (1.0, 0.03))
"""Steps by which the likeliest scene is looked for."""


class Trial:
    """The scenes of all states with the base in one place; every part is drawn once."""

    def __init__(
        self,
        assembly: Assembly,
        T_camera_base: Transform,
        places: JointPlaces,
        view: GroupView,
        measured: Measured,
        config: GroupFitConfig,
        *,
        Ts_base_loose: Mapping[str, Transform] | None = None,
        smear: Smear | None = None,
    ) -> None:
        """Draw nothing yet.

        Args:
            assembly: whose states.
            T_camera_base: where the base is.
            places: where parts are in their joints.
            view: the window of the picture.
            measured: its readings.
            config: how scenes are compared.
            Ts_base_loose: where parts are near by that are not in their places; they belong to the
                scene of every state that does not join them.
            smear: the depth camera's; None: scenes have sharp edges.
        """
        self.T_camera_base, self.places = T_camera_base, places
        self._loose, self._smear = Ts_base_loose or {}, smear
        self._assembly, self._view, self._measured, self._config = assembly, view, measured, config
        self._numbers = {name: i for i, name in enumerate(assembly.parts)}
        self._placements: dict[tuple[object, ...], Drawn] = {}
        self._settled: dict[tuple[object, ...], Sequence[Transform]] = {}
        """Where they were drawn, T_base_part of each."""
        self._scenes: dict[int, Drawn] = {}
        self._nearers: dict[int, float] = {}
        self._said: dict[int, Said] = {}
        self._base_nearer = self._nearer(self._drawn([assembly.base], [np.eye(4)]))

    def said(self, state: State) -> Said:
        """What the picture says for a state whose scene may lie a little aside."""
        if state.index not in self._said:
            self._said[state.index] = self._best(state, NEAR, self._config.shift)[0]
        return self._said[state.index]

    def all_said(self, *, weight: float) -> list[Said]:
        """What it says for every state; only those that may yet win are shifted.

        Args:
            weight: of `Said.value`, as `trusted` gives it.
        """
        states = self._assembly.states
        still = [self._spoken(self._scene(state), self.nearer(state)) for state in states]
        most = max(said.value for said in still)
        return [
            self.said(state) if weight * (most - said.value) < BEHIND else said
            for state, said in zip(states, still, strict=True)
        ]

    def found(self, state: State) -> tuple[Said, Move]:
        """What it says for a state whose scene is looked for around, and where it was found."""
        return self._best(state, FAR, self._config.reach)

    def nearer(self, state: State) -> float:
        """How much nearer than drawn the state's scene is measured, metres."""
        if state.index not in self._nearers:
            self._nearers[state.index] = self._nearer(self._scene(state))
        return self._nearers[state.index]

    def settled(self, state: State) -> JointPlaces:
        """Where parts are in their joints if this state holds: where the picture agrees best."""
        self._scene(state)
        for names in self.places.together(state):
            self.places.settle(names, state, self._settled[_key(names, state)])
        return self.places

    def shown_px(self, name: str, state: State) -> float:
        """In how many pixels a part shows if this state holds."""
        cells = np.count_nonzero(self._scene(state).ids == self._numbers[name])
        return float(cells * self._view.cell_px**2)

    def moved(self, move: Move, state: State) -> Trial:
        """The same group after a move in the view, and as near as the state's scene is measured."""
        height, width = self._view.depth.shape
        K, z = self._view.K, float(self.T_camera_base[2, 3])
        nearer = self.nearer(state)
        pixel = np.array([[0.5 * (width - 1), 0.5 * (height - 1)]])
        middle = back_project(pixel, np.array([z]), K)[0]
        R = rotation_about(np.array([0.0, 0.0, 1.0]), move.turn)
        shift = np.array([move.right * z / K[0, 0], move.down * z / K[1, 1], 0.0])
        T_moved = transform_from(R, middle - R @ middle + shift - nearer * middle / z)
        return Trial(
            self._assembly,
            orthonormalized(T_moved @ self.T_camera_base),
            self.places,
            self._view,
            self._measured,
            self._config,
            Ts_base_loose=self._loose,
            smear=self._smear,
        )

    def _best(
        self, state: State, steps: Sequence[tuple[float, float]], rounds: int
    ) -> tuple[Said, Move]:
        return best_spoken(
            self._scene(state),
            self._measured,
            nearer=self.nearer(state),
            config=self._config,
            steps=steps,
            rounds=rounds,
        )

    def _scene(self, state: State) -> Drawn:
        """The state's parts together, nearest surfaces first."""
        if state.index not in self._scenes:
            height, width = self._view.depth.shape
            inverse_depth, ids = new_buffers(width, height)
            for names in self.places.together(state):
                one = self._placed(names, state)
                cover(inverse_depth, ids, one.inverse_depth, one.ids)
            for name in (n for n in self._loose if n not in state.T_base_part):
                one = self._apart(name)
                cover(inverse_depth, ids, one.inverse_depth, one.ids)
            self._scenes[state.index] = self._as_seen(Drawn(inverse_depth, ids))
        return self._scenes[state.index]

    def _as_seen(self, scene: Drawn) -> Drawn:
        """With its edges as the camera smears them, where it is known what lies around."""
        ground = self._measured.ground
        if self._smear is None or not (ground > 0).all():
            return scene
        depth = 1.0 / np.where(scene.ids >= 0, scene.inverse_depth, ground)
        smeared = 1.0 / self._smear.applied(
            depth.astype(np.float64), focal=float(self._view.K[0, 0])
        )
        return Drawn(np.where(scene.ids >= 0, smeared, 0), scene.ids, smeared)

    def _spoken(self, scene: Drawn, nearer: float) -> Said:
        return spoken(scene, self._measured, nearer=nearer, config=self._config)

    def _nearer(self, scene: Drawn) -> float:
        """By the scene's own surface: a plate on the base is not the base come nearer."""
        return nearer_by(scene.inverse_depth, self._view.depth, config=self._config)

    def _placed(self, names: Sequence[str], state: State) -> Drawn:
        """Parts that move as one where they may be, and there where the picture agrees best."""
        key = _key(names, state)
        if key not in self._placements:
            possible = self.places.possible(names, state)
            drawn = [self._drawn(names, Ts) for Ts in possible]
            best = 0
            if len(drawn) > 1:
                values = [self._spoken(one, self._base_nearer).value for one in drawn]
                best = int(np.argmax(values))
            self._placements[key], self._settled[key] = drawn[best], possible[best]
        return self._placements[key]

    def _apart(self, name: str) -> Drawn:
        """A part near by that is not in its place."""
        if (name,) not in self._placements:
            self._placements[name,] = self._drawn([name], [self._loose[name]])
        return self._placements[name,]

    def _drawn(self, names: Sequence[str], Ts_base_part: Sequence[Transform]) -> Drawn:
        height, width = self._view.depth.shape
        inverse_depth, ids = new_buffers(width, height)
        for name, T_base_part in zip(names, Ts_base_part, strict=True):
            draw(
                self._assembly.parts[name].mesh,
                self.T_camera_base @ T_base_part,
                K=self._view.K,
                inverse_depth=inverse_depth,
                ids=ids,
                number=self._numbers[name],
            )
        return Drawn(inverse_depth, ids)


def _key(names: Sequence[str], state: State) -> tuple[object, ...]:
    """Equal where parts that move as one are in the same places."""
    nominal = (state.T_base_part[name].tobytes() for name in names)
    return (*names, *nominal, id(state.joints.get(names[0])))
