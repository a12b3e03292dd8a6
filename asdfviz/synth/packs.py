"""Object packs: thirty and more single parts and joined groups in one picture, turned freely.

A pack gives several times the poses per pixel that a scene gives. All objects float before a random
ground and share the one camera, so every pose stays exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Intrinsics, Points, Rgb, Transform
from asdfviz.geometry.transforms import apply, transform_from
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Placed, Scene
from asdfviz.synth.joint_motion import joined_poses, random_rotation
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.layout import hand_at
from asdfviz.synth.looks import part_colors, plastic, random_hue, random_lights
from asdfviz.synth.photo_grounds import Photos, choose_grounds
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import Group, TrueScene
from asdfviz.synth.sensor import photograph, random_rgb_sensor
from asdfviz.synth.shading import ShadingConfig, look_at
from asdfviz.synth.strays import stray

PACK_LIGHT = ShadingConfig(interleave=2, occlusion=0.35, shadow_pixels=320, directions=6)
"""Objects in the air cast few shadows on one another: four points of a light do."""


@dataclass(frozen=True, slots=True)
class PackConfig:
    """How packs are drawn."""

    width: int = 640
    """Pixels."""
    height: int = 360
    """Pixels."""
    sizes_px: tuple[float, float] = (32.0, 120.0)
    """Projected diameters, pixels; drawn evenly on a logarithmic scale."""
    coverage: float = 0.62
    """Share of the image that the objects' circles fill before no more are added."""
    groups: float = 0.3
    """Share of joined groups among the objects."""
    strays: float = 0.15
    """Share of groups with a part out of place or missing, as no state says."""
    true_colors: float = 0.6
    """Probability that a picture keeps the real colours."""
    supersampled: float = 0.2
    """Probability of colour at one and a half times the resolution, averaged."""
    occluders: float = 0.22
    """Occluders an object."""
    hand: float = 0.3
    """Probability of a hand in front."""
    nearest: float = 0.14
    """Objects are never nearer to the camera, metres."""
    farthest: float = 1.3
    """Distance of the ground from the camera, metres; objects are nearer."""
    photos: Photos = field(default_factory=Photos)
    """Of the user's own table, which most packs then lie over."""

    def check(self) -> None:
        """Refuse figures with which no pack can be drawn.

        Raises:
            InputError: with the field and what would be right.
        """
        for name in ("groups", "strays", "occluders", "hand"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} is {getattr(self, name):g}, use 0 to 1")
        if not 0 < self.coverage <= 1:
            raise InputError(f"coverage is {self.coverage:g}, use more than 0 and up to 1")
        smallest, largest = self.sizes_px
        if not 4 <= smallest <= largest <= 4096:
            raise InputError(
                f"sizes_px is {smallest:g} to {largest:g}, use two rising numbers from 4 to 4096"
            )
        room = min(self.width, self.height)
        if smallest > room:
            raise InputError(
                f"sizes_px begins at {smallest:g}, use 4 to {room} in an image of "
                f"{self.width}x{self.height}"
            )


def make_pack(assets: Assets, *, rng: np.random.Generator, config: PackConfig) -> TrueScene:
    """Draw one pack."""
    camera = camera_for(config.width, config.height, zoom=1 + rng.uniform(-0.02, 0.02))
    eye = np.array([0.0, 0.0, config.farthest])
    T_camera_world = look_at(eye, np.zeros(3))
    T_world_camera = np.linalg.inv(T_camera_world)
    colors = part_colors(assets.assembly, rng, true_share=config.true_colors)
    placed: list[Placed] = []
    groups: list[Group] = []
    for T_base_part, T_camera_base, state in _objects(assets, camera.K, rng, config):
        first = len(placed)
        for name, T in T_base_part.items():
            pose = T_world_camera @ T_camera_base @ T
            finish = plastic(colors[name], rng)
            placed.append(Placed(assets.parts[name], pose, finish, "part", name, truth=True))
        if state is not None:
            members = tuple(range(first, len(placed)))
            groups.append(Group(assets.assembly.states[state], members))
    anchors = [p for p in placed if rng.random() < config.occluders]
    placed += [_occluder(assets, anchor, eye, rng) for anchor in anchors]
    if rng.random() < config.hand and placed:
        anchor = placed[int(rng.integers(len(placed)))].T_world_mesh[:3, 3]
        angle = rng.random() * 2 * np.pi
        away = np.array([np.cos(angle), np.sin(angle), 0.0])
        grasp = int(rng.integers(len(assets.hands)))
        placed += hand_at(assets, anchor + np.array([0, 0, 0.02]), away, rng, grasp=grasp)
    lights, sky, tint = random_lights(rng)
    spread = rng.uniform(-1.2, 1.2, size=(6, 2))
    grounds = choose_grounds(spread, rng, theatre_share=None, photos=config.photos)
    target = np.array([0.0, 0.0, config.farthest * 0.5])
    scene = Scene(
        camera,
        T_camera_world,
        tuple(placed),
        grounds,
        lights,
        sky,
        tint,
        target,
        config.farthest * 0.6,
    )
    return TrueScene(scene, tuple(groups), None)


@dataclass(frozen=True, slots=True, eq=False)
class PackObject:
    """One part in a pack; groups have one for each of their parts."""

    name: str
    T_camera_part: Transform
    box: tuple[int, int, int, int]
    """x, y, width and height of the whole part, also beyond the image, pixels."""
    visible: float
    """Share of the whole part's pixels that is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class PackTruth:
    """What a pack shows."""

    K: Intrinsics
    objects: tuple[PackObject, ...]
    groups: tuple[tuple[State, tuple[int, ...]], ...]
    """Joined parts of a state: places in `objects`, the base part first."""


def draw_pack(
    assets: Assets, *, rng: np.random.Generator, config: PackConfig
) -> tuple[Rgb, PackTruth]:
    """Draw, render and photograph one pack in memory, for training that makes its own images."""
    pack, picture = render_pack(assets, rng=rng, config=config)
    rgb = photograph(picture.radiance, sensor=random_rgb_sensor(rng), rng=rng)
    scene = pack.scene
    seen = np.bincount(picture.ids[picture.ids >= 0], minlength=len(scene.placed))
    truth = [i for i, p in enumerate(scene.placed) if p.truth]
    objects = [
        PackObject(
            scene.placed[i].name,
            scene.T_camera_world @ scene.placed[i].T_world_mesh,
            tuple(picture.silhouette_box[i].tolist()),
            float(seen[i] / max(picture.silhouette_px[i], 1)),
        )
        for i in truth
    ]
    place = {index: k for k, index in enumerate(truth)}
    groups = tuple((g.state, tuple(place[i] for i in g.members)) for g in pack.groups)
    return rgb, PackTruth(scene.camera.K, tuple(objects), groups)


def render_pack(
    assets: Assets, *, rng: np.random.Generator, config: PackConfig
) -> tuple[TrueScene, Picture]:
    """Draw and render one pack."""
    pack = make_pack(assets, rng=rng, config=config)
    supersampling = 1.5 if rng.random() < config.supersampled else 1.0
    picture = render(
        [pack.scene], assets.bank, rng=rng, supersampling=supersampling, shading=PACK_LIGHT
    )[0]
    return pack, picture


def _objects(
    assets: Assets, K: np.ndarray, rng: np.random.Generator, config: PackConfig
) -> list[tuple[Mapping[str, Transform], Transform, int | None]]:
    """Poses of the objects, packed by throwing circles at free places."""
    circles = np.zeros((0, 3))
    area = config.width * config.height * config.coverage
    found: list[tuple[Mapping[str, Transform], Transform, int | None]] = []
    failures = 0
    while failures < 40 and np.pi * (circles[:, 2] ** 2).sum() < area:
        T_base_part, state = _draw(assets.assembly, rng, config)
        points = _points(assets.assembly, T_base_part)
        R = random_rotation(rng)
        smallest, largest = config.sizes_px
        size_px = smallest * (largest / smallest) ** float(rng.random())
        size_px *= 1.5 if len(T_base_part) > 1 else 1.0
        turned = points @ R.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        extent = float(np.hypot(*(high - low)[:2]))
        z = float(np.clip(K[0, 0] * extent / size_px, config.nearest, config.farthest * 0.85))
        radius = 0.5 * K[0, 0] * extent / z * 0.82
        spots = rng.uniform(-0.02, 1.02, size=(30, 2)) * [config.width, config.height]
        gaps = (
            np.linalg.norm(spots[:, None] - circles[None, :, :2], axis=2) - circles[:, 2] - radius
        )
        free = np.nonzero((gaps > 0).all(axis=1))[0]
        if len(free) == 0:
            failures += 1
            continue
        u, v = spots[free[0]]
        circles = np.concatenate([circles, [[u, v, radius]]])
        t = z * np.linalg.solve(K, np.array([u, v, 1.0])) - (low + high) / 2
        found.append((T_base_part, transform_from(R, t), state))
    return found


def _draw(
    assembly: Assembly, rng: np.random.Generator, config: PackConfig
) -> tuple[Mapping[str, Transform], int | None]:
    """A single part, or a joined group with its state; a lone base part is state 0."""
    if rng.random() < config.groups:
        state = assembly.states[int(rng.integers(len(assembly.states)))]
        poses = joined_poses(state, rng)
        wrong = rng.random() < config.strays and stray(assembly, state, poses, rng)
        return (wrong, None) if wrong else (poses, state.index)
    names = list(assembly.parts)
    return {names[int(rng.integers(len(names)))]: np.eye(4)}, None


def _points(assembly: Assembly, T_base_part: Mapping[str, Transform]) -> Points:
    return np.concatenate(
        [apply(T, assembly.parts[n].mesh.vertices) for n, T in T_base_part.items()]
    )


def _occluder(assets: Assets, anchor: Placed, eye: np.ndarray, rng: np.random.Generator) -> Placed:
    """A solid between the camera and the edge of an object."""
    part = assets.assembly.parts[anchor.name]
    middle = apply(anchor.T_world_mesh, part.mesh.vertices[:1])[0]
    nearer = eye + (middle - eye) * rng.uniform(0.7, 0.9)
    size = part.diameter * np.exp(rng.normal(size=3) * 0.5) * 0.35
    size[int(rng.integers(3))] *= rng.uniform(1, 4)
    shift = rng.normal(size=3) * [0.3, 0.3, 0.0] * part.diameter
    T = transform_from(random_rotation(rng), nearer + shift) @ np.diag([*size, 1.0])
    kind = assets.distractors[int(rng.integers(len(assets.distractors)))]
    return Placed(kind, T, plastic(random_hue(rng), rng), "distractor")
