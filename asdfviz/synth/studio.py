"""Turns a play into scenes: one for each moment, and for times between them that a shutter sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from asdfviz.datatypes import Camera
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Finish, Light, Placed, Scene
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import dressed, scaled
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.layout import turn_z
from asdfviz.synth.looks import linear, plastic
from asdfviz.synth.motion import blend
from asdfviz.synth.play import Play
from asdfviz.synth.scene import Group, TrueScene
from asdfviz.synth.sequence_config import SequenceConfig

_REACH = 0.5
"""Radius around the view's middle within which shadows fall, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """A play with its camera, colours and lights."""

    play: Play
    assets: Assets
    seed: int
    config: SequenceConfig
    camera: Camera
    finishes: Mapping[str, Finish]
    target: Vector
    sway: tuple[Vector, Vector, Vector]
    """Phases, periods (s) and relative amplitudes of the camera's movement along its axes."""

    @classmethod
    def of(cls, play: Play, assets: Assets, *, seed: int, config: SequenceConfig) -> Studio:
        """Draw what is the same in all frames."""
        rng = np.random.default_rng([seed, 12])
        finishes = {
            n: plastic(np.clip(linear(p.color), 0.004, 0.85), rng)
            for n, p in assets.assembly.parts.items()
        }
        camera = camera_for(config.width, config.height)
        target = play.table.on_table(camera.width / 2, camera.height / 2)
        sway = (rng.random(3) * 2 * np.pi, rng.uniform(0.7, 1.3, 3), rng.uniform(0.5, 1.0, 3))
        return cls(play, assets, seed, config, camera, finishes, target, sway)

    def scene(self, time: float) -> TrueScene:
        """What there is to see at a time, in frames."""
        moment = _between(self.play.moments, time)
        names = list(moment.T_world_part)
        parts = self.assets.parts
        placed = [
            Placed(parts[n], moment.T_world_part[n], self.finishes[n], "part", n, truth=True)
            for n in names
        ]
        group = Group(moment.state, tuple(names.index(n) for n in moment.attached))
        placed += [*self.play.stage.clutter, *self.play.furniture]
        if moment.T_world_hand is not None:
            outfit = dressed(self.play.outfit, moment.grasp)
            placed += outfit.place(self.assets, scaled(moment.T_world_hand, outfit))
        for hand in self.play.others:
            T = hand.T_world_hand[min(round(time), len(hand.T_world_hand) - 1) if time > 0 else 0]
            placed += hand.outfit.place(self.assets, scaled(T, hand.outfit))
        scene = Scene(
            self.camera,
            self._swayed(time) @ self.play.table.T_camera_world,
            tuple(placed),
            self.play.scenery,
            tuple(self._travelled(light, time) for light in self.play.lights),
            self.play.sky,
            self.play.tint,
            self.target,
            _REACH,
        )
        return TrueScene(scene, (group,), 0)

    def carrying(self, moment: Moment) -> range:
        """Places in the scene of the hand that carries, its sleeve included."""
        if moment.T_world_hand is None:
            return range(0)
        first = len(moment.T_world_part) + len(self.play.stage.clutter) + len(self.play.furniture)
        return range(first, first + (1 if self.play.outfit.sleeve is None else 2))

    def _swayed(self, time: float) -> Transform:
        """T_camera_still: where a moving camera is."""
        if self.config.sway == 0:
            return np.eye(4)
        phases, periods, shares = self.sway
        wave = np.sin(2 * np.pi * time / self.config.fps / periods + phases) * shares
        shift = self.config.sway * wave * [1.0, 1.0, 0.6]
        # Hands that hold a camera turn it, too: a degree where they move it by 20 mm.
        turn = rotation_about(np.array([0.3, 0.2, 1.0]), 0.9 * self.config.sway * float(wave[2]))
        return transform_from(turn, shift)

    def _travelled(self, light: Light, time: float) -> Light:
        """A light on its way round the table, nearer and farther."""
        if self.config.light_speed == 0:
            return light
        angle = self.config.light_speed * time / self.config.fps
        R = turn_z(angle)
        strength = 1 + 0.35 * np.sin(1.7 * angle + light.radius * 40)
        return replace(light, position=R @ light.position, color=light.color * strength)


def _between(moments: tuple[Moment, ...], time: float) -> Moment:
    """The nearest moment with everything moved to a time between two."""
    low = int(np.clip(np.floor(time), 0, len(moments) - 1))
    high, share = min(low + 1, len(moments) - 1), float(np.clip(time - low, 0.0, 1.0))
    nearest = moments[low if share < 0.5 else high]
    a, b = moments[low], moments[high]
    if share == 0 or a is b:
        return nearest
    poses = {n: blend(T, b.T_world_part[n], share) for n, T in a.T_world_part.items()}
    hand = nearest.T_world_hand
    if a.T_world_hand is not None and b.T_world_hand is not None and a.grasp == b.grasp:
        hand = blend(a.T_world_hand, b.T_world_hand, share)
    return replace(nearest, T_world_part=poses, T_world_hand=hand)
