"""The opening position of an assembly sequence: a standing base, loose parts around it, clutter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.shapes import Rotation, Transform, Vector
from asdfviz.geometry.transforms import apply, rotation_angle, transform_from
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Placed
from asdfviz.synth.layout import Table, group_points, lowered, place_distractor, turn_z
from asdfviz.synth.resting import RestingFace, footprint

CENTRAL = (0.24, 0.14)
"""Shares of the image at each side that loose parts keep free: there is no depth there."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Where everything is before the first hand comes."""

    T_world_base: Transform
    base_held: bool
    """The base cannot stand so that all parts fit on: a second hand holds it."""
    T_world_part: Mapping[str, Transform]
    """Loose parts at rest."""
    clutter: tuple[Placed, ...]
    shoulder: Vector
    """Where the arm comes from, world."""


def set_stage(
    assets: Assets,
    table: Table,
    goals: Mapping[str, Transform],
    rng: np.random.Generator,
    *,
    distractors: int,
) -> Stage:
    """Place the base in the middle and everything else around it.

    Args:
        assets: meshes and resting faces.
        table: the view; gets the footprints.
        goals: T_base_part of the finished assembly, from which handy rests are chosen.
        rng: throws.
        distractors: how many at most.
    """
    assembly = assets.assembly
    middle = table.on_table(table.width / 2, table.height * 0.55)
    R, held = _base_rotation(assets, rng)
    # In the base's own frame, so that joined parts count for height and footprint.
    points = np.concatenate([group_points(assembly, s.T_base_part) for s in assembly.states])
    alone = assembly.parts[assembly.base].mesh.vertices
    t = lowered(points if held else alone, R)[:3, 3]
    T = transform_from(R, t + np.array([middle[0], middle[1], 0.035 if held else 0.0]))
    around = apply(T, points)
    table.outlines.append(footprint(around))
    azimuth = -np.pi / 2 + rng.normal() * 0.35
    down = table.on_table(table.width / 2, table.height * 0.95) - middle
    facing = np.arctan2(down[1], down[0]) + azimuth + np.pi / 2
    shoulder = middle + 0.62 * np.array([np.cos(facing), np.sin(facing), 0.0]) + [0, 0, 0.25]
    loose: dict[str, Transform] = {}
    for name, T_base_part in goals.items():
        if name != assembly.base:
            loose[name] = _lay(assets, name, (T @ T_base_part)[:3, :3], table, rng)
    clutter = [
        place_distractor(assets, table, rng) for _ in range(int(rng.integers(distractors + 1)))
    ]
    return Stage(T, held, loose, tuple(c for c in clutter if c is not None), shoulder)


def _base_rotation(assets: Assets, rng: np.random.Generator) -> tuple[Rotation, bool]:
    """A resting face on which no joined part of any state would go through the table."""
    assembly = assets.assembly
    spin = turn_z(rng.random() * 2 * np.pi)
    base_points = assembly.parts[assembly.base].mesh.vertices
    usable: list[RestingFace] = []
    for face in assets.resting[assembly.base]:
        floor = float((base_points @ face.R_world_part.T)[:, 2].min())
        low = min(_lowest(assembly, s, face.R_world_part) for s in assembly.states)
        if low > floor - 0.0005 and face.margin > 0.004:
            usable.append(face)
    if not usable:
        return spin, True
    weights = np.array([f.probability for f in usable])
    return spin @ usable[
        int(rng.choice(len(usable), p=weights / weights.sum()))
    ].R_world_part, False


def _lowest(assembly: Assembly, state: State, R: Rotation) -> float:
    return float((group_points(assembly, state.T_base_part) @ R.T)[:, 2].min())


def _lay(
    assets: Assets, name: str, R_goal: Rotation, table: Table, rng: np.random.Generator
) -> Transform:
    """A rest from which the way to the goal's orientation is short."""
    faces = assets.resting[name]
    turns = [_alignment(face.R_world_part, R_goal) for face in faces]
    weights = np.array([np.sqrt(f.probability) for f in faces])
    weights *= np.exp(-np.array([rest for _, rest in turns]) / 0.35) + 1e-9
    chosen = int(rng.choice(len(faces), p=weights / weights.sum()))
    R = turn_z(turns[chosen][0] + rng.uniform(-0.9, 0.9)) @ faces[chosen].R_world_part
    points = assets.assembly.parts[name].mesh.vertices
    T = lowered(points, R)
    outline = footprint(apply(T, points))
    spot = _spot(table, outline, rng)
    return transform_from(R, T[:3, 3] + [spot[0], spot[1], 0.0])


def _spot(table: Table, outline: np.ndarray, rng: np.random.Generator) -> Sequence[float]:
    """A free place well in view, or further out when the view is full."""
    tries = (
        (CENTRAL, 0.2),
        (CENTRAL, 1.0),
        ((0.1, 0.06), 1.0),
        ((-0.3, -0.3), 1.0),
        ((-1.0, -1.0), 2.0),
    )
    for border, table.reach in tries:
        spot = table.find_place(outline, rng, gap=0.012, border=border)
        if spot is not None:
            return spot.tolist()
    middle = table.on_table(table.width / 2, table.height / 2)
    return [float(middle[0]) + 0.6 + 0.1 * len(table.outlines), float(middle[1])]


def _alignment(R_rest: Rotation, R_goal: Rotation) -> tuple[float, float]:
    """The turn about the vertical that brings a rest nearest to the goal, and what then remains."""
    M = R_goal @ R_rest.T
    turn = float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]))
    return turn, rotation_angle(turn_z(turn).T @ M)
