"""A whole assembly sequence before it is rendered: stage, script, hands, camera and lights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply
from asdfviz.pose.resting import footprint, overlap
from asdfviz.synth.assets import Assets
from asdfviz.synth.clearance import given_way, snapped
from asdfviz.synth.description import Ground, Light, Placed
from asdfviz.synth.film import Moment, film
from asdfviz.synth.fixture import find_fixture
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.layout import Outfit, Table, dress, turn_z
from asdfviz.synth.looks import random_lights
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import Solid, solid_of
from asdfviz.synth.photo_grounds import choose_grounds
from asdfviz.synth.routes import free_targets
from asdfviz.synth.scene import random_view
from asdfviz.synth.script import Director
from asdfviz.synth.second_hand import Hand, covered, holding, hovering
from asdfviz.synth.sequence_config import SequenceConfig
from asdfviz.synth.stage import Stage, set_stage, stand_base
from asdfviz.synth.ways import Body, Way, all_ways, with_steps

Targets = Mapping[int, Mapping[str, Transform]]
Ways = Mapping[tuple[int, str], Way]
STUCK = 0.0005
"""A part whose way goes deeper through others than this beyond its allowance has no turned joint, metres."""
SAMPLES = 450
"""Points on a part with which the script is planned."""
_VIEWS = 8
_FARTHER = 1.12


@dataclass(frozen=True, slots=True, eq=False)
class Play:
    """A sequence before it is rendered."""

    moments: tuple[Moment, ...]
    stage: Stage
    outfit: Outfit
    others: tuple[Hand, ...]
    """Hands that hold the base or hover."""
    furniture: tuple[Placed, ...]
    """What a base that cannot stand is put on."""
    table: Table
    scenery: tuple[Ground, ...]
    lights: tuple[Light, ...]
    sky: np.ndarray
    tint: np.ndarray


def plan_sequence(assets: Assets, *, seed: int, config: SequenceConfig) -> Play:
    """Write the script of a sequence; the same seed gives the same one.

    Raises:
        InputError: an error state that the assembly does not have, or parts that do not fit into
            any view.
    """
    assembly = assets.assembly
    rng = np.random.default_rng([seed, 11])
    if isinstance(config.error, str) and config.error not in [e.name for e in assembly.errors]:
        known = ", ".join(e.name for e in assembly.errors) or "none"
        raise InputError(f"{assembly.name} has no error state '{config.error}'; it has: {known}")
    solids = {n: solid_of(p.mesh, samples=SAMPLES) for n, p in assembly.parts.items()}
    there = _staged(assets, solids, seed, rng, config)
    table, stage, outfit, others = there.table, there.stage, there.outfit, there.holding
    director = Director(
        assets, solids, stage, there.targets, there.ways, outfit if config.hands else None,
        config.pace, config.fps, rng,
    )  # fmt: skip
    furniture = ()
    if stage.stand.held and not config.hands:
        T = stage.stand.T_world_base
        joined = _occupied(solids, there.targets, there.ways, T, assembly)
        furniture = (find_fixture(assets, solids[assembly.base], T, joined, rng),)
    _perform(director, table, rng, config, shown=not others and not furniture and config.hands)
    least = sum(act.least for act in director.acts)
    if config.error is True and config.frames is not None and least > config.frames:
        # There is no time for an error.
        return plan_sequence(assets, seed=seed, config=replace(config, error=False))
    moments = film(director.acts, frames=config.frames, frames_per_state=config.frames_per_state)
    moments = snapped(moments, solids, step=config.pace.parts(config.fps).step)
    moments = given_way(moments, solids, outfit)
    if config.covering_hand:
        others = (*others, hovering(solids, stage.stand, moments, outfit, rng))
    footprints = np.concatenate(table.outlines)
    scenery = choose_grounds(footprints, rng, theatre_share=config.theatre, photos=config.photos)
    lights, sky, tint = random_lights(rng)
    return Play(moments, stage, outfit, others, furniture, table, scenery, lights, sky, tint)


@dataclass(frozen=True, slots=True, eq=False)
class _Set:
    """What is there before anybody acts."""

    table: Table
    stage: Stage
    targets: Targets
    ways: Ways
    holding: tuple[Hand, ...]
    outfit: Outfit
    """Of the person who assembles."""


def _staged(
    assets: Assets,
    solids: Mapping[str, Solid],
    seed: int,
    rng: np.random.Generator,
    config: SequenceConfig,
) -> _Set:
    """A view in which everything has room: farther ones are tried where there is none."""
    camera = camera_for(config.width, config.height)
    near, far = config.distance
    free = free_targets(assets.assembly, solids, seed=seed)
    for _ in range(_VIEWS):
        T_camera_world = random_view(rng, distance=(near, far), tilt=config.tilt)
        table = Table(camera.K, T_camera_world, camera.width, camera.height, reach=1.0)
        stand = stand_base(assets, table, rng)
        targets, ways = _passable(assets.assembly, solids, free, stand.T_world_base, seed)
        outfit, hands = None, tuple[Hand, ...]()
        if config.hands and (stand.held or config.covering_hand):
            outfit = dress(rng, grasp=0)
            joined = _occupied(solids, targets, ways, stand.T_world_base, assets.assembly)
            hand = holding(solids[assets.assembly.base], stand, joined, table, outfit, rng)
            hands = () if hand is None else (hand,)
        # It stays there for the whole sequence: loose parts lie where the camera sees them.
        table.covered += [outline for hand in hands for outline in covered(hand, table)]
        stage = set_stage(assets, table, stand, ways, targets, rng, distractors=config.distractors)
        if stage is not None:
            return _Set(table, stage, targets, ways, hands, outfit or dress(rng, grasp=0))
        near, far = far, far * _FARTHER
    raise InputError(
        f"the parts of {assets.assembly.name} do not fit side by side into a view from {near:.2f} m: "
        "allow a larger distance"
    )


def _passable(
    assembly: Assembly,
    solids: Mapping[str, Solid],
    targets: Targets,
    T_world_base: Transform,
    seed: int,
) -> tuple[Targets, Ways]:
    """Where parts go and their ways; joints keep their nominal places where parts would not pass."""
    ways = all_ways(assembly, solids, targets, T_world_base)
    stuck = {name for (_, name), way in ways.items() if way.depth > STUCK}
    if stuck:
        targets = free_targets(assembly, solids, seed=seed, still=stuck)
        ways = all_ways(assembly, solids, targets, T_world_base)
    return targets, ways


def _perform(
    director: Director,
    table: Table,
    rng: np.random.Generator,
    config: SequenceConfig,
    *,
    shown: bool,
) -> None:
    assembly = director.assembly
    errors = [e for e in assembly.errors if config.error in (True, e.name)]
    error = errors[int(rng.integers(len(errors)))] if errors else None
    later = assembly.steps[1:]
    slip = later[int(rng.integers(len(later)))].index if config.unlisted and later else None
    director.idle(3)
    for step in assembly.steps:
        if step.index > 0:
            director.go_to(step, slip=step.index == slip)
        if error is not None and error.after == step.index:
            director.go_to(error)
    shift = _free_shift(director, table, rng) if shown else None
    if shift is None:
        director.leave()
    else:
        director.show(*shift)
    director.idle(2)


def _free_shift(
    director: Director, table: Table, rng: np.random.Generator
) -> tuple[Vector, float] | None:
    """A push of the finished assembly that meets nothing, within the view."""
    base = director.poses[director.assembly.base]
    points = np.concatenate(
        [apply(base @ T, director.solids[n].samples) for n, T in director.joined.items()]
    )
    points_of = director.assets.points_of
    still = [footprint(apply(c.T_world_mesh, points_of(c))) for c in director.stage.clutter]
    still += [
        footprint(apply(T, director.solids[n].samples))
        for n, T in director.poses.items()
        if n not in director.joined
    ]
    for _ in range(12):
        angle, turn = rng.random() * 2 * np.pi, float(rng.choice([-1, 1]) * rng.uniform(0.3, 0.7))
        shift = rng.uniform(0.02, 0.05) * np.array([np.cos(angle), np.sin(angle), 0.0])
        R = turn_z(turn)
        center = apply(base, director.solids[director.assembly.base].samples).mean(axis=0)
        swept = [
            footprint((points - center) @ turn_z(s * turn).T + center + s * shift)
            for s in (0.35, 0.7, 1.0)
        ]  # fmt: skip
        if not any(overlap(a, b, gap=0.006) for a in swept for b in still):
            table.outlines.append(footprint((points - center) @ R.T + center + shift))
            return shift, turn
    return None


def _occupied(
    solids: Mapping[str, Solid],
    targets: Targets,
    ways: Ways,
    T_world_base: Transform,
    assembly: Assembly,
) -> list[Body]:
    """Every place that a joined part has or comes from, world."""
    bodies: list[Body] = []
    for (state, name), way in ways.items():
        for place in (0.0 * way.out, *with_steps(way.stops)):
            bodies.append(Body(solids[name], T_world_base @ moved(targets[state][name], place)))
    return bodies
