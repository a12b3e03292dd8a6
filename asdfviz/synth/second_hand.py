"""Hands that do not carry: one that holds a base which cannot stand, one that hovers over everything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, transform_from
from asdfviz.pose.resting import footprint
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import Hold, dressed, find_grip, hand_points, scaled
from asdfviz.synth.hands import OPEN_HAND, hand_mesh
from asdfviz.synth.layout import Outfit, Table, dress, turn_z
from asdfviz.synth.penetration import Solid
from asdfviz.synth.stage import Stand
from asdfviz.synth.ways import Body

_COMING = 16
"""Frames after which a hovering hand is there: the first ones show all parts, as trackers need them."""
_FROM = 0.4
"""How far off it begins, metres."""
_ALONG, _ASIDE = 0.07, 0.11
"""How far it wanders to each side, metres: as wide as a hand, so that what it hides is seen in between."""
_LOOKING_ON = 3.0
"""How much more a grip is worth that hides nothing than one that hides all; comfort is about 1."""
_CELL = 0.01
"""Of the grid in which a hand hides things, metres at their distance."""
_HAND_STEP, _WORK_STEP = 8, 2
"""Every so manieth point of hands and of what they hide is looked at."""
_SHADOW_POINTS = 400
"""Points of a hand whose outline over the table is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """A hand that does not carry: where it is in every frame, or for good."""

    outfit: Outfit
    T_world_hand: tuple[Transform, ...]
    """Rigid; one a moment, or one for all."""


def holding(
    base: Solid,
    stand: Stand,
    joined: Sequence[Body],
    table: Table,
    outfit: Outfit,
    rng: np.random.Generator,
) -> Hand | None:
    """The other hand of the person, at the base for good; None if it finds no grip.

    Who assembles looks at the work, nearly as the camera does: of good grips that is taken which hides
    little of the base and of what is joined to it, and least of all one part's place wholly.

    Args:
        base: the base part.
        stand: where it is.
        joined: every place that a joined part has or comes from, world.
        table: with the camera.
        outfit: the carrying hand.
        rng: chooses among equally good grips.
    """
    left = replace(outfit, mirrored=not outfit.mirrored)
    hold = Hold(stand.T_world_base, tuple(joined))
    bodies = (Body(base, stand.T_world_base), *joined)
    step = _WORK_STEP * len(bodies)
    work = [apply(b.T, b.solid.samples[::step]) for b in bodies]
    also = partial(unhidden, work, table.T_camera_world @ stand.T_world_base, table, left)
    grip = find_grip(base, [hold], _other_shoulder(stand, outfit), left, rng, also=also)
    if grip is None:
        return None
    return Hand(dressed(left, grip.grasp), (hold.T_world_part @ grip.T_part_hand,))


def unhidden(
    work: Sequence[Float64[np.ndarray, "_ 3"]],
    T_camera_base: Transform,
    table: Table,
    outfit: Outfit,
    T_base_hand: Float64[np.ndarray, "n 4 4"],
    grasps: Int64[np.ndarray, "n"],
) -> Float64[np.ndarray, "n"]:
    """Worth of hands at the base: up to _LOOKING_ON for those that hide nothing of `work` (world).

    Half of it is for the whole, half for the body of `work` that is hidden most: of a small part's
    place at the end of a long base a hand can hide all, and then no step that is made there is seen.
    """
    seen = apply(table.T_camera_world, np.concatenate(work))
    first = np.cumsum([0, *(len(points) for points in work[:-1])])
    counts = np.array([len(points) for points in work])
    rays = seen[:, :2] / seen[:, 2:]
    corner, cell = rays.min(axis=0), _CELL / float(seen[:, 2].mean())
    at = ((rays - corner) / cell).astype(int)
    width, height = at.max(axis=0) + 1
    hands = {int(g): hand_mesh(int(g)).mesh.vertices[::_HAND_STEP] for g in np.unique(grasps)}
    worth = np.empty(len(T_base_hand))
    for k, (T, grasp) in enumerate(zip(T_base_hand, grasps.tolist(), strict=True)):
        points = apply(scaled(T_camera_base @ T, outfit), hands[grasp])
        points = points[points[:, 2] > cell]
        x, y = np.floor((points[:, :2] / points[:, 2:] - corner) / cell).astype(int).T
        inside = (x >= -1) & (x <= width) & (y >= -1) & (y <= height)
        front = np.full((height + 2, width + 2), np.inf, np.float32)
        np.minimum.at(front, (y[inside] + 1, x[inside] + 1), points[inside, 2])
        front = cv2.erode(front, np.ones((3, 3), np.uint8))  # points lie apart, skin does not
        free = front[at[:, 1] + 1, at[:, 0] + 1] > seen[:, 2]
        least = (np.add.reduceat(free.astype(int), first) / counts).min()
        worth[k] = _LOOKING_ON * (float(free.mean()) + float(least)) / 2
    return worth


def covered(hand: Hand, table: Table) -> list[Float64[np.ndarray, "_ 2"]]:
    """What a still hand covers of the table: from straight above, and from the camera."""
    points = hand_mesh(hand.outfit.grasp).mesh.vertices
    points = points[:: max(1, len(points) // _SHADOW_POINTS)]
    world = apply(scaled(hand.T_world_hand[0], hand.outfit), points)
    eye = inverse(table.T_camera_world)[:3, 3]
    # What is level with the camera hides nothing of the table.
    low = world[world[:, 2] < 0.8 * eye[2]]
    reach = eye[2] / (eye[2] - np.maximum(low[:, 2:], 0.0))
    return [footprint(low), footprint(eye + (low - eye) * reach)]


def hovering(
    solids: Mapping[str, Solid],
    stand: Stand,
    moments: tuple[Moment, ...],
    outfit: Outfit,
    rng: np.random.Generator,
) -> Hand:
    """An open hand that comes in and wanders over the assembly, above whatever is carried there."""
    hand = dressed(dress(rng, grasp=OPEN_HAND), OPEN_HAND)
    base = stand.T_world_base[:3, 3]
    tops: list[float] = []
    for moment in moments[:: max(1, len(moments) // 60)]:
        tops += [
            float(apply(T, solids[n].samples)[:, 2].max()) for n, T in moment.T_world_part.items()
        ]
    arm = _other_shoulder(stand, outfit) - base
    angle = float(np.arctan2(arm[1], arm[0]))
    phases, poses = rng.random(3) * 2 * np.pi, list[Transform]()
    flat = np.array([np.cos(angle), np.sin(angle), 0.0])
    stretched = hand.pose(np.zeros(3), flat, pitch=0.1, roll=0.0)[:3, :3]
    side = -1.0 if hand.mirrored else 1.0
    R = stretched / np.linalg.norm(stretched, axis=0) * [side, 1.0, 1.0]
    low = float(
        apply(scaled(transform_from(R, np.zeros(3)), hand), hand_points(OPEN_HAND))[:, 2].min()
    )
    for k in range(len(moments)):
        wave = np.sin(2 * np.pi * k / np.array([47.0, 61.0, 39.0]) + phases)
        away = _FROM * (0.5 + 0.5 * np.cos(np.pi * min(k / _COMING, 1.0)))
        aside = np.array([-flat[1], flat[0], 0.0])
        out = flat * (0.05 + _ALONG * wave[0] + away) + _ASIDE * wave[1] * aside
        height = max(tops) - low + 0.012 + 0.008 * (1 + wave[2])
        poses.append(transform_from(R, np.array([*(base + out)[:2], height])))
    return Hand(hand, tuple(poses))


def _other_shoulder(stand: Stand, outfit: Outfit) -> Vector:
    """Where a person's other arm comes from."""
    middle = stand.T_world_base[:3, 3]
    turn = turn_z(1.2 if outfit.mirrored else -1.2)
    return middle + turn @ (stand.shoulder - middle)
