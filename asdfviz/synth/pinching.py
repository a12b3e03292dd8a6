"""Where a part is narrow enough to be taken between thumb and fingertip, and hands there from all sides."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.shapes import Vector
from asdfviz.synth.hands import PINCHES, hand_mesh
from asdfviz.synth.layout import Outfit
from asdfviz.synth.penetration import Solid

_SPOTS, _ROLLS = 100, 24


def pinches(
    solid: Solid, outfit: Outfit, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, "n 4 4"], Int64[np.ndarray, "n"], Float64[np.ndarray, "n"]]:
    """T_part_hand from all sides of each pinched spot, hand shapes, how well these fit (1 is best)."""
    middles, axes, widths = (np.array(column) for column in zip(*_pinched(solid, rng), strict=True))
    grasps = [_fitting(width, outfit) for width in widths.tolist()]
    hands = [hand_mesh(grasp) for grasp in grasps]
    frames = {
        grasp: _frame(outfit.worn(hand.pinch), outfit.worn(hand.entry))
        for grasp, hand in zip(grasps, hands, strict=True)
    }
    worth = 1.0 - 60 * np.abs(widths - np.array([hand.gap for hand in hands]) * outfit.size)
    poses = _around(middles, axes, np.stack([frames[grasp] for grasp in grasps]))
    around = poses.shape[1]
    return poses.reshape(-1, 4, 4), np.repeat(grasps, around), np.repeat(worth, around)


def _fitting(width: float, outfit: Outfit) -> int:
    gaps = np.array([hand_mesh(g).gap for g in PINCHES]) * outfit.size
    # Soft fingertips give way a little, so a hand a bit too narrow is better than one too wide.
    return PINCHES[int(np.abs(gaps - (width - 0.001)).argmin())]


def _pinched(solid: Solid, rng: np.random.Generator) -> list[tuple[Vector, Vector, float]]:
    """Spots where a part is narrow: middle, axis across, width (part frame, metres)."""
    widest = max(hand_mesh(g).gap for g in PINCHES) * 1.05
    corner, planes = solid.triangles[:, 0], solid.planes
    picked = rng.choice(len(corner), size=_SPOTS, p=planes.areas / planes.areas.sum())
    share = rng.random((2, _SPOTS, 1))
    share = np.where(share.sum(axis=0) > 1, 1 - share, share)
    spots = corner[picked] + share[0] * planes.edges[0, picked] - share[1] * planes.edges[2, picked]
    found: list[tuple[Vector, Vector, float]] = []
    for spot, normal in zip(spots, planes.normals[picked], strict=True):
        width, far = _opposite(spot, -normal, solid)
        if 0.002 < width < widest and planes.normals[far] @ normal < -0.75:
            found.append((spot - 0.5 * width * normal, normal, width))
    if found:
        return found
    size = solid.high - solid.low
    middle, narrow = solid.middle, int(size.argmin())
    return [(middle, np.eye(3)[narrow], float(size[narrow]))]


def _opposite(spot: Vector, inwards: Vector, solid: Solid) -> tuple[float, int]:
    """Thickness of the part behind a spot of its surface, and the triangle on the other side; else inf."""
    normals, corners = solid.planes.normals, solid.triangles.transpose(1, 0, 2)
    down = normals @ inwards
    t = ((corners[0] - spot) * normals).sum(axis=1) / np.where(np.abs(down) < 1e-9, np.inf, down)
    met = np.nonzero((down > 1e-9) & (t > 1e-4))[0]
    hit = spot + t[met, None] * inwards
    within = ((hit - corners[:, met]) * solid.planes.sides[:, met]).sum(axis=2) >= -1e-12
    met = met[within.all(axis=0)]
    if not len(met):
        return np.inf, 0
    far = met[t[met].argmin()]
    return float(t[far]), int(far)


def _frame(pinch: Vector, entry: Vector) -> Float64[np.ndarray, "3 3"]:
    return np.stack([pinch, entry, np.cross(pinch, entry)], axis=1)


def _around(
    middles: Float64[np.ndarray, "s 3"],
    axes: Float64[np.ndarray, "s 3"],
    hands: Float64[np.ndarray, "s 3 3"],
) -> Float64[np.ndarray, "s n 4 4"]:
    """For each spot, hands whose fingertips meet its axis, from all sides and both ways round."""
    side = np.cross(axes, np.eye(3)[np.abs(axes).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = np.arange(_ROLLS)[:, None] * 2 * np.pi / _ROLLS
    entry = np.cos(angle) * side[:, None] + np.sin(angle) * np.cross(axes, side)[:, None]
    poses = np.tile(np.eye(4), (len(axes), 2 * _ROLLS, 1, 1))
    for start, sign in ((0, 1.0), (_ROLLS, -1.0)):
        pinch = np.broadcast_to(sign * axes[:, None], entry.shape)
        frames = np.stack([pinch, entry, np.cross(pinch, entry)], axis=3)
        poses[:, start : start + _ROLLS, :3, :3] = frames @ hands.transpose(0, 2, 1)[:, None]
    poses[:, :, :3, 3] = middles[:, None]
    return poses
