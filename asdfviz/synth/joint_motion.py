"""Draws places within the freedom that joints leave: what moves on a base, and what moves with it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from asdfviz.datatypes import Assembly, Joint, State
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
    state: State,
    rng: np.random.Generator,
    *,
    spread: float = 1.0,
    still: Collection[str] = (),
) -> Mapping[str, Transform]:
    """T_base_part of a state with its joints at random places within `spread` of their travel.

    Parts whose joints are equal hang on one another (a jaw and its screw, all that sits on a ball)
    and move as one; joints of one link are all at the same share of their ranges.

    Args:
        state: what is joined.
        rng: draws.
        spread: share of the travel that is used.
        still: parts that stay in their nominal poses, and with them what moves as one with them, is of
            one link with them, or slides along one line with them.
    """
    kept = {_held(state.joints[name]) for name in still if name in state.joints}
    motions: dict[tuple[object, ...], Transform] = {}
    travels: dict[tuple[object, ...], float] = {}
    poses: dict[str, Transform] = {}
    for name, T_base_part in state.T_base_part.items():
        joint = state.joints.get(name)
        if joint is None:
            poses[name] = T_base_part
            continue
        travel = travels.setdefault(_line(joint), rng.random())
        key = _key(joint)
        if key not in motions:
            motions[key] = _motion(joint, travel, rng, 0.0 if _held(joint) in kept else spread)
        poses[name] = motions[key] @ T_base_part
    return poses


def held_with(assembly: Assembly, still: Collection[str]) -> frozenset[str]:
    """Parts that stay in their nominal poses with others, in any state, if these do: a state that does not
    have the one that is stuck yet must have its companions where the later ones have them."""
    joints = [(n, joint) for state in assembly.states for n, joint in state.joints.items()]
    held = {_held(joint) for name, joint in joints if name in still}
    return frozenset(still) | {name for name, joint in joints if _held(joint) in held}


def _line(joint: Joint) -> tuple[object, ...]:
    """What joints at the same share of their travel have in common."""
    return (joint.link,) if joint.link else (joint.axis.tobytes(), joint.slide)


def _key(joint: Joint) -> tuple[object, ...]:
    """What joints that move as one have in common."""
    axle = (joint.axis.tobytes(), joint.origin.tobytes())
    return (joint.kind, *_line(joint), *axle, joint.slide, joint.turn)


def _held(joint: Joint) -> tuple[object, ...]:
    """What joints that stay together have in common: a screw does not stand still while its slider moves."""
    return _line(joint) if joint.link or joint.slide[1] > joint.slide[0] else _key(joint)


def _motion(joint: Joint, travel: float, rng: np.random.Generator, spread: float) -> Transform:
    """A motion that the joint allows, in the base frame."""
    low, high = joint.slide
    slide = spread * (low + (high - low) * travel) * joint.axis
    axis = random_rotation(rng)[0] if joint.kind == "ball" else joint.axis
    start, end = joint.turn
    turned = travel if joint.link else rng.random()
    R = rotation_about(axis, spread * (start + (end - start) * turned))
    return transform_from(R, joint.origin - R @ joint.origin + slide)
