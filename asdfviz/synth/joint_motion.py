"""Draws places within the freedom that joints leave: what moves on a base, and what moves with it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from asdfviz.datatypes import Joint, State
from asdfviz.geometry.shapes import Rotation, Transform
from asdfviz.geometry.transforms import rotation_about, transform_from


def random_rotation(rng: np.random.Generator) -> Rotation:
    """Even over all rotations (a normalised Gaussian quaternion)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def joined_poses(
    state: State, rng: np.random.Generator, *, spread: float = 1.0
) -> Mapping[str, Transform]:
    """T_base_part of a state with its joints at random places within `spread` of their travel.

    Parts whose joints are equal hang on one another (a jaw and its screw, all that sits on a ball)
    and move as one; joints of one link are all at the same share of their ranges.
    """
    motions: dict[tuple[object, ...], Transform] = {}
    travels: dict[tuple[object, ...], float] = {}
    poses: dict[str, Transform] = {}
    for name, T_base_part in state.T_base_part.items():
        joint = state.joints.get(name)
        if joint is None:
            poses[name] = T_base_part
            continue
        line = (joint.link,) if joint.link else (joint.axis.tobytes(), joint.slide)
        travel = travels.setdefault(line, rng.random())
        axle = (joint.axis.tobytes(), joint.origin.tobytes())
        key = (joint.kind, *line, *axle, joint.slide, joint.turn)
        if key not in motions:
            motions[key] = _motion(joint, travel, rng, spread)
        poses[name] = motions[key] @ T_base_part
    return poses


def _motion(joint: Joint, travel: float, rng: np.random.Generator, spread: float) -> Transform:
    """A motion that the joint allows, in the base frame."""
    low, high = joint.slide
    slide = spread * (low + (high - low) * travel) * joint.axis
    axis = random_rotation(rng)[0] if joint.kind == "ball" else joint.axis
    start, end = joint.turn
    turned = travel if joint.link else rng.random()
    R = rotation_about(axis, spread * (start + (end - start) * turned))
    return transform_from(R, joint.origin - R @ joint.origin + slide)
