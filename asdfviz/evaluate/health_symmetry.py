"""Finds parts that look the same when turned but do not say so."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from asdfviz.datatypes import Assembly, Mesh, Part
from asdfviz.evaluate.health_report import Finding
from asdfviz.evaluate.pose_errors import NearestPoints, nearest_points
from asdfviz.geometry.sampling import surface_middle, surface_points
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply, turn_about
from asdfviz.state.twins import twin_groups

SURFACE_POINTS, PROBES, FIRST_PROBES = 40_000, 500, 50
MISFIT = 0.015
"""As a share of the diameter: what keeps nearer than this to the surface is the same to a camera."""
OF_SURFACE = 99.0
"""Percent of the surface that must; the rest is what a small mark may cover."""
FREE_TURNS = (0.7, 1.9, 2.6)
"""Angles that no part with a few like sides is turned onto itself by, radians."""
MOST_FOLDS = 12
MOST_TURNS = 60
"""No body with edges has more turns, but prisms of many sides."""
PARALLEL = math.cos(math.radians(5.0))


class Turn(NamedTuple):
    """A turn of a part onto itself, about an axis through the middle of its surface."""

    axis: Vector
    folds: int
    """How often it looks the same in a whole turn; 0: always."""


def check_symmetries(assembly: Assembly) -> Iterator[Finding]:
    """Look for parts without symmetries whose mesh can be turned onto itself."""
    for names in twin_groups(assembly):
        part = assembly.parts[names[0]]
        turns = () if part.symmetries.is_symmetric else own_turns(part)
        if not turns:
            continue
        x, y, z = (1e3 * surface_middle(part.mesh.vertices, part.mesh.faces)).round(1) + 0.0
        how = " and ".join(_told(turn) for turn in turns)
        yield Finding(
            "symmetry",
            "warning",
            f"{' and '.join(names)} look{'' if names[1:] else 's'} the same turned {how}, through ({x:.1f}, {y:.1f}, "
            f"{z:.1f}) mm, but has no 'symmetries': turned poses will count as wrong, and networks "
            "are taught what cannot be seen. Unless marks or colours tell the sides apart, give it in "
            f"assembly.yaml (lengths in mm) symmetries: {declared(part.mesh, turns)}",
            float(len(turns)),
        )


def declared(mesh: Mesh, turns: Sequence[Turn]) -> str:
    """Turns about the middle of a mesh's surface as assembly.yaml takes them, lengths in mm.

    Turns that follow from others are there as well, but for those that a free turn gives.
    """
    middle = surface_middle(mesh.vertices, mesh.faces)
    free = [turn.axis for turn in turns if turn.folds == 0]
    steps = [
        turn_about(turn.axis, middle, 2 * math.pi / turn.folds) for turn in turns if turn.folds
    ]
    said: list[str] = []
    if free:
        steps = [T for T in steps if free[0] @ T[:3, :3] @ free[0] < -PARALLEL][:1]
        offset = _listed(1e3 * middle)
        axes = [f"{{axis: {_listed(axis)}, offset: {offset}}}" for axis in free]
        said.append(f"continuous: [{', '.join(axes)}]")
    rows = [_listed(_in_mm(T).reshape(-1)) for T in _generated(steps)]
    if rows:
        said.append(f"discrete: [{', '.join(rows)}]")
    return f"{{{', '.join(said)}}}"


def _generated(steps: Sequence[Transform]) -> list[Transform]:
    """Every transform that these give when done one after the other, but the identity."""
    found: list[Transform] = [np.eye(4)]
    for T in found:  # grows while it is read
        for step in steps:
            product = step @ T
            known = any(np.abs(product - other)[:3, :3].max() < 0.05 for other in found)
            if not known and len(found) <= MOST_TURNS:
                found.append(product)
    return found[1:]


def _in_mm(T: Transform) -> Transform:
    scaled = T.copy()
    scaled[:3, 3] *= 1e3
    return scaled


def _listed(numbers: np.ndarray) -> str:
    return f"[{', '.join(f'{x:.6g}' for x in numbers.round(5) + 0.0)}]"


def own_turns(part: Part) -> tuple[Turn, ...]:
    """The turns about the frame's axes and the surface's main ones that leave 99 % of it in place."""
    mesh = part.mesh
    surface = nearest_points(surface_points(mesh.vertices, mesh.faces, SURFACE_POINTS))
    probes = surface_points(mesh.vertices, mesh.faces, PROBES, seed=1)
    middle = surface_middle(mesh.vertices, mesh.faces)
    found: list[Turn] = []
    for axis in _axes(mesh, middle):

        def fits(angle: float, axis: Vector = axis) -> bool:
            turned = apply(turn_about(axis, middle, angle), probes)
            return _lies_on(surface, turned, MISFIT * part.diameter)

        if all(fits(angle) for angle in FREE_TURNS):
            found.append(Turn(axis, 0))
            continue
        folds = [n for n in range(2, MOST_FOLDS + 1) if fits(2 * math.pi / n)]
        if folds:
            found.append(Turn(axis, max(folds)))
    return tuple(found)


def _axes(mesh: Mesh, middle: Vector) -> list[Vector]:
    """Of the frame, and of the surface's inertia where they point elsewhere."""
    spread = surface_points(mesh.vertices, mesh.faces, SURFACE_POINTS) - middle
    main = np.linalg.eigh(spread.T @ spread)[1].T
    axes: list[Vector] = [*np.eye(3)]
    axes += [axis for axis in main if np.abs(np.eye(3) @ axis).max() < PARALLEL]
    return axes


def _lies_on(surface: NearestPoints, points: Points, limit: float) -> bool:
    """Whether OF_SURFACE percent of the points are nearer to a surface than a limit, metres."""
    allowed = len(points) - 1 - int(OF_SURFACE / 100.0 * (len(points) - 1))
    # Most turns put so many points far off that the first few of them tell.
    few = points[:FIRST_PROBES]
    if np.count_nonzero(surface.query(few)[0] >= limit) > allowed:
        return False
    return bool(np.percentile(surface.query(points)[0], OF_SURFACE) < limit)


def _told(turn: Turn) -> str:
    x, y, z = turn.axis.round(3) + 0.0
    about = f"about the axis [{x:.3g}, {y:.3g}, {z:.3g}]"
    return f"{'freely' if turn.folds == 0 else f'by {360 / turn.folds:.4g} degrees'} {about}"
