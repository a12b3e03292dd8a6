"""Wrong assemblies that no state lists: a joined part out of place, or one missing in between."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from asdfviz.datatypes import Assembly, State
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.synth.joint_motion import random_rotation

OFFSET = (0.005, 0.03)
"""How far a part is out of place, metres."""
TURN = (math.radians(10.0), math.radians(40.0))
"""How far it is turned, if it is, radians."""
MISSING = 0.25
"""Share of missing parts among the wrong assemblies, where the assembly allows any."""


def stray(
    assembly: Assembly,
    state: State,
    T_base_part: Mapping[str, Transform],
    rng: np.random.Generator,
) -> Mapping[str, Transform] | None:
    """Make a state's poses wrong in a way that no state of the assembly describes.

    Args:
        assembly: its states.
        state: the state that the poses belong to.
        T_base_part: poses of its parts, joints included.
        rng: throws.

    Returns:
        The wrong poses, or None if nothing is joined to the base part.
    """
    joined = [n for n in T_base_part if n != assembly.base]
    if not joined:
        return None
    known = {frozenset(s.T_base_part) for s in assembly.states}
    removable = [n for n in joined if frozenset(T_base_part) - {n} not in known]
    if removable and rng.random() < MISSING:
        gone = removable[int(rng.integers(len(removable)))]
        return {n: T for n, T in T_base_part.items() if n != gone}
    name = joined[int(rng.integers(len(joined)))]
    moved = displacement(assembly, state, name, T_base_part[name], rng)
    return {**T_base_part, name: moved @ T_base_part[name]}


def displacement(
    assembly: Assembly, state: State, name: str, T_base_part: Transform, rng: np.random.Generator
) -> Transform:
    """A motion in the base frame that no joint of the part allows, away from the base's middle."""
    points = assembly.parts[name].mesh.vertices
    middle = apply(T_base_part, (points.min(axis=0) + points.max(axis=0))[None] / 2)[0]
    joint = state.joints.get(name)
    direction = _across(None if joint is None else joint.axis, rng)
    base = assembly.parts[assembly.base].mesh.vertices
    if direction @ (middle - (base.min(axis=0) + base.max(axis=0)) / 2) < 0:
        direction = -direction
    angle = float(rng.uniform(*TURN)) if rng.random() < 0.6 else 0.0
    R = rotation_about(_across(None if joint is None else joint.axis, rng), angle)
    return transform_from(R, middle - R @ middle + direction * rng.uniform(*OFFSET))


def _across(axis: Vector | None, rng: np.random.Generator) -> Vector:
    """A random direction, at right angles to an axis if there is one."""
    direction = random_rotation(rng)[0]
    if axis is not None:
        direction = direction - axis * (direction @ axis)
    return direction / np.linalg.norm(direction)
