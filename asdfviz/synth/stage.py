"""The opening position of an assembly sequence: a standing base, loose parts around it, clutter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Points, Rotation, Transform, Vector
from asdfviz.geometry.transforms import apply, rotation_angle, transform_from
from asdfviz.pose.resting import RestingFace, center_of_mass, footprint, support_margin
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Placed
from asdfviz.synth.layout import Table, group_points, lowered, place_distractor, turn_z
from asdfviz.synth.ways import Way

CENTRAL = (0.24, 0.14)
"""Shares of the image at each side that loose parts keep free: there is no depth there."""
HELD_HEIGHT = 0.035
"""Of the lowest point of a base that a second hand holds, metres."""
STEADY = 0.002
"""How far within its contacts the centre of mass of what is joined stays in every state, metres."""
_EDGE = 0.015
"""Share of the image at each side that parts keep free."""


@dataclass(frozen=True, slots=True, eq=False)
class Stand:
    """Where the base is."""

    T_world_base: Transform
    held: bool
    """It cannot stand so that all parts fit on: a second hand holds it."""
    shoulder: Vector
    """Where the arm comes from, world."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Where everything is before the first hand comes."""

    stand: Stand
    T_world_part: Mapping[str, Transform]
    """Loose parts at rest."""
    clutter: tuple[Placed, ...]


def stand_base(assets: Assets, table: Table, rng: np.random.Generator) -> Stand:
    """Put the base in the middle of the view."""
    assembly = assets.assembly
    middle = table.on_table(table.width / 2, table.height * 0.55)
    R, held = _base_rotation(assets, rng)
    # In the base's own frame, so that joined parts count for height and footprint.
    points = np.concatenate([group_points(assembly, s.T_base_part) for s in assembly.states])
    alone = assembly.parts[assembly.base].mesh.vertices
    t = lowered(points if held else alone, R)[:3, 3]
    T = transform_from(R, t + np.array([middle[0], middle[1], HELD_HEIGHT if held else 0.0]))
    azimuth = -np.pi / 2 + rng.normal() * 0.35
    down = table.on_table(table.width / 2, table.height * 0.95) - middle
    facing = np.arctan2(down[1], down[0]) + azimuth + np.pi / 2
    shoulder = middle + 0.62 * np.array([np.cos(facing), np.sin(facing), 0.0]) + [0, 0, 0.25]
    return Stand(T, held, shoulder)


def set_stage(
    assets: Assets,
    table: Table,
    stand: Stand,
    ways: Mapping[tuple[int, str], Way],
    targets: Mapping[int, Mapping[str, Transform]],
    rng: np.random.Generator,
    *,
    distractors: int,
) -> Stage | None:
    """Place everything around the base; None if the view has no room for it.

    Args:
        assets: meshes and resting faces.
        table: the view; gets the footprints.
        stand: the base.
        ways: on which parts come home: their room stays free.
        targets: T_base_part of each state, from which handy rests are chosen.
        rng: throws.
        distractors: how many at most.
    """
    assembly, T = assets.assembly, stand.T_world_base
    taken = [apply(T, group_points(assembly, poses)) for poses in targets.values()]
    for (state, name), way in ways.items():
        home = apply(T @ targets[state][name], assembly.parts[name].mesh.vertices)
        taken += [home + T[:3, :3] @ stop for stop in way.stops]
    table.outlines.append(footprint(np.concatenate(taken)))
    goals = targets[assembly.steps[-1].index]
    loose: dict[str, Transform] = {}
    largest_first = sorted(
        (n for n in goals if n != assembly.base), key=lambda n: -assembly.parts[n].diameter
    )
    for name in largest_first:
        rest = _lay(assets, name, (T @ goals[name])[:3, :3], table, rng)
        if rest is None:
            return None
        loose[name] = rest
    clutter = [
        place_distractor(assets, table, rng) for _ in range(int(rng.integers(distractors + 1)))
    ]
    ordered = {name: loose[name] for name in goals if name in loose}
    return Stage(stand, ordered, tuple(c for c in clutter if c is not None))


def _base_rotation(assets: Assets, rng: np.random.Generator) -> tuple[Rotation, bool]:
    """A resting face on which every state stands and no joined part goes through the table."""
    assembly = assets.assembly
    spin = turn_z(rng.random() * 2 * np.pi)
    base_points = assembly.parts[assembly.base].mesh.vertices
    usable: list[RestingFace] = []
    groups = [
        (group_points(assembly, s.T_base_part), group_center(assembly, s.T_base_part))
        for s in assembly.states
    ]
    for face in assets.resting[assembly.base]:
        R = face.R_world_part
        floor = float((base_points @ R.T)[:, 2].min())
        low = min(float((points @ R.T)[:, 2].min()) for points, _ in groups)
        # How far the centre of mass of what is joined stays within what touches the table.
        steady = min(support_margin(points - center, -R[2]) for points, center in groups)
        if low > floor - 0.0005 and steady > STEADY:
            usable.append(face)
    if not usable:
        return spin, True
    weights = np.array([f.probability for f in usable])
    chosen = usable[int(rng.choice(len(usable), p=weights / weights.sum()))]
    return spin @ chosen.R_world_part, False


def group_center(assembly: Assembly, T_base_part: Mapping[str, Transform]) -> Vector:
    """Centre of mass of joined parts of one material, base frame."""
    centers = [
        apply(T, center_of_mass(assembly.parts[n].mesh)[None])[0] for n, T in T_base_part.items()
    ]
    weights = [
        _volume(assembly.parts[n].mesh.vertices[assembly.parts[n].mesh.faces]) for n in T_base_part
    ]
    return np.average(np.stack(centers), axis=0, weights=weights)


def _volume(triangles: np.ndarray) -> float:
    a, b, c = (triangles[:, k] - triangles.mean(axis=(0, 1)) for k in range(3))
    return max(abs(float((a * np.cross(b, c)).sum())) / 6, 1e-9)


def _lay(
    assets: Assets, name: str, R_goal: Rotation, table: Table, rng: np.random.Generator
) -> Transform | None:
    """A rest from which the way to the goal's orientation is short."""
    faces = assets.resting[name]
    points = assets.assembly.parts[name].mesh.vertices
    turns = [_alignment(face.R_world_part, R_goal) for face in faces]
    weights = np.array([np.sqrt(f.probability) * (f.margin > 0.0005) + 1e-6 for f in faces])
    weights *= np.exp(-np.array([rest for _, rest in turns]) / 0.3) + 1e-9
    for _ in range(4):
        chosen = int(rng.choice(len(faces), p=weights / weights.sum()))
        R = turn_z(turns[chosen][0] + rng.uniform(-0.6, 0.6)) @ faces[chosen].R_world_part
        T = lowered(points, R)
        spot = _spot(table, apply(T, points), rng)
        if spot is not None:
            return transform_from(R, T[:3, 3] + [spot[0], spot[1], 0.0])
    return None


def _spot(table: Table, points: Points, rng: np.random.Generator) -> Sequence[float] | None:
    """A free place wholly in view, the middle of the view first; hands need room between parts."""
    outline = footprint(points)
    tries = ((CENTRAL, 0.03), (CENTRAL, 0.02), ((0.1, 0.08), 0.02), ((0.05, 0.04), 0.01))
    for border, gap in tries:
        for _ in range(4):
            spot = table.find_place(outline, rng, gap=gap, border=border)
            if spot is None:
                break
            if _in_view(table, points + np.array([*spot, 0.0])):
                return spot.tolist()
            table.outlines.pop()
    return None


def _in_view(table: Table, points: Points) -> bool:
    p = apply(table.T_camera_world, points) @ table.K.T
    share = p[:, :2] / p[:, 2:] / [table.width, table.height]
    return bool(((share > _EDGE) & (share < 1 - _EDGE)).all())


def _alignment(R_rest: Rotation, R_goal: Rotation) -> tuple[float, float]:
    """The turn about the vertical that brings a rest nearest to the goal, and what then remains."""
    M = R_goal @ R_rest.T
    turn = float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]))
    return turn, rotation_angle(turn_z(turn).T @ M)
