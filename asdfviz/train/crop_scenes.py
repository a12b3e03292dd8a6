"""Draws what a training crop shows: a part on its own or joined, a group, clutter, hands, a plane.

Frame: the crop's own camera (x right, y down, z forward), which looks at the middle of the part's
box. Every pose is exact; nothing is rendered here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Int64

from asdfviz.datatypes import Assembly, Mesh
from asdfviz.detector.crop_classes import (
    CORNERS,
    CropClass,
    crop_classes,
    group_states,
    state_spans,
)
from asdfviz.detector.crop_cut import CONTEXT, CROP_PIXELS
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, rotation_about, transform_from
from asdfviz.state.half_done import HalfDone
from asdfviz.synth.hands import GRASPS, hand_mesh
from asdfviz.synth.joint_motion import joined_poses, random_rotation
from asdfviz.synth.looks import part_colors, random_hue, skin
from asdfviz.synth.mesh_bank import MeshBank, thinned
from asdfviz.synth.primitives import distractor_meshes
from asdfviz.train.crop_placing import centred, direction, unit

STORED_PIXELS = 128
"""Side of a stored crop; it is cut to the network's input with any roll while training."""
PART_FACES, HAND_FACES = 700, 1200
"""Meshes are thinned to this for speed: a crop shows no more."""
NEARLY = (0.012, 0.07)
"""From its place to where a part is that has nearly come there, metres."""
FOCALS = (303.6, 607.2)
"""Of the frames that crops come from, pixels: 640 and 1280 wide."""


@dataclass(frozen=True, slots=True)
class CropConfig:
    """How crops are drawn; probabilities unless said otherwise."""

    pixels: int = STORED_PIXELS
    """Side of a stored crop."""
    distance: tuple[float, float] = (0.35, 1.1)
    """From the camera to the part, metres."""
    groups: float = 0.5
    """A group is shown for its state; otherwise a part."""
    half_done: float = 0.3
    """Of a step that adds several parts some are in, which counts to the step before."""
    joined: float = 0.5
    """A part that can be joined is shown so."""
    waiting: float = 0.3
    """Beside a group lies or comes a part that is not joined yet, for each of those."""
    almost: float = 0.4
    """And it has nearly come to its place, where it is easily taken for joined."""
    nothing: float = 0.15
    """Instead of a part something else is shown, so that the network learns what is none."""
    neighbours: float = 0.5
    """Other things stand beside or behind it."""
    occluder: float = 0.3
    """Something stands in front."""
    hand: float = 0.15
    """A hand holds it or reaches across."""
    true_colors: float = 0.6
    standing: float = 0.5
    """The part touches the plane behind it; otherwise that is up to 0.2 m away."""
    tilt: float = 0.9
    """Largest angle between the plane's normal and the optical axis, radians."""


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """One mesh in front of the crop's camera."""

    mesh: int
    T_crop_mesh: Transform
    """May be affine (distractors are stretched)."""
    color: Vector
    """Linear RGB."""


@dataclass(frozen=True, slots=True, eq=False)
class CropScene:
    """What one crop shows; the first thing is the part itself, the base part of the group, or what is
    there instead."""

    label: int
    state: int
    """The place of what is shown among the network's states; -1 for a part."""
    name: int
    """The label again, or the number of classes where something else is in the part's place; -1 for
    a group."""
    T_crop_part: Transform
    """The truth: of the part or the base part; of nothing known, of the part that might be there."""
    focal: float
    """Of the stored crop, pixels; its centre is the principal point."""
    pixels: int
    """Side of the stored crop."""
    detail: float
    """Pixels of the frame a pixel of the crop: below 1 the crop is blurred."""
    things: tuple[Thing, ...]
    normal: Vector
    """Of the plane behind, towards the camera."""
    height: float
    """The plane's points p have normal @ p = height, metres."""


@cache
def _hand_meshes() -> tuple[Mesh, ...]:
    """The hand of each of GRASPS, thinned once a process."""
    return tuple(thinned(hand_mesh(i).mesh, HAND_FACES) for i in range(len(GRASPS)))


class CropDrawer:
    """Draws scenes of all parts and groups of several assemblies."""

    def __init__(
        self, assemblies: Sequence[Assembly], *, config: CropConfig, device: str = "cpu"
    ) -> None:
        self.classes = crop_classes(assemblies)
        self._assemblies, self._config = tuple(assemblies), config
        meshes = [thinned(p.mesh, PART_FACES) for a in assemblies for p in a.parts.values()]
        names = [(i, name) for i, a in enumerate(assemblies) for name in a.parts]
        self._place = {key: place for place, key in enumerate(names)}
        self._solids = range(len(meshes), len(meshes) + len(distractor_meshes()))
        meshes += distractor_meshes()
        self._hands = range(len(meshes), len(meshes) + len(GRASPS))
        meshes += _hand_meshes()
        self._corners = [hull_corners(m.vertices, CORNERS) for m in meshes]
        self.bank = MeshBank.of(meshes, device=device)
        several = [[s for s in a.states if len(s.T_base_part) > 1] for a in assemblies]
        self._joining = {(i, n): [s for s in several[i] if n in s.T_base_part] for i, n in names}
        self._halves = [HalfDone.of(assembly).halves for assembly in assemblies]
        self._spans = state_spans(group_states(self.classes))
        counts = np.array([len(c.states) for c in self.classes])
        parts = np.flatnonzero(counts == 0)
        self._chances = self._config.groups * counts / max(counts.sum(), 1)
        self._chances[parts] = (1 - self._chances.sum()) / len(parts)

    def labels(self, rng: np.random.Generator, count: int) -> Int64[np.ndarray, "n"]:
        """Classes to draw: parts evenly, and groups by the number of their states."""
        return rng.choice(len(self.classes), size=count, p=self._chances)

    def draw(self, rng: np.random.Generator, label: int) -> CropScene:
        """One crop of a class."""
        config, crop_class = self._config, self.classes[label]
        assembly, copy = self._assemblies[crop_class.assembly], 0
        state = int(rng.integers(len(crop_class.states))) if crop_class.states else None
        is_nothing = state is None and rng.random() < config.nothing
        if state is None:
            copy = int(rng.integers(len(crop_class.parts)))
            joined = self._joined(rng, crop_class.assembly, crop_class.parts[copy])
        else:
            shown, halves = assembly.states[state], self._halves[crop_class.assembly].get(state)
            if halves and rng.random() < config.half_done:
                shown = halves[int(rng.integers(len(halves)))]
            joined = dict(joined_poses(shown, rng))
        name = crop_class.parts[copy]
        mesh = self._place[crop_class.assembly, name]
        distance = float(rng.uniform(*config.distance))
        T_crop_part, extent = centred(crop_class.corners, random_rotation(rng), distance)
        colors = part_colors(assembly, rng, true_share=config.true_colors)
        T_crop_base = T_crop_part @ inverse(joined[name])
        things = [Thing(mesh, T_crop_part, colors[name])]
        if is_nothing:
            things, joined = [self._instead(rng, np.array([0.0, 0.0, distance]), extent)], {}
        for other, T_base_other in joined.items():
            if other != name:
                place = self._place[crop_class.assembly, other]
                things.append(Thing(place, T_crop_base @ T_base_other, colors[other]))
        normal, height = self._plane(rng, things)
        if state is not None:
            things += self._waiting(rng, crop_class, joined, colors, T_crop_base, extent)
        things += self._around(rng, things, extent)
        shown_px = CROP_PIXELS * config.pixels / STORED_PIXELS
        focal = shown_px * float(T_crop_part[2, 3]) / (CONTEXT * extent)
        frame_focal = FOCALS[int(rng.integers(len(FOCALS)))] * rng.uniform(0.98, 1.02)
        name_shown = len(self.classes) if is_nothing else label if state is None else -1
        told = -1 if state is None else self._spans[crop_class.name].start + state
        detail = frame_focal / focal
        truth = (label, told, name_shown, T_crop_part)
        return CropScene(*truth, focal, config.pixels, detail, tuple(things), normal, height)

    def _joined(self, rng: np.random.Generator, assembly: int, name: str) -> dict[str, Transform]:
        """T_base_part of a state that joins the part, or of the part alone."""
        states = self._joining[assembly, name]
        if states and rng.random() < self._config.joined:
            return dict(joined_poses(states[int(rng.integers(len(states)))], rng))
        return {name: np.eye(4)}

    def _plane(self, rng: np.random.Generator, things: Sequence[Thing]) -> tuple[Vector, float]:
        """A plane behind all things, tilted towards the camera."""
        azimuth, tilt = rng.random() * 2 * np.pi, self._config.tilt * np.sqrt(rng.random())
        lying = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * np.sin(tilt)
        normal = lying - np.array([0.0, 0.0, np.cos(tilt)])
        lowest = min(
            float((apply(t.T_crop_mesh, self._corners[t.mesh]) @ normal).min()) for t in things
        )
        gap = 0.0 if rng.random() < self._config.standing else rng.uniform(0, 0.2)
        return normal, lowest - gap

    def _waiting(
        self,
        rng: np.random.Generator,
        crop_class: CropClass,
        joined: Mapping[str, Transform],
        colors: Mapping[str, Vector],
        T_crop_base: Transform,
        extent: float,
    ) -> list[Thing]:
        """Parts that are not joined, lying beside the group or held before it."""
        middle = apply(T_crop_base, crop_class.middle[None])[0]
        found: list[Thing] = []
        for name in self._assemblies[crop_class.assembly].parts:
            if name in joined or rng.random() > self._config.waiting:
                continue
            mesh = self._place[crop_class.assembly, name]
            if rng.random() < self._config.almost:
                T_crop_part = T_crop_base @ self._almost_joined(rng, crop_class.assembly, name)
            else:
                R = random_rotation(rng)
                beside = direction(rng) * extent * rng.uniform(0.25, 0.65)
                where = middle + beside + [0, 0, rng.uniform(-0.35, 0.25) * extent]
                T_crop_part = transform_from(R, where - R @ self._corners[mesh].mean(axis=0))
            found.append(Thing(mesh, T_crop_part, colors[name]))
        return found

    def _almost_joined(self, rng: np.random.Generator, assembly: int, name: str) -> Transform:
        """T_base_part of a part that has nearly come to one of its places."""
        states = self._joining[assembly, name]
        T = joined_poses(states[int(rng.integers(len(states)))], rng)[name]
        R = rotation_about(unit(rng), float(rng.uniform(0.0, 0.7)))
        shift = unit(rng) * rng.uniform(*NEARLY)
        return transform_from(R @ T[:3, :3], T[:3, 3] + shift)

    def _around(
        self, rng: np.random.Generator, things: Sequence[Thing], extent: float
    ) -> list[Thing]:
        """Neighbours, occluders and hands."""
        config = self._config
        middle = things[0].T_crop_mesh[:3, 3]
        found: list[Thing] = []
        if rng.random() < config.neighbours:
            for _ in range(int(rng.integers(1, 4))):
                beside = direction(rng) * extent * rng.uniform(0.55, 1.2)
                depth = rng.uniform(-0.1, 0.5) * extent
                found.append(self._clutter(rng, middle + beside + [0, 0, depth], extent))
        if rng.random() < config.occluder:
            beside = direction(rng) * extent * rng.uniform(0.2, 0.75)
            nearer = (middle + beside) * rng.uniform(0.72, 0.92)
            nearer[2] = min(nearer[2], middle[2] - 0.6 * extent)
            nearer[2] = max(nearer[2], 0.12)
            found.append(self._clutter(rng, nearer, extent * 0.6))
        if rng.random() < config.hand:
            found.append(self._hand(rng, middle, extent))
        return found

    def _instead(self, rng: np.random.Generator, middle: Vector, extent: float) -> Thing:
        """What a detector may take for a part: a solid of its size, or a hand's fingers."""
        if rng.random() < 0.4:
            hand = self._hand(rng, middle, extent)
            tip = hand.T_crop_mesh.copy()
            tip[:3, 3] = middle + rng.normal(size=3) * [0.3, 0.3, 0.1] * extent
            return replace(hand, T_crop_mesh=tip)
        sizes = extent * np.exp(rng.normal(size=3) * 0.35 - 0.1) * 0.5
        T = transform_from(random_rotation(rng), middle) @ np.diag([*sizes, 1.0])
        mesh = self._solids[int(rng.integers(len(self._solids)))]
        return Thing(mesh, T, random_hue(rng, saturation=(0.0, 0.95)))

    def _clutter(self, rng: np.random.Generator, where: Vector, size: float) -> Thing:
        """A part of any assembly, or a stretched solid."""
        if rng.random() < 0.4:
            mesh = int(rng.integers(self._solids.start))
            R = random_rotation(rng)
            middle = self._corners[mesh].mean(axis=0)
            return Thing(mesh, transform_from(R, where - R @ middle), random_hue(rng))
        sizes = size * np.exp(rng.normal(size=3) * 0.45) * 0.5
        T = transform_from(random_rotation(rng), where) @ np.diag([*sizes, 1.0])
        mesh = self._solids[int(rng.integers(len(self._solids)))]
        return Thing(mesh, T, random_hue(rng, saturation=(0.0, 0.95)))

    def _hand(self, rng: np.random.Generator, middle: Vector, extent: float) -> Thing:
        """A hand whose fingers end at the part's rim, the forearm leaving sideways."""
        away = direction(rng)
        x = np.cross(away, [0.0, 0.0, 1.0])
        R = np.stack([x, -away, np.cross(x, -away)], axis=1)
        roll = rotation_about(np.array([0.0, 1.0, 0.0]), float(rng.normal() * 0.8))
        side = -1.0 if rng.random() < 0.5 else 1.0
        where = middle + away * extent * rng.uniform(0.3, 0.7) + [0, 0, rng.normal() * 0.01]
        T = transform_from(R @ roll @ np.diag([side, 1.0, 1.0]), where)
        return Thing(self._hands[int(rng.integers(len(self._hands)))], T, skin(rng).color)
