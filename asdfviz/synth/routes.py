"""Routes over what lies around, joints left where nothing collides, and wrong places to hold a part to."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import (
    apply,
    inverse,
    rotation_about,
    rotation_angle,
    transform_from,
)
from asdfviz.pose.resting import RestingFace, footprint, overlap
from asdfviz.synth.assets import Cloud
from asdfviz.synth.grasping import Grip, arm_outline, hand_points, scaled
from asdfviz.synth.joint_motion import held_with, joined_poses, random_rotation
from asdfviz.synth.layout import Outfit, turn_z
from asdfviz.synth.motion import blend, moved
from asdfviz.synth.penetration import Solid
from asdfviz.synth.ways import TOLERANCE, Body, deepest, is_free, lowest, touches

CLEARANCE = 0.008
"""Air between what is carried and what lies below, metres."""
_STOPOVERS = 3
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
OFFSET_MM, OFFSET_DEG = (5.0, 30.0), (10.0, 40.0)
"""How far off a wrong place is."""


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A thing from above: a disc with a height."""

    middle: np.ndarray
    """x and y, world."""
    radius: float
    top: float

    @classmethod
    def of(cls, T: Transform, points: Points) -> Obstacle:
        """Of a thing's points and where it is."""
        world = apply(T, points)
        low, high = world[:, :2].min(axis=0), world[:, :2].max(axis=0)
        return cls(
            (low + high) / 2, float(np.linalg.norm(high - low)) / 2, float(world[:, 2].max())
        )


def over(
    start: Transform, goal: Transform, grip: Grip | None, outfit: Outfit | None,
    solid: Solid, obstacles: Sequence[Obstacle],
) -> list[Transform]:  # fmt: skip
    """Where a carried part rises to and sinks from so that it and the fingers pass over everything."""
    points, arm = solid.samples, solid.samples
    if grip is not None and outfit is not None:
        T = scaled(grip.T_part_hand, outfit)
        points = np.concatenate([points, apply(T, hand_points(grip.grasp))])
        arm = apply(T, arm_outline(grip.grasp))
    return _raised(start, goal, points, arm, solid.middle, obstacles)


def over_with_hand(
    start: Transform, goal: Transform, outfit: Outfit, grasp: int, obstacles: Sequence[Obstacle]
) -> list[Transform]:
    """The same for an empty hand."""
    T = scaled(np.eye(4), outfit)
    points, arm = apply(T, hand_points(grasp)), apply(T, arm_outline(grasp))
    return _raised(start, goal, points, arm, np.zeros(3), obstacles)


def rests_between(
    name: str,
    goal: Transform,
    spot: Transform,
    faces: Sequence[RestingFace],
    poses: Mapping[str, Transform],
    solids: Mapping[str, Solid],
) -> list[Transform]:
    """Rests on a part's own spot on the table, those first on the way to whose goal it turns least.

    Args:
        name: the part.
        goal: where it shall go, world.
        spot: where it lay in the beginning.
        faces: on which it can stand.
        poses: where everything is.
        solids: of all parts.
    """
    samples = solids[name].samples
    middle = (a := apply(spot, samples)).min(axis=0) / 2 + a.max(axis=0) / 2
    turns = [turn_z(k * np.pi / 4) for k in range(8)]
    every = [spin @ face.R_world_part for face in faces if face.margin > 0.001 for spin in turns]
    ends = (poses[name][:3, :3], goal[:3, :3])
    every.sort(key=lambda R: max(rotation_angle(R.T @ end) for end in ends))
    others = [footprint(apply(T, solids[n].samples)) for n, T in poses.items() if n != name]
    found: list[Transform] = []
    for R in every[:60]:
        turned = samples @ R.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        t = np.array([*(middle - (low + high) / 2)[:2], -low[2]])
        if not any(overlap(footprint(turned + t), other, gap=0.004) for other in others):
            found.append(transform_from(R, t))
            if len(found) == _STOPOVERS:
                break
    return found


def _raised(
    start: Transform,
    goal: Transform,
    points: Points,
    arm: Cloud,
    pivot: Vector,
    obstacles: Sequence[Obstacle],
) -> list[Transform]:
    """Start and goal so high that the points pass over obstacles, and the arm over the table."""
    middle = transform_from(np.eye(3), pivot)
    local = points - pivot
    a, b = start @ middle, goal @ middle
    between = [blend(a, b, share)[:3, :3] for share in _SHARES]
    below = max(-float((local @ R[2]).min()) for R in between)
    radius = float(np.linalg.norm(local, axis=1).max())
    tops = [o.top for o in obstacles if _distance(o.middle, a[:2, 3], b[:2, 3]) < radius + o.radius]
    dips = max(-float(((arm - pivot) @ R[2]).min()) for R in between)
    height = max(max(tops, default=0.0) + below + CLEARANCE, dips + CLEARANCE)
    return [
        moved(T, np.array([0.0, 0.0, max(0.0, height - (T @ middle)[2, 3])])) for T in (start, goal)
    ]


def _distance(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """From a point to a stretch, in the plane."""
    along = b - a
    share = np.clip((point - a) @ along / max(float(along @ along), 1e-12), 0, 1)
    return float(np.linalg.norm(a + share * along - point))


def free_targets(
    assembly: Assembly, solids: Mapping[str, Solid], *, seed: int, still: Collection[str] = ()
) -> Mapping[int, Mapping[str, Transform]]:
    """T_base_part of every state with its joints somewhere in their travel, the same in all states.

    The travel is narrowed until joined parts stand in one another no deeper than in their nominal
    poses, but for a fraction of a millimetre (threads that slide unturned). Joints of the parts in
    `still` keep their nominal places, and so does what is linked with them.
    """
    still = held_with(assembly, still)
    nominal = _depths(assembly, solids, {s.index: s.T_base_part for s in assembly.states})
    for spread in (0.8, 0.5, 0.25, 0.1):
        targets = {
            s.index: joined_poses(s, np.random.default_rng([seed, 5]), spread=spread, still=still)
            for s in assembly.states
        }
        found = _depths(assembly, solids, targets)
        if all(found[key] <= nominal[key] + TOLERANCE for key in found):
            return targets
    return {s.index: s.T_base_part for s in assembly.states}


def _depths(
    assembly: Assembly,
    solids: Mapping[str, Solid],
    targets: Mapping[int, Mapping[str, Transform]],
) -> dict[tuple[int, str, str], float]:
    """How deep every two joined parts stand in each other, by state and names, metres."""
    known: dict[tuple[str, str, bytes], float] = {}
    found: dict[tuple[int, str, str], float] = {}
    for state in assembly.states:
        poses = targets[state.index]
        for a, b in combinations(state.attached, 2):
            relative = inverse(poses[b]) @ poses[a]
            key = (a, b, np.round(relative, 6).tobytes())
            if key not in known:
                known[key] = touches(Body(solids[a], poses[a]), Body(solids[b], poses[b]))
            found[state.index, a, b] = known[key]
    return found


def wrong_place(
    body: Body,
    others: Sequence[Body],
    way: Vector,
    T_world_base: Transform,
    rng: np.random.Generator,
) -> Transform | None:
    """A place 5 to 30 mm and 10 to 40 degrees off that touches nothing on the way there and home.

    Args:
        body: the part at its right place, base frame.
        others: what is joined, base frame.
        way: from the right place to where its way home begins, metres.
        T_world_base: where the base is.
        rng: throws.
    """
    allowed = deepest(body, others) + TOLERANCE
    home = moved(body.T, way)
    pivot = transform_from(np.eye(3), body.solid.middle)
    out = way / np.linalg.norm(way)
    for _ in range(40):
        aside = random_rotation(rng)[0]
        direction = out + 0.7 * aside
        shift = direction / np.linalg.norm(direction) * rng.uniform(*OFFSET_MM) / 1000
        turn = rotation_about(random_rotation(rng)[0], np.radians(rng.uniform(*OFFSET_DEG)))
        T = moved(body.T @ pivot @ transform_from(turn, np.zeros(3)) @ inverse(pivot), shift)
        stops = [
            Body(body.solid, blend(T @ pivot, home @ pivot, share) @ inverse(pivot))
            for share in np.linspace(0, 1, 13)
        ]
        if all(lowest(b, T_world_base) > 0 and is_free(b, others, allowed) for b in stops):
            return T
    return None
