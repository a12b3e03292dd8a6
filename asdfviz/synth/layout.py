"""Where things go: groups of joined parts, loose parts at rest or tilted, hands that hold or pass by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Intrinsics, Points, Rotation, Transform, Vector
from asdfviz.geometry.transforms import apply, inverse, rotation_about, transform_from
from asdfviz.pose.resting import RestingFace, footprint, overlap, resting_faces
from asdfviz.synth.assets import SLEEVE_CUTS, Assets
from asdfviz.synth.description import Finish, Placed
from asdfviz.synth.hands import ARM_RISE, GRASPS, HOLDING
from asdfviz.synth.joint_motion import random_rotation
from asdfviz.synth.looks import plastic, random_hue, skin, sleeve

GROUP_THROWS = 24
"""From so many sides a joined group is put down to find how it can stand."""
NEAREST = 0.36  # Nothing is lifted closer to the camera, metres: an arm would hide everything.


def turn_z(angle: float) -> Rotation:
    """Rotation about the vertical."""
    return rotation_about(np.array([0.0, 0.0, 1.0]), angle)


def group_points(assembly: Assembly, T_base_part: Mapping[str, Transform]) -> Points:
    """Vertices of all joined parts in the base part's frame."""
    meshes = [apply(T, assembly.parts[name].mesh.vertices) for name, T in T_base_part.items()]
    return np.concatenate(meshes)


def rest(points: Points, faces: Sequence[RestingFace], rng: np.random.Generator) -> Transform:
    """A pose that stands on one of the faces at a random turn; lowest point at z = 0, centred in x and y."""
    if not faces:
        return lowered(points, random_rotation(rng))
    shares = np.array([f.probability for f in faces])
    chosen = faces[int(rng.choice(len(faces), p=shares / shares.sum()))]
    return lowered(points, turn_z(rng.random() * 2 * np.pi) @ chosen.R_world_part)


def lowered(points: Points, R: Rotation) -> Transform:
    """The pose of rotation R whose lowest point is z = 0 and whose middle is over the origin."""
    turned = points @ R.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    return transform_from(R, -np.array([*((low + high) / 2)[:2], low[2]]))


@dataclass(slots=True)
class Table:
    """What stands where, so that nothing overlaps and everything is in view."""

    K: Intrinsics
    T_camera_world: Transform
    width: int
    height: int
    reach: float
    """Largest distance from the middle of the view, metres."""
    outlines: list[Float64[np.ndarray, "_ 2"]] = field(
        default_factory=list[Float64[np.ndarray, "_ 2"]]
    )
    covered: list[Float64[np.ndarray, "_ 2"]] = field(
        default_factory=list[Float64[np.ndarray, "_ 2"]]
    )
    """Where nothing is laid although nothing stands there: the camera would not see it."""

    def on_table(self, u: float, v: float) -> Vector:
        """The point of the table's plane behind a pixel."""
        T_world_camera = inverse(self.T_camera_world)
        ray = T_world_camera[:3, :3] @ np.linalg.solve(self.K, np.array([u, v, 1.0]))
        eye = T_world_camera[:3, 3]
        return eye - ray * (eye[2] / min(ray[2], -1e-6))

    def room_above(self, points_world: Points) -> float:
        """By how much things that lie there may be raised before they are too near to the camera."""
        return inverse(self.T_camera_world)[2, 3] - NEAREST - float(np.ptp(points_world[:, 2]))

    def find_place(
        self,
        outline: Float64[np.ndarray, "k 2"],
        rng: np.random.Generator,
        *,
        gap: float = 0.004,
        border: tuple[float, float] = (0.05, 0.05),
    ) -> Float64[np.ndarray, "2"] | None:
        """A free place for a footprint given about its own middle; None if sixty tries fail.

        Args:
            outline: convex, metres, about (0, 0).
            rng: throws.
            gap: least distance to other footprints, metres.
            border: shares of width and height at each side of the image that stay free.
        """
        middle = self.on_table(self.width / 2, self.height / 2)[:2]
        for _ in range(60):
            u, v = rng.uniform(border, 1 - np.asarray(border)) * [self.width, self.height]
            spot = self.on_table(u, v)[:2]
            if np.linalg.norm(spot - middle) > self.reach:
                continue
            moved = outline + spot
            if not any(overlap(moved, other, gap=gap) for other in self.outlines + self.covered):
                self.outlines.append(moved)
                return spot
        return None


def place_group(
    assets: Assets,
    T_base_part: Mapping[str, Transform],
    table: Table,
    rng: np.random.Generator,
    *,
    held: bool,
) -> Transform:
    """T_world_base of the joined group: at rest, or in the air at any orientation."""
    points = group_points(assets.assembly, T_base_part)
    if held:
        standing = lowered(points, random_rotation(rng))
        lift = max(0.0, min(rng.uniform(0.0, 0.22), table.room_above(apply(standing, points))))
    else:
        alone = len(T_base_part) == 1
        base = assets.resting[assets.assembly.base]
        faces = base if alone else resting_faces(points, throws=GROUP_THROWS)
        standing, lift = rest(points, faces, rng), 0.0
    u, v = rng.uniform(0.28, 0.72, 2) * [table.width, table.height]
    spot = table.on_table(u, v)
    T = transform_from(standing[:3, :3], standing[:3, 3] + np.array([spot[0], spot[1], lift]))
    table.outlines.append(footprint(apply(T, points)))
    return T


def place_loose(
    assets: Assets, name: str, table: Table, rng: np.random.Generator, *, tilted: bool
) -> Transform | None:
    """T_world_part of a loose part, or None if there is no room."""
    points = assets.assembly.parts[name].mesh.vertices
    T = lowered(points, random_rotation(rng)) if tilted else rest(points, assets.resting[name], rng)
    lift = rng.uniform(0, 0.05) if tilted and rng.random() < 0.4 else 0.0
    spot = table.find_place(footprint(apply(T, points)), rng)
    if spot is None:
        return None
    return transform_from(T[:3, :3], T[:3, 3] + np.array([spot[0], spot[1], lift]))


def place_carried(
    assets: Assets, name: str, table: Table, rng: np.random.Generator
) -> Transform | None:
    """T_world_part of a part over the table, turned freely, or None if there is no room."""
    points = assets.assembly.parts[name].mesh.vertices
    T = lowered(points, random_rotation(rng))
    lying = apply(T, points)
    spot = table.find_place(footprint(lying), rng, border=(0.15, 0.15))
    if spot is None:
        return None
    shift = np.array([*spot, max(0.0, min(rng.uniform(0.01, 0.16), table.room_above(lying)))])
    return transform_from(T[:3, :3], T[:3, 3] + shift)


def place_distractor(assets: Assets, table: Table, rng: np.random.Generator) -> Placed | None:
    """Some solid, stretched to a size of 1 to 12 cm."""
    kind = int(rng.integers(len(assets.distractors)))
    size = float(np.exp(rng.uniform(-4.4, -2.66))) * np.exp(rng.normal(size=3) * 0.45)
    size = np.minimum(size, 0.13)
    points = assets.distractor_points[kind] * size
    upright = rng.random() < 0.5
    lying = rotation_about(np.array([1.0, 0.0, 0.0]), np.pi / 2)
    fallen = lying if rng.random() < 0.7 else random_rotation(rng)
    T = lowered(points, turn_z(rng.random() * 2 * np.pi) @ (np.eye(3) if upright else fallen))
    spot = table.find_place(footprint(apply(T, points)), rng)
    if spot is None:
        return None
    T_world_mesh = T @ np.diag([*size, 1.0])
    T_world_mesh[:2, 3] += spot
    finish = plastic(random_hue(rng), rng)
    return Placed(assets.distractors[kind], T_world_mesh, finish, "distractor")


def stand(assets: Assets, points_world: Points, rng: np.random.Generator) -> list[Placed]:
    """A block or post from the table to the lowest points of a thing; nothing if there is no gap."""
    low = float(points_world[:, 2].min())
    if low < 0.004:
        return []
    middle = points_world[points_world[:, 2] < low + 0.003].mean(axis=0)
    kind = assets.distractors[int(rng.choice([0, 1, 2]))]
    width, depth = rng.uniform(0.012, 0.05, 2)
    T = transform_from(
        turn_z(rng.random() * 2 * np.pi), np.array([middle[0], middle[1], low / 2])
    ) @ np.diag([width, depth, low, 1.0])
    return [Placed(kind, T, plastic(random_hue(rng), rng), "distractor")]


def hand_at(
    assets: Assets,
    point: Vector,
    away: Vector,
    rng: np.random.Generator,
    *,
    grasp: int | None = None,
) -> list[Placed]:
    """A hand, perhaps sleeved, whose grasp point is at `point` and whose arm leaves towards `away`.

    Args:
        assets: meshes.
        point: grasp point, world.
        away: horizontal direction towards the elbow, unit length.
        rng: chooses shape, side, tilt, skin and sleeve.
        grasp: index into GRASPS; random among the holding ones by default.
    """
    index = int(rng.integers(HOLDING)) if grasp is None else grasp
    outfit = dress(rng, grasp=index)
    pitch = float(rng.uniform(*ARM_RISE)) - GRASPS[index].wrist
    T = outfit.pose(point, away, pitch=pitch, roll=float(rng.normal() * 0.3))
    return outfit.place(assets, T)


@dataclass(frozen=True, slots=True, eq=False)
class Outfit:
    """One person's hand: shape, side, size, skin and perhaps a sleeve."""

    grasp: int
    """Index into GRASPS."""
    mirrored: bool
    """A left hand."""
    size: float
    skin: Finish
    sleeve: tuple[int, Finish] | None
    """Index into SLEEVE_CUTS and the cloth."""

    def pose(self, point: Vector, away: Vector, *, pitch: float, roll: float) -> Transform:
        """T_world_hand with the grasp point at `point` and the arm leaving towards `away`.

        Args:
            point: world, metres.
            away: horizontal unit vector towards the elbow.
            pitch: how far fingers point down, radians.
            roll: turn about the forearm beyond the usual inward turn, radians.
        """
        y = np.array([-away[0] * np.cos(pitch), -away[1] * np.cos(pitch), -np.sin(pitch)])
        x = np.cross(y, np.array([0.0, 0.0, 1.0]))
        x /= np.linalg.norm(x)
        inward = 0.35 if self.mirrored else -0.35
        R = np.stack([x, y, np.cross(x, y)], axis=1) @ rotation_about(
            np.array([0.0, 1.0, 0.0]), roll + inward
        )
        side = -1.0 if self.mirrored else 1.0
        return transform_from(R @ np.diag([side * self.size, self.size, self.size]), point)

    def worn(self, v: Float64[np.ndarray, "*n 3"]) -> Float64[np.ndarray, "*n 3"]:
        """A vector or several of the right hand as this hand has them."""
        return v * [-1.0, 1.0, 1.0] if self.mirrored else v

    def place(self, assets: Assets, T_world_hand: Transform) -> list[Placed]:
        """The hand and its sleeve as placed meshes."""
        placed = [Placed(assets.hands[self.grasp], T_world_hand, self.skin, "hand")]
        if self.sleeve is not None:
            cut, cloth = self.sleeve
            mesh = assets.sleeves[self.grasp * len(SLEEVE_CUTS) + cut]
            placed.append(Placed(mesh, T_world_hand, cloth, "hand"))
        return placed


def dress(rng: np.random.Generator, *, grasp: int) -> Outfit:
    """Draw one person's hand; gloved hands always end in a sleeve."""
    mirrored, size = bool(rng.random() < 0.5), float(rng.uniform(0.9, 1.08))
    bare = skin(rng)
    cloth = None
    if rng.random() < 0.45 or bare.translucency == 0:
        cloth = (int(rng.integers(len(SLEEVE_CUTS))), sleeve(rng))
    return Outfit(grasp, mirrored, size, bare, cloth)


def holding_hand(assets: Assets, points_world: Points, rng: np.random.Generator) -> list[Placed]:
    """A hand that grasps a thing near one of its ends, its arm leaving outwards."""
    middle = points_world.mean(axis=0)
    angle = rng.random() * 2 * np.pi
    away = np.array([np.cos(angle), np.sin(angle), 0.0])
    reach = (points_world - middle) @ away  # alike for corners that faces share
    ends = points_world[reach > min(np.quantile(reach, 0.9), np.nextafter(reach.max(), -1.0))]
    point = ends.mean(axis=0) - 0.004 * away + [0, 0, 0.004]
    # Fingers come from above: keep the knuckles over the table.
    point[2] = max(float(point[2]), 0.012)
    return hand_at(assets, point, turn_z(rng.normal() * 0.35) @ away, rng)


def passing_hand(assets: Assets, table: Table, rng: np.random.Generator) -> list[Placed]:
    """A hand near the border of the view, above the table."""
    side = int(rng.integers(4))
    s, inset = rng.uniform(0.1, 0.9), rng.uniform(0.06, 0.3)
    u, v = ((s, inset), (s, 1 - inset), (inset, s), (1 - inset, s))[side]
    spot = table.on_table(u * table.width, v * table.height)
    middle = table.on_table(table.width / 2, table.height / 2)
    away = (spot - middle)[:2]
    away = np.array([*(away / (np.linalg.norm(away) + 1e-6)), 0.0])
    point = spot + np.array([0, 0, rng.uniform(0.025, 0.14)])
    grasp = int(rng.integers(len(assets.hands)))
    return hand_at(assets, point, turn_z(rng.normal() * 0.4) @ away, rng, grasp=grasp)
