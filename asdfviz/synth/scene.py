"""Training scenes: a random state of the assembly among loose parts, distractors and hands.

The camera follows the paper's protocol: an Azure Kinect's intrinsics, 0.42 to 1.0 m over the table,
tilted by up to 43 degrees, any roll; near views are drawn more often than far ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from asdfviz.datatypes import State
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, transform_from
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Ground, Placed, Scene
from asdfviz.synth.joint_motion import joined_poses
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.layout import (
    Table,
    group_points,
    holding_hand,
    passing_hand,
    place_carried,
    place_distractor,
    place_group,
    place_loose,
    stand,
    turn_z,
)
from asdfviz.synth.looks import part_colors, plastic, random_lights
from asdfviz.synth.photo_grounds import Photos, choose_grounds
from asdfviz.synth.shading import look_at
from asdfviz.synth.strays import stray


@dataclass(frozen=True, slots=True)
class SceneConfig:
    """How training scenes are drawn; probabilities unless said otherwise."""

    width: int = 640
    """Pixels."""
    height: int = 360
    """Pixels."""
    distance: tuple[float, float] = (0.42, 1.0)
    """Camera to table along the optical axis, metres (the paper: 0.45 to 1.0)."""
    tilt: tuple[float, float] = (0.0, 0.75)
    """Angle between the optical axis and the vertical, radians."""
    focal_jitter: float = 0.02
    """Relative half range of the focal length."""
    true_colors: float = 0.6
    theatre: float = 0.35
    """Blue drape over a round table."""
    room_light: float = 0.35
    """Soft light from large panels instead of lamps."""
    held: float = 0.6
    """The joined group is in a hand, on a stand or in the air, at any orientation."""
    stray: float = 0.12
    """A joined part is out of place or missing, as no state says; the scene then has no group."""
    hand_when_held: float = 0.75
    passing_hand: float = 0.35
    carried: float = 0.5
    """A hand holds one of the loose parts over the table, as on its way to the group."""
    present: float = 0.88
    """Of each loose part."""
    tilted: float = 0.3
    """Loose parts at any orientation instead of at rest."""
    duplicates: int = 3
    """At most."""
    distractors: int = 6
    """At most."""
    photos: Photos = field(default_factory=Photos)
    """Of the user's own table, which most scenes then show."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Joined parts of one state within a picture."""

    state: State
    members: tuple[int, ...]
    """Places in Scene.placed, base part first."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueScene:
    """A scene and what is joined in it."""

    scene: Scene
    groups: tuple[Group, ...]
    main: int | None
    """Which group the picture's state is about; None for packs and for what is no state."""


def random_view(
    rng: np.random.Generator, *, distance: tuple[float, float], tilt: tuple[float, float]
) -> Transform:
    """T_camera_world over the table, looking near the world's origin."""
    near, farthest = distance
    far, angle = near + (farthest - near) * rng.random() ** 1.5, rng.uniform(*tilt)
    azimuth = rng.random() * 2 * np.pi
    target = np.array([rng.normal() * 0.03, rng.normal() * 0.03, 0.0])
    flat = np.sin(angle)
    back = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.cos(angle)])
    T = look_at(target + far * back, target)
    roll = turn_z(rng.random() * 2 * np.pi)
    return transform_from(roll, np.zeros(3)) @ T


def make_scene(
    assets: Assets, *, rng: np.random.Generator, config: SceneConfig, hands: bool = True
) -> TrueScene:
    """Draw one scene; `hands` off is the way out when hands hid everything."""
    zoom = 1 + rng.uniform(-config.focal_jitter, config.focal_jitter)
    camera = camera_for(config.width, config.height, zoom=zoom)
    T_camera_world = random_view(rng, distance=config.distance, tilt=config.tilt)
    reach = rng.uniform(0.2, 0.45)
    table = Table(camera.K, T_camera_world, camera.width, camera.height, reach)
    colors = part_colors(assets.assembly, rng, true_share=config.true_colors)

    states = assets.assembly.states
    state = states[int(rng.integers(len(states)))]
    T_base_part = joined_poses(state, rng)
    wrong = rng.random() < config.stray and stray(assets.assembly, state, T_base_part, rng)
    T_base_part = wrong or T_base_part
    held = bool(rng.random() < config.held)
    T_world_base = place_group(assets, T_base_part, table, rng, held=held)
    placed = [_part(assets, name, T_world_base @ T, colors, rng) for name, T in T_base_part.items()]
    groups = () if wrong else (Group(state, tuple(range(len(placed)))),)
    placed += _loose_parts(assets, T_base_part, table, colors, rng, config)
    for _ in range(int(rng.integers(config.distractors + 1))):
        extra = place_distractor(assets, table, rng)
        placed += [] if extra is None else [extra]
    grounds = _grounds(table, rng, config)
    group = apply(T_world_base, group_points(assets.assembly, T_base_part))
    placed += _around(assets, group, table, rng, config, held=held, hands=hands)
    lights, sky, tint = random_lights(rng, room=config.room_light)
    if hands:
        # Throws of its own, so that all else is as it is without.
        placed = _carried(assets, placed, len(T_base_part), table, rng.spawn(1)[0], config)
    target = table.on_table(camera.width / 2, camera.height / 2)
    scene = Scene(
        camera,
        T_camera_world,
        tuple(placed),
        grounds,
        lights,
        sky,
        tint,
        target,
        max(reach + 0.25, 0.5),
    )
    return TrueScene(scene, groups, 0 if groups else None)


def _part(
    assets: Assets,
    name: str,
    T_world_part: Transform,
    colors: Mapping[str, Vector],
    rng: np.random.Generator,
) -> Placed:
    finish = plastic(colors[name], rng)
    return Placed(assets.parts[name], T_world_part, finish, "part", name, truth=True)


def _loose_parts(
    assets: Assets,
    joined: Mapping[str, Transform],
    table: Table,
    colors: Mapping[str, Vector],
    rng: np.random.Generator,
    config: SceneConfig,
) -> list[Placed]:
    """The parts that are not joined yet, and some second copies."""
    names = [n for n in assets.assembly.parts if n not in joined and rng.random() < config.present]
    every = list(assets.assembly.parts)
    names += [
        every[int(rng.integers(len(every)))]
        for _ in range(int(rng.integers(config.duplicates + 1)))
    ]
    placed: list[Placed] = []
    for name in names:
        T = place_loose(assets, name, table, rng, tilted=bool(rng.random() < config.tilted))
        if T is not None:
            placed.append(_part(assets, name, T, colors, rng))
    return placed


def _carried(
    assets: Assets,
    placed: list[Placed],
    joined: int,
    table: Table,
    rng: np.random.Generator,
    config: SceneConfig,
) -> list[Placed]:
    """What is placed, one of the loose parts taken up by a hand; the first `joined` ones are no such."""
    loose = [i for i, p in enumerate(placed) if p.kind == "part" and i >= joined]
    if not loose or rng.random() >= config.carried:
        return placed
    taken = loose[int(rng.integers(len(loose)))]
    T = place_carried(assets, placed[taken].name, table, rng)
    if T is None:
        return placed
    points = apply(T, assets.assembly.parts[placed[taken].name].mesh.vertices)
    moved = [replace(p, T_world_mesh=T) if i == taken else p for i, p in enumerate(placed)]
    return moved + holding_hand(assets, points, rng)


def _grounds(table: Table, rng: np.random.Generator, config: SceneConfig) -> tuple[Ground, ...]:
    points = np.concatenate(table.outlines)
    return choose_grounds(points, rng, theatre_share=config.theatre, photos=config.photos)


def _around(
    assets: Assets,
    group: Points,
    table: Table,
    rng: np.random.Generator,
    config: SceneConfig,
    *,
    held: bool,
    hands: bool,
) -> list[Placed]:
    """Hands that hold the group or pass by, or a stand under what no hand holds."""
    placed: list[Placed] = []
    if held and hands and rng.random() < config.hand_when_held:
        placed += holding_hand(assets, group, rng)
        if rng.random() < 0.3:
            placed += holding_hand(assets, group, rng)
    elif held and rng.random() < 0.7:
        placed += stand(assets, group, rng)
    if hands and rng.random() < config.passing_hand:
        placed += passing_hand(assets, table, rng)
    return placed
