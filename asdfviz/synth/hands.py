"""Procedural hands: fingers bent by joint angles, meshed as a smooth union of round cones.

The hand's frame: fingers point along +y, the back of the hand looks along +z, the thumb lies on +x
(a right hand), the forearm along -y. The origin is the grasp point between thumb and fingertips.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from asdfviz.data.kept_arrays import kept_arrays
from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Points, Vector
from asdfviz.synth import implicit, nails
from asdfviz.synth.nails import Fingertip

# Anatomy of a grown-up hand of mean size, metres; the palm's frame has its origin at the middle of
# the knuckles. Base, lengths of three phalanges, radius.
_FINGERS = (
    ((0.025, -0.004, 0.0), (0.043, 0.025, 0.021), 0.0088),
    ((0.007, 0.003, 0.001), (0.047, 0.029, 0.022), 0.0090),
    ((-0.011, 0.0, 0.0), (0.043, 0.027, 0.022), 0.0086),
    ((-0.027, -0.009, -0.003), (0.034, 0.020, 0.019), 0.0076),
)
_WRIST = np.array([0.0, -0.088, -0.002])
_THUMB_BASE = np.array([0.022, -0.066, -0.012])
_THUMB_LENGTHS = (0.046, 0.034, 0.027)
_PINCH = np.array([0.35, -0.75, -0.35]) / np.linalg.norm([0.35, -0.75, -0.35])
_PALM = np.array([0.0, -0.04, -0.004])
_BLEND = 0.008
_STEP = 0.005
_PIECE = 1024


@dataclass(frozen=True, slots=True)
class Grasp:
    """A hand's shape: how far fingers bend and how wide the thumb stands from them."""

    bend: tuple[float, float, float, float]
    """Sum of a finger's bend, radians, index to little finger."""
    spread: float
    """Angle between neighbouring fingers, radians."""
    gap: float
    """Distance of thumb and index fingertip, metres; negative for a thumb that lies aside."""
    wrist: float
    """Bend of the wrist, radians."""


def _pinch(gap: float, *, curled: bool = False) -> Grasp:
    """Thumb against index (and middle) fingertip; wider ones are more open."""
    bend = 1.62 - 9.5 * gap
    others = (2.4, 2.7, 2.8) if curled else (bend + 0.08, bend + 0.2, bend + 0.35)
    return Grasp((bend, *others), 0.05 + 1.2 * gap, gap, 0.25)


GRASPS = (
    _pinch(0.006, curled=True),
    _pinch(0.009),
    _pinch(0.013, curled=True),
    _pinch(0.018),
    _pinch(0.023),
    _pinch(0.030),
    _pinch(0.038),
    _pinch(0.047),
    _pinch(0.057),
    Grasp((2.0, 2.05, 2.1, 2.2), 0.06, 0.034, 0.1),
    Grasp((0.45, 0.40, 0.45, 0.5), 0.13, -1.0, 0.1),
    Grasp((0.12, 0.10, 0.12, 0.15), 0.05, -1.0, 0.15),
    Grasp((2.6, 2.7, 2.7, 2.7), 0.04, -1.0, 0.2),
    Grasp((0.25, 2.2, 2.5, 2.5), 0.06, -1.0, 0.0),
)
"""Pinches of growing width and a power grip hold something; then an open hand, a flat one, a fist and
a pointing finger."""
HOLDING = 10
PINCHES = range(9)
OPEN_HAND = 10
ARM_RISE = (0.1, 0.6)
"""How steeply the forearm of somebody who stands at a table rises, radians. Steeper ones would come up to
the camera and hide half of the view."""


@dataclass(frozen=True, slots=True, eq=False)
class HandMesh:
    """A meshed hand."""

    mesh: Mesh
    along_arm: Float64[np.ndarray, "n"]
    """Distance of each vertex from the wrist towards the elbow, metres, negative on the hand."""
    pinch: Vector
    """Unit vector from the index fingertip to the thumb's, hand frame."""
    entry: Vector
    """Unit vector from the palm to the grasp point, across `pinch`: what is grasped lies that way."""
    gap: float
    """Free width between the fingertips along `pinch`, metres; 0 for hands that hold nothing."""
    nails: Float64[np.ndarray, "n"]
    """Mark of each vertex: above 0 on a nail, see `nails.py`."""


Cone = tuple[Vector, Vector, float, float]


def _finger(
    base: Vector, lengths: tuple[float, ...], radius: float, bend: float, side: float
) -> list[Cone]:
    shares = (0.42, 0.36, 0.22)
    angle, start = 0.0, base
    cones: list[Cone] = []
    for k, (length, share) in enumerate(zip(lengths, shares, strict=True)):
        angle += bend * share
        direction = np.array(
            [np.sin(side) * np.cos(angle), np.cos(side) * np.cos(angle), -np.sin(angle)]
        )
        end = start + length * direction
        cones.append((start, end, radius * (1 - 0.09 * k), radius * (0.91 - 0.09 * k)))
        start = end
    return cones


def _thumb(target: Vector) -> list[Cone]:
    """Three bones from the wrist's side to the target, the middle ones bowed outwards."""
    reach = sum(_THUMB_LENGTHS)
    towards = target - _THUMB_BASE
    distance = min(float(np.linalg.norm(towards)), reach * 0.995)
    towards = towards / np.linalg.norm(towards)
    outwards = np.array([1.0, -0.1, -0.25])
    outwards -= towards * (outwards @ towards)
    outwards /= np.linalg.norm(outwards)
    low, high, angles = 0.0, 1.4, np.zeros(3)
    for _ in range(40):
        bow = (low + high) / 2
        angles = np.array([bow, 0.0, -bow * 1.2])
        span = sum(l * np.cos(a) for l, a in zip(_THUMB_LENGTHS, angles, strict=True))
        low, high = (bow, high) if span > distance else (low, bow)
    start, cones = _THUMB_BASE, list[Cone]()
    radii = (0.0135, 0.0112, 0.0100, 0.0085)
    points = [start]
    for length, angle in zip(_THUMB_LENGTHS, angles, strict=True):
        points.append(points[-1] + length * (np.cos(angle) * towards + np.sin(angle) * outwards))
    tilt = points[-1] - target
    for k in range(3):
        a = points[k] - tilt * k / 3
        b = points[k + 1] - tilt * (k + 1) / 3
        cones.append((a, b, radii[k], radii[k + 1]))
    return cones


def _skeleton(grasp: Grasp) -> tuple[list[Cone], list[Fingertip], Vector]:
    """All bones in the palm's frame, the last ones of fingers and thumb, and the grasp point."""
    cones: list[Cone] = []
    tips: list[Fingertip] = []
    for k, (base, lengths, radius) in enumerate(_FINGERS):
        side = (1.5 - k) * grasp.spread
        finger = _finger(np.array(base), lengths, radius, grasp.bend[k], side)
        cones += finger
        # A bent finger's back looks where the bone before it points.
        tips.append(_tip(finger, finger[-2][1] - finger[-2][0]))
        knuckle = np.array(base)
        root = _WRIST + np.array([base[0] * 0.55, 0.012, 0.0])
        cones.append((knuckle, root, 0.0115, 0.0145))
    if grasp.gap >= 0:
        # The thumb meets the fingertip from the palm's side, a gap away.
        target = tips[0].end + _PINCH * (grasp.gap + 0.015)
        origin = (tips[0].end + target) / 2
    else:
        target = np.array([0.062, 0.004, -0.03])
        origin = tips[1].end
    thumb = _thumb(target)
    cones += thumb
    tips.append(_tip(thumb, _PINCH))
    cones.append((_THUMB_BASE, _WRIST + np.array([0.012, 0.006, 0.0]), 0.0135, 0.016))
    cones.append((thumb[0][1], np.array([0.018, -0.02, -0.002]), 0.0105, 0.010))
    bend = np.array([0.0, -np.cos(grasp.wrist), np.sin(grasp.wrist)])
    for side in (-1.0, 1.0):
        wrist = _WRIST + np.array([0.013 * side, 0.0, 0.0])
        middle = wrist + 0.25 * bend + np.array([0.010 * side, 0.0, 0.0])
        cones.append((wrist, middle, 0.0175, 0.034))
        cones.append((middle, middle + 0.3 * bend, 0.034, 0.042))
    return cones, tips, origin


def _tip(finger: list[Cone], towards: Vector) -> Fingertip:
    start, end, _, radius = finger[-1]
    return Fingertip(start, end, radius, towards)


def _union(cones: list[Cone]) -> Callable[[Points], Float64[np.ndarray, "n"]]:
    """Signed distance to all bones, smoothly joined."""
    start, end = (np.stack([cone[k] for cone in cones]) for k in (0, 1))
    radius_a, radius_b = (np.array([cone[k] for cone in cones]) for k in (2, 3))
    axis = end - start
    squared = (axis**2).sum(axis=1)
    blend = _BLEND * 0.45
    starts_along, starts_squared = (start * axis).sum(axis=1), (start**2).sum(axis=1)

    def near(points: Points) -> Float64[np.ndarray, "n"]:
        # In place: fresh tables would take longer to get than to fill.
        along = points @ axis.T
        along -= starts_along
        t = along / squared
        np.maximum(t, 0, out=t)
        np.minimum(t, 1, out=t)
        away = 2 * points @ start.T
        np.subtract((points**2).sum(axis=1)[:, None], away, out=away)
        away += starts_squared
        along *= 2
        off = t * squared
        off -= along
        off *= t
        away += off
        np.maximum(away, 0, out=away)
        np.sqrt(away, out=away)
        t *= radius_b - radius_a
        t += radius_a
        away -= t
        np.minimum(away, 0.12, out=away)
        np.negative(away, out=away)
        away /= blend
        np.exp(away, out=away)
        return -np.log(away.sum(axis=1)) * blend

    def distance(points: Points) -> Float64[np.ndarray, "n"]:
        # Tables of points by cones stay in the processor's cache this way.
        pieces = range(0, len(points), _PIECE)
        return np.concatenate([near(points[i : i + _PIECE]) for i in pieces])

    return distance


@cache
def hand_mesh(index: int) -> HandMesh:
    """The hand of GRASPS[index], meshed once a machine: it is kept as long as nothing changes it."""
    held = kept_arrays("hands", _made_of(index), lambda: _meshed(GRASPS[index]))
    mesh = Mesh(held["vertices"], held["faces"])
    gap = float(held["gap"])
    return HandMesh(mesh, held["along_arm"], _PINCH, held["entry"], gap, held["nails"])


def _made_of(index: int) -> str:
    """A name for a hand that changes with the numbers and the code that it is made of."""
    digest = hashlib.sha256(f"{np.__version__} {platform.machine()} {index}\0".encode())
    for file in (__file__, implicit.__file__, nails.__file__):
        digest.update(Path(file).read_bytes())
    return digest.hexdigest()[:24]


def _meshed(grasp: Grasp) -> dict[str, np.ndarray]:
    """What `HandMesh` has of a hand, by its names."""
    cones, tips, origin = _skeleton(grasp)
    ends = np.stack([p for a, b, _, _ in cones for p in (a, b)])
    low, high = ends.min(axis=0) - 0.045, ends.max(axis=0) + 0.045
    distance = _union(cones)
    mesh = implicit.mesh_implicit(distance, low, high, step=_STEP)
    bend = np.array([0.0, -np.cos(grasp.wrist), np.sin(grasp.wrist)])
    along = (mesh.vertices - _WRIST) @ bend
    entry = origin - _PALM
    entry = entry - (entry @ _PINCH) * _PINCH
    entry = entry / np.linalg.norm(entry)
    gap = _free_width(distance, origin) if grasp.gap >= 0 else 0.0
    return {
        "vertices": mesh.vertices - origin,
        "faces": mesh.faces,
        "along_arm": along,
        "entry": entry,
        "gap": np.array(gap),
        "nails": nails.nail_marks(mesh.vertices, tips),
    }


def _free_width(distance: Callable[[Points], Float64[np.ndarray, "n"]], origin: Vector) -> float:
    """How wide the fingertips stand apart on the line between them, metres."""
    steps = np.linspace(0.0, 0.05, 201)
    sides = [distance(origin + s * steps[:, None] * _PINCH) for s in (-1.0, 1.0)]
    return float(sum(steps[int((side < 0).argmax())] for side in sides))
